"""An `.rrd` of ours -> `Recording`, to the last bit; its names, and the lock of its writer.

Who writes a recording, so that a reader who comes while it is being finished waits for it.

While a run goes on its writer holds a shared lock on the file; once the run has ended, by whatever
end, an exclusive one until the file is complete. Where the system has no such locks (Windows) every
file counts as finished.
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import RecordingError
from twin.processes import run
from twin.recording.recording import Recording, Series

if TYPE_CHECKING:
    import pyarrow as pa


if sys.platform != "win32":
    import fcntl

FINISHING_TIMEOUT = 20.0
"""[s] a reader waits for a file that is being finished."""

_GRACE = 0.5
"""[s] in which a writer notices that the run has ended."""


def mark_running(file: IO[bytes]) -> bool:
    """Hold the shared lock for as long as `file`, or a copy of it in a child process, is open.

    False: somebody else is writing that file.
    """
    if sys.platform != "win32":
        if not _lockable(file, fcntl.LOCK_EX):
            return False
        fcntl.flock(file, fcntl.LOCK_SH)
    return True


def mark_finishing(descriptor: int) -> None:
    """Exchange the shared lock for the exclusive one."""
    if sys.platform != "win32":
        fcntl.flock(descriptor, fcntl.LOCK_EX)


def wait_until_finished(path: Path) -> bool:
    """Wait for a writer that is finishing `path`; False when the recording still goes on."""
    if sys.platform == "win32":
        return True
    started = time.monotonic()
    with path.open("rb") as file:
        while not _lockable(file, fcntl.LOCK_EX):
            waited = time.monotonic() - started
            if waited > FINISHING_TIMEOUT:
                return False
            if waited > _GRACE and _lockable(file, fcntl.LOCK_SH):
                return False
            time.sleep(0.01)
    return True


def _lockable(file: IO[bytes], kind: int) -> bool:
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return True


SCHEMA = 1
"""Version; a reader refuses a newer one. It counts up when an old reader would misread."""

APPLICATION = "airbearing-twin"
TIMELINE = "time"

PROVENANCE = "provenance"
"""Entity that holds the facts about the recording, as JSON text."""
ENDING = "provenance/end"
"""Entity that says how the recording ended, if not well, as JSON text; written last."""

STREAM = "stream"
COLUMNS = "columns"
UNIT = "unit"
"""Header of a stream's entity: its name, its columns' names, their unit."""

TIME = "host_time"
"""Exact times of a stream's rows [s], each the eight bytes of a little-endian float64."""
VALUE = "Scalars:scalars"
"""Rerun's own component of plotted numbers."""
TEXT = "TextDocument:text"
"""Rerun's own component of a text."""


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
        streams = {item[0]: self._series(entity, path) for entity, item in self.headers.items()}
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
    stores = [item for item in reader.recordings() if item.recording_id == recording]
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
