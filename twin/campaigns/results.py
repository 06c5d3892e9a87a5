"""Rows of a campaign: their schema, how Parquet files keep them, how they are read back.

Runs as rows of a table: outcome, factors and metrics, with their units in the schema.
Nothing in it depends on the clock or on the machine, so a shard has the same bytes whoever flies
it. Parquet: pandas, Polars and DuckDB read it as it is.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from twin.campaigns.draw import Drawn
from twin.campaigns.flight import Came
from twin.campaigns.folder import Folder
from twin.campaigns.merit import METRICS
from twin.campaigns.read import read_spec
from twin.campaigns.spec import Spec
from twin.errors import CampaignError
from twin.files import whole

SCHEMA = "1"
"""Version of the columns."""


def schema_of(spec: Spec) -> pa.Schema:
    """The columns: outcome, factors, metrics; each with kind, unit and words in its metadata."""

    def entry(name: str, kind: pa.DataType, facts: Mapping[str, str]) -> pa.Field:
        return pa.field(name, kind, metadata=dict(facts))

    outcome = [
        entry("run", pa.int64(), {"kind": "outcome"}),
        entry("arm", pa.string(), {"kind": "outcome"}),
        entry("ended", pa.string(), {"kind": "outcome"}),
        entry("reason", pa.string(), {"kind": "outcome"}),
        entry("duration", pa.float64(), {"kind": "outcome", "unit": "s"}),
    ]
    factors = [
        entry(
            factor.name,
            pa.float64(),
            {"kind": "factor", "unit": factor.unit, "words": factor.distribution.words()},
        )
        for factor in spec.factors
    ]
    metrics = [
        entry(
            name,
            pa.float64(),
            {"kind": "metric", "unit": METRICS[name].unit, "words": METRICS[name].words},
        )
        for name in spec.metrics
    ]
    return pa.schema([*outcome, *factors, *metrics], metadata={"twin_campaign": SCHEMA})


def table_of(spec: Spec, drawn: Drawn, came: Mapping[int, Came]) -> pa.Table:
    """One row a run; what is not known is null."""
    rows = [came[run] for run in drawn.runs]
    columns: list[pa.Array] = [
        pa.array(drawn.runs, pa.int64()),
        pa.array([spec.arms[arm].name for arm in drawn.arms], pa.string()),
        pa.array([row.ended for row in rows], pa.string()),
        pa.array([row.reason for row in rows], pa.string()),
        pa.array([row.duration for row in rows], pa.float64()),
    ]
    columns += [pa.array(drawn.values[factor.name], pa.float64()) for factor in spec.factors]
    for name in spec.metrics:
        values = np.array([row.metrics[name] for row in rows])
        columns.append(pa.array(values, pa.float64(), mask=~np.isfinite(values)))
    return pa.Table.from_arrays(columns, schema=schema_of(spec))


def write_rows(table: pa.Table, path: Path) -> None:
    """Write a file whole or not at all, even if the process is killed.

    Raises:
        CampaignError: the disk is full, or gone.
    """
    try:
        with whole(path) as file:
            pq.write_table(table, file, compression="zstd")
    except OSError as problem:
        why = problem.strerror or problem
        raise CampaignError(
            path, f"cannot be written ({why})", "make room; --resume goes on"
        ) from None


def read_rows(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """What `write_rows` wrote, or some columns of it.

    Raises:
        CampaignError: it is damaged.
    """
    try:
        return pq.read_table(path, columns=None if columns is None else list(columns))
    except (pa.ArrowException, OSError) as problem:
        text = str(problem).split("\n", 1)[0]
        raise CampaignError(
            path, f"cannot be read ({text})", "remove it and --resume the campaign"
        ) from None


def size_of(table: pa.Table) -> int:
    """Bytes of its file."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.tell()


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
    """(n,) each, by name; NaN where a run has none."""

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
        names = [name for name, result in kinds.items() if result == kind]
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
