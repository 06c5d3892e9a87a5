"""One run of a campaign flown again alone, and compared with what the campaign wrote of it."""

import heapq
import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from twin.campaigns.draw import draw
from twin.campaigns.flight import Came, flown
from twin.campaigns.folder import Folder
from twin.campaigns.merit import METRICS
from twin.campaigns.results import read_rows, table_of
from twin.campaigns.spec import Spec
from twin.errors import UsageError
from twin.loop import Observer
from twin.shown import Shown
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder


@dataclass(frozen=True)
class Replayed(Shown):
    """A run that was flown again."""

    run: int
    arm: str
    values: dict[str, float]
    """Of its factors [SI]."""
    units: dict[str, str]
    """Of its factors."""
    came: Came
    differs: tuple[str, ...] | None
    """Columns that are not bit for bit those of the campaign; None where its shard is missing."""


def replay(spec: Spec, folder: Folder, run: int, rrd: Path | None = None) -> Replayed:
    """Fly run `run`, and record it in full where a file is named.

    Raises:
        UsageError: the campaign has no such run.
    """
    if not 0 <= run < spec.runs:
        raise UsageError(f"run is {run}; the campaign has the runs 0 to {spec.runs - 1}")
    drawn = draw(spec, [run])
    arm = spec.arms[drawn.arms[0]]
    with ExitStack() as stack:
        observers: list[Observer] = []
        if rrd is not None:
            recorder = stack.enter_context(FileRecorder(rrd))
            facts = provenance(arm.platform, seed=spec.seed, command=sys.argv)
            recorder.start(arm.platform, facts | {"campaign": str(folder.path), "run": run})
            observers.append(recorder)
        came = flown(spec, drawn, observers=observers)
    again = table_of(spec, drawn, came).to_pylist()[0]
    values = {name: float(value[0]) for name, value in drawn.values.items()}
    shard = folder.shard(run // spec.shard)
    differs: tuple[str, ...] | None = None
    if shard.is_file():
        written = read_rows(shard).slice(run % spec.shard, 1).to_pylist()[0]
        differs = tuple(name for name, value in again.items() if value != written[name])
    units = {factor.name: factor.unit for factor in spec.factors}
    return Replayed(run, arm.name, values, units, came[run], differs)


def record_kept(spec: Spec, folder: Folder, tell: Callable[[str], None]) -> list[Path]:
    """The recordings of a campaign that is flown; missing ones are made.

    Raises:
        CampaignError: another process flies or records there.
    """
    paths: list[Path] = []
    with folder.owned():
        for run in kept_runs(spec, folder):
            path = folder.recording(run)
            paths.append(path)
            if not path.is_file():
                tell(f"recording run {run}")
                path.parent.mkdir(exist_ok=True)
                part = path.with_name(f".{path.name}")
                replay(spec, folder, run, part)
                os.replace(part, path)
    return paths


def kept_runs(spec: Spec, folder: Folder) -> list[int]:
    """The runs to record: those that are named, and the worst; of a campaign that is flown."""
    worst: list[tuple[float, int]] = []
    if spec.keep.worst:
        side = METRICS[spec.keep.by].worse or 1
        for shard in range(spec.shards):
            table = read_rows(folder.shard(shard), ["run", spec.keep.by])
            runs, values = (column.to_pylist() for column in table.columns)
            known = [(side * v, -run) for v, run in zip(values, runs, strict=True) if v is not None]
            worst = heapq.nlargest(spec.keep.worst, [*worst, *known])
    return sorted({*spec.keep.runs, *(-run for _, run in worst)})
