"""Runs as rows of a table: outcome, factors and metrics, with their units in the schema.

Nothing in it depends on the clock or on the machine, so a shard has the same bytes whoever flies
it. Parquet: pandas, Polars and DuckDB read it as it is.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from twin.campaigns.draw import Drawn
from twin.campaigns.flight import Came
from twin.campaigns.merit import METRICS
from twin.campaigns.spec import Spec
from twin.errors import CampaignError
from twin.whole_file import whole

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
    """The whole file or none of it, whenever the process is killed.

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
