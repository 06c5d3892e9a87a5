"""An `.rrd` of ours -> `Recording`, to the last bit; a file that was cut short is mended first."""

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import RecordingError
from twin.processes import run
from twin.recording.lock import wait_until_finished
from twin.recording.recording import Recording, Series
from twin.recording.schema import (
    COLUMNS,
    ENDING,
    PROVENANCE,
    SCHEMA,
    STREAM,
    TEXT,
    TIME,
    UNIT,
    VALUE,
)

if TYPE_CHECKING:
    import pyarrow as pa

Array = NDArray[np.float64]

_MAGIC = b"RRF"
_CLOSED = b"RRF2FOOT"
_ROW = "rerun.controls.RowId"
SHOWN = 8
"""Letters of a recording's name that an error shows."""


def read_recording(path: str | Path) -> Recording:
    """Read a recording; of a file that holds several, the one that begins as what follows a #:
    `two.rrd#4180`.

    Rows come in the order of their times, those of one time as they were written.
    A file that was never closed, or was cut anywhere, is read as far as it is whole, and `repairs`
    says so; the file itself stays as it is.

    Raises:
        RecordingError: no such file, not a recording of ours, of a newer schema, nothing in it, or
            several recordings, of which none is chosen.
    """
    path, chosen = which(Path(path))
    if not path.is_file():
        raise RecordingError(path, "there is no such recording", "check the path")
    ended = wait_until_finished(path)
    head, tail = _ends(path)
    if head and not head.startswith(_MAGIC):
        raise RecordingError(path, "is no Rerun recording", "name an .rrd, or a folder log")
    parts = _Parts()
    if _CLOSED in tail:
        try:
            parts.read(path, _chosen(path, chosen))
        except RecordingError:
            raise
        except (RuntimeError, KeyError, ValueError):  # bytes, or what is written in them
            parts = _mended(path)
            parts.ended = False
        if not parts.ended:
            parts.notes.append(f"{path.name} is damaged; what could be decoded is here")
    else:
        parts = _mended(path)
        how = "was cut short, or never closed" if ended else "is still being written"
        parts.notes.append(f"{path.name} {how}; what is whole is here")
    return parts.recording(path)


def which(path: Path) -> tuple[Path, str]:
    """The file, and the beginning of the recording's name in it; empty where none is given."""
    name, mark, chosen = path.name.rpartition("#")
    return (path, "") if not mark or path.exists() else (path.with_name(name), chosen)


def _chosen(path: Path, start: str) -> str:
    """The name of the recording to read; empty where the file holds one only."""
    from rerun.chunk import RrdReader

    names = [entry.recording_id for entry in RrdReader(path).recordings()]
    fitting = [name for name in names if name.startswith(start)]
    if len(fitting) == 1:
        return fitting[0]
    if len(names) < 2 and not start:
        return ""
    listed = ", ".join(f"{path.name}#{name[:SHOWN]}" for name in names)
    problem = f"holds {len(names)} recordings" if not start else f"has no recording {start!r}"
    if start and fitting:
        problem = f"has {len(fitting)} recordings that begin {start!r}"
    raise RecordingError(path, problem, f"name one of {listed}")


