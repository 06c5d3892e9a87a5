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


def read_recording(path: str | Path) -> Recording:
    """Read a recording.

    Rows come in the order of their times, those of one time as they were written.
    A file that was never closed, or was cut anywhere, is read as far as it is whole, and `repairs`
    says so; the file itself stays as it is.

    Raises:
        RecordingError: no such file, not a recording of ours, of a newer schema, or nothing in it.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(path, "there is no such recording", "check the path")
    ended = wait_until_finished(path)
    head, tail = _ends(path)
    if head and not head.startswith(_MAGIC):
        raise RecordingError(path, "is no Rerun recording", "name an .rrd, or a folder log")
    parts = _Parts()
    if _CLOSED in tail:
        try:
            parts.read(path)
        except RuntimeError:
            parts = _mended(path)
            parts.ended = False
        if not parts.ended:
            parts.notes.append(f"{path.name} is damaged; what could be decoded is here")
    else:
        parts = _mended(path)
        how = "was cut short, or never closed" if ended else "is still being written"
        parts.notes.append(f"{path.name} {how}; what is whole is here")
    return parts.recording(path)


class _Parts:
    """What the chunks of a file have given so far."""

    def __init__(self) -> None:
        self.headers: dict[str, tuple[str, tuple[str, ...], str]] = {}
        self.rows: dict[str, list[tuple[NDArray[np.uint64], Array, Array]]] = {}
        self.facts: dict[str, Any] | None = None
        self.ended = False
        self.notes: list[str] = []

    def read(self, path: Path) -> None:
        for entity, batch in _batches(path):
            names = batch.schema.names
            if entity == f"/{PROVENANCE}":
                self.facts = json.loads(_first(batch, TEXT)[0])
            elif entity == f"/{ENDING}":
                self.ended = True
                self.notes += filter(None, [json.loads(_first(batch, TEXT)[0])])
            elif STREAM in names:
                (stream,), columns = _first(batch, STREAM), _first(batch, COLUMNS)
                self.headers[entity] = stream, tuple(columns), _first(batch, UNIT)[0]
            elif TIME in names:
                self.rows.setdefault(entity, []).append(
                    (_row_ids(batch), _times(batch), _values(batch))
                )

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
        streams = {header[0]: self._series(entity) for entity, header in self.headers.items()}
        earlier = self.facts.pop("repairs", ())
        reach = _reach(streams)
        repairs = (*earlier, *(f"{note}, {reach}" for note in self.notes))
        return Recording(streams, self.facts, repairs)

    def _series(self, entity: str) -> Series:
        _, columns, unit = self.headers[entity]
        pieces = self.rows.get(entity, [])
        if not pieces:
            return Series(np.empty(0), np.empty((0, len(columns))), columns, unit)
        order, time, value = (np.concatenate(part) for part in zip(*pieces, strict=True))
        value = value.reshape(-1, len(columns))
        # Rerun sorts inside a chunk; between equal times its row ids count up as written.
        rank = np.lexsort((order[:, 1], order[:, 0], time))
        return Series(time[rank], value[rank], columns, unit)


def _batches(path: Path) -> "Iterator[tuple[str, pa.RecordBatch]]":
    from rerun.chunk import RrdReader

    for chunk in RrdReader(path).stream():
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
        except ValueError:
            # Rerun's word for a file without a single recording in it
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
