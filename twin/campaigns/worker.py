"""What a process of a campaign does: fly a shard and write it."""

import gc
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.campaigns.results import read_rows, table_of, write_rows
from twin.campaigns.spec import Spec
from twin.files import trust_folders

_spec: Spec | None = None
_folder: Folder | None = None


@dataclass(frozen=True)
class Done:
    """A shard that is flown."""

    shard: int
    runs: int
    failed: int
    """Of these."""


def fly_shard(spec: Spec, folder: Folder, shard: int) -> Done:
    """Fly the runs of a shard and write them."""
    done, rows = rows_of_shard(spec, shard)
    write_rows(rows, folder.shard(shard))
    return done


def written_shard(folder: Folder, shard: int) -> Done:
    """What `fly_shard` returns of a shard that is written."""
    ended = read_rows(folder.shard(shard), ["ended"])["ended"].to_pylist()
    return Done(shard, len(ended), ended.count("failed"))


def rows_of_shard(spec: Spec, shard: int) -> tuple[Done, pa.Table]:
    """Fly the runs of a shard; a row each."""
    drawn = draw(spec, spec.runs_of(shard))
    came = flown(spec, drawn)
    # A plant and its sensors hold each other, with all that MuJoCo has of the batch: the next
    # shard's should not come on top.
    gc.collect()
    failed = sum(run.ended == "failed" for run in came.values())
    return Done(shard, len(came), failed), table_of(spec, drawn, came)


def begin(path: str, trusted: tuple[Path, ...]) -> None:
    """Read the campaign of a folder, once a process; the code in those folders may run."""
    global _spec, _folder
    trust_folders(*filter(Path.is_dir, trusted))
    _folder = Folder(Path(path))
    _spec = read_spec(_folder.spec)


def fly(shard: int) -> Done:
    """`fly_shard`, in a process that has begun."""
    assert _spec is not None
    assert _folder is not None
    return fly_shard(_spec, _folder, shard)
