"""What a campaign has written so far, column by column."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.campaigns.rows import read_rows
from twin.campaigns.spec import Spec
from twin.errors import CampaignError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Results:
    """Rows are the runs that are written, ascending."""

    spec: Spec
    folder: Path
    run: NDArray[np.int64]
    """(n,)."""
    arm: NDArray[np.str_]
    """(n,) names."""
    ended: NDArray[np.str_]
    """(n,)."""
    reason: tuple[str, ...]
    """(n,)."""
    factors: dict[str, Array]
    """(n,) each."""
    metrics: dict[str, Array]
    """(n,) each; NaN where there is none."""

    @property
    def sample(self) -> NDArray[np.int64]:
        """(n,) which draw from the distributions a run is of; runs of one sample are alike."""
        return self.run // (self.spec.points * self.spec.together)

    @property
    def machine(self) -> NDArray[np.int64]:
        """(n,) which machine a run is of: the independent draws, as tests count them.

        Runs of one machine differ by arm, point of the grids and noise. Where nothing is drawn, all
        runs are of one and differ by noise alone, which is each run's own: each then stands for
        itself, beside those of the other arms.
        """
        return self.run // (self.spec.points if self.spec.dispersed else len(self.spec.arms))

    @property
    def free(self) -> NDArray[np.bool_]:
        """(n,) whether a run's factors are drawn for themselves; in a Saltelli design most are
        another run's but for one."""
        place = (self.run // self.spec.points) % self.spec.together
        return place < 2

    @property
    def causes(self) -> dict[str, Array]:
        """Factors, and `|factor|` of those of either sign, for much may not ask for the side."""
        either = {
            f"|{name}|": np.abs(values)
            for name, values in self.factors.items()
            if (values > 0.0).any() and (values < 0.0).any()
        }
        return {**self.factors, **either}

    def of(self, arm: str) -> NDArray[np.intp]:
        """Rows of an arm."""
        return np.flatnonzero(self.arm == arm)


def read_results(path: Path) -> Results:
    """Everything that a campaign's folder holds.

    Raises:
        CampaignError: no campaign, or nothing of it yet.
    """
    folder = Folder(path)
    if not folder.begun:
        raise CampaignError(path, "holds no campaign", "fly one: twin campaign SPEC.toml DIR")
    spec = read_spec(folder.spec)
    folder.check_spec()
    missing = set(folder.missing(spec))
    files = [folder.shard(n) for n in range(spec.shards) if n not in missing]
    if not files:
        raise CampaignError(path, "holds no run yet", "wait for the first shard, or --resume it")
    table = pa.concat_tables([read_rows(file) for file in files])
    kinds = {entry.name: (entry.metadata or {}).get(b"kind", b"") for entry in table.schema}

    def numbers(kind: bytes) -> dict[str, Array]:
        names = [name for name, found in kinds.items() if found == kind]
        return {name: np.asarray(table[name].to_numpy(), dtype=np.float64) for name in names}

    return Results(
        spec=spec,
        folder=path,
        run=np.asarray(table["run"].to_numpy(), dtype=np.int64),
        arm=np.array(table["arm"].to_pylist(), dtype=np.str_),
        ended=np.array(table["ended"].to_pylist(), dtype=np.str_),
        reason=tuple(table["reason"].to_pylist()),
        factors=numbers(b"factor"),
        metrics=numbers(b"metric"),
    )