class _Parts:
    """What the chunks of a file have given so far."""

    def __init__(self) -> None:
        self.headers: dict[str, tuple[str, tuple[str, ...], str]] = {}
        self.times: dict[str, list[tuple[NDArray[np.uint64], Array]]] = {}
        self.values: dict[str, list[tuple[NDArray[np.uint64], Array]]] = {}
        self.facts: dict[str, Any] | None = None
        self.ended = False
        self.notes: list[str] = []

    def read(self, path: Path, recording: str = "") -> None:
        for entity, batch in _batches(path, recording):
            names = batch.schema.names
            if entity == f"/{PROVENANCE}":
                self.facts = json.loads(_first(batch, TEXT)[0])
            elif entity == f"/{ENDING}":
                self.ended = True
                self.notes += filter(None, [json.loads(_first(batch, TEXT)[0])])
            elif STREAM in names:
                (stream,), columns = _first(batch, STREAM), _first(batch, COLUMNS)
                self.headers[entity] = stream, tuple(columns), _first(batch, UNIT)[0]
            # tools that arrange a file anew may part a row's components: its id joins them
            if TIME in names:
                self.times.setdefault(entity, []).append((_row_ids(batch), _times(batch)))
            if VALUE in names:
                self.values.setdefault(entity, []).append((_row_ids(batch), _values(batch)))

    def recording(self, path: Path) -> Recording:
        if self.facts is None:
            raise RecordingError(
                path,
                "holds nothing of a recording that could be used",
                "if it was cut this early, the run has to be repeated; if another program wrote "
                "it, export it as a folder log",
            )
        schema = self.facts.get("schema")
        if not isinstance(schema, int) or schema > SCHEMA:
            raise RecordingError(
                path,
                f"has schema version {schema}, this twin reads up to {SCHEMA}",
                "read it with a newer airbearing-twin",
            )
        streams = {one[0]: self._series(entity, path) for entity, one in self.headers.items()}
        earlier = self.facts.pop("repairs", ())
        reach = _reach(streams)
        repairs = (*earlier, *(f"{note}, {reach}" for note in self.notes))
        return Recording(streams, self.facts, repairs)

    def _series(self, entity: str, path: Path) -> Series:
        name, columns, unit = self.headers[entity]
        if entity not in self.times or entity not in self.values:
            return Series(np.empty(0), np.empty((0, len(columns))), columns, unit)
        width = len(columns)
        order, time = map(np.concatenate, zip(*self.times[entity], strict=True))
        ids, value = map(np.concatenate, zip(*self.values[entity], strict=True))
        value = value.reshape(-1, width)
        # by their times; between equal ones Rerun's row ids count up as written
        rank = np.lexsort((order[:, 1], order[:, 0], time))
        if not np.array_equal(order, ids):
            place = {pair: row for row, pair in enumerate(map(tuple, ids.tolist()))}
            rows = np.array([place.get(pair, -1) for pair in map(tuple, order.tolist())])
            value, rank = value[rows], rank[rows[rank] >= 0]
            if len(rank) < len(rows):
                lost = len(rows) - len(rank)
                self.notes.append(f"{path.name} lacks the values of {lost} rows of {name}")
        return Series(time[rank], value[rank], columns, unit)


def _batches(path: Path, recording: str) -> "Iterator[tuple[str, pa.RecordBatch]]":
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    stores = [one for one in reader.recordings() if one.recording_id == recording]
    for chunk in reader.stream(store=stores[0]) if stores else reader.stream():
        yield chunk.entity_path, chunk.to_record_batch()


def _first(batch: "pa.RecordBatch", name: str) -> list[str]:
    return batch.column(name)[0].as_py()


def _values(batch: "pa.RecordBatch") -> Array:
    """All numbers of the rows, one after the other."""
    return batch.column(VALUE).flatten().to_numpy(zero_copy_only=False)


def _times(batch: "pa.RecordBatch") -> Array:
    """The exact times (m,), which are kept as bytes."""
    return _raw(batch.column(TIME).flatten(), "<f8")


def _row_ids(batch: "pa.RecordBatch") -> NDArray[np.uint64]:
    """Rerun's 128-bit row ids as two numbers each, shape (m, 2)."""
    return _raw(batch.column(_ROW), ">u8").reshape(-1, 2)


def _raw(column: "pa.FixedSizeBinaryArray", kind: str) -> NDArray[Any]:
    """The bytes of a column, as numbers of a kind."""
    width = column.type.byte_width
    data = column.buffers()[1]
    first, size = column.offset * width, len(column) * width
    return np.frombuffer(data, kind, count=size // 8, offset=first)


def _ends(path: Path) -> tuple[bytes, bytes]:
    with path.open("rb") as file:
        head = file.read(4)
        size = file.seek(0, 2)
        file.seek(max(size - 64, 0))
        return head, file.read()


def _mended(path: Path) -> _Parts:
    """Read what Rerun's own repair makes of a copy."""
    parts = _Parts()
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "mended.rrd"
        command = [sys.executable, "-m", "rerun_cli", "rrd", "merge", "--continue-on-error"]
        command += [str(path), "-o", str(copy)]
        quiet = subprocess.DEVNULL
        if run(command, stdout=quiet, stderr=quiet) != 0 or not copy.exists():
            raise RecordingError(
                path,
                "is damaged beyond what `rerun rrd merge` can mend",
                "copy it again from where it was written",
            )
        try:
            parts.read(copy)
        except (KeyError, ValueError):
            # Rerun's words for a file without a single recording, or without a column, in it
            return _Parts()
    return parts


def _reach(streams: Mapping[str, Series]) -> str:
    stops = [series.time[-1] for series in streams.values() if len(series)]
    if not stops:
        return "no rows"
    first, last = min(stops), max(stops)
    if last - first < 1e-3:
        return f"up to {last:.3f} s"
    return f"its streams up to {first:.3f} s or later, the last to {last:.3f} s"
