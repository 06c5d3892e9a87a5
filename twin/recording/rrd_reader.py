"""Rerun's reader of an `.rrd`, for a process of its own.

Some damaged files end the process that reads them, and nothing can catch that: `read_recording` has
another one read.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.recording.recording import Recording, Series

if TYPE_CHECKING:
    import pyarrow as pa

Array = NDArray[np.float64]

SCHEMA = 2
"""Newest version; a reader refuses a newer one. It counts up when an old reader would misread."""
SINGLE_MACHINE = 1
"""Version of a recording of one machine. One of several has a tree of entities for each, with a
provenance that says of each what that of a single machine says; before, streams had one tree."""

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


class Refusal(NamedTuple):
    """Why a file is not read."""

    problem: str
    """What is wrong with it."""
    remedy: str
    """What would do."""
    machines: tuple[str, ...] = ()
    """Those in it, where none of several was chosen."""


NOTHING = Refusal(
    "holds nothing of a recording that could be used",
    "if it was cut this early, the run has to be repeated; if another program wrote it, export it "
    "as a folder log",
)

MACHINES = "machines"
"""In the facts of a recording of several machines: name -> facts of that machine."""

SHOWN = 8
"""Letters of a recording's name that an error shows."""
_ROW = "rerun.controls.RowId"


class _Refused(Exception):
    """With the fields of a `Refusal`."""


def read_parts(path: Path, name: str, chosen: str, note: str) -> Recording | Refusal | None:
    """What a file holds, or what is wrong with it; None where it cannot be decoded.

    Args:
        path: of the file.
        name: by which its user knows it.
        chosen: the beginning of the recording's name, or the name of a machine in it; empty of a
            file with one.
        note: what is known to be wrong with it; empty of nothing.
    """
    try:
        recording, machine = _chosen(path, name, chosen)
        parts = _Parts(name, machine, fits=bool(recording))
        parts.read(path, recording)
        if not note and not parts.ended:
            note = f"{name} is damaged; what could be decoded is here"
        return parts.recording([note] if note else [])
    except _Refused as refused:
        return Refusal(*refused.args)
    except (RuntimeError, KeyError, ValueError):  # bytes, or what is written in them
        return None


def _chosen(path: Path, name: str, start: str) -> tuple[str, str]:
    """The name of the recording to read, and that of a machine in it, if `start` may be one.

    Either is empty where it does not matter: a file with one recording is read whatever its name.
    """
    from rerun.chunk import RrdReader

    ids = [entry.recording_id for entry in RrdReader(path).recordings()]
    fitting = [one for one in ids if one.startswith(start)]
    if len(ids) < 2:
        return (fitting[0] if fitting else ""), start
    if len(fitting) == 1:
        return fitting[0], ""
    problem = f"holds {len(ids)} recordings" if not start else f"has no recording {start!r}"
    if start and fitting:
        problem = f"has {len(fitting)} recordings that begin {start!r}"
    raise _Refused(problem, _choice_of(name, [one[:SHOWN] for one in ids]))


def _choice_of(name: str, parts: Iterable[str]) -> str:
    return f"name one of {', '.join(f'{name}#{part}' for part in parts)}"


class _Parts:
    """What the chunks of a file have given so far."""

    def __init__(self, name: str, machine: str, *, fits: bool) -> None:
        """Nothing was read; `machine` is the one whose streams are, empty of a file with one, and
        `fits` whether that may also be meant for the recording's own name."""
        self.name, self._machine, self._fits = name, machine, fits
        self.headers: dict[str, tuple[str, tuple[str, ...], str]] = {}
        self.times: dict[str, list[tuple[NDArray[np.uint64], Array]]] = {}
        self.values: dict[str, list[tuple[NDArray[np.uint64], Array]]] = {}
        self.facts: dict[str, Any] | None = None
        self.ended = False
        self.notes: list[str] = []
        """Sentences on what is missing."""

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

    def recording(self, notes: list[str]) -> Recording:
        if self.facts is None:
            raise _Refused(*NOTHING)
        schema = self.facts.get("schema")
        if not isinstance(schema, int) or schema > SCHEMA:
            raise _Refused(
                f"has schema version {schema}, this twin reads up to {SCHEMA}",
                "read it with a newer airbearing-twin",
            )
        tree = self._tree()
        streams = {
            item[0]: self._series(entity)
            for entity, item in self.headers.items()
            if entity.startswith(tree)
        }
        earlier = self.facts.pop("repairs", ())
        reach = _reach(streams)
        repairs = (*earlier, *(f"{note}, {reach}" for note in (*self.notes, *notes)))
        return Recording(streams, self.facts, repairs)

    def _tree(self) -> str:
        """Where the streams of the machine that is read stand; `facts` become those of it."""
        import rerun as rr

        assert self.facts is not None
        machines, chosen = self.facts.pop(MACHINES, None), self._machine
        if machines is None:
            if chosen and not self._fits:
                raise _Refused(f"has no recording {chosen!r}", f"name {self.name}, it holds one")
            return "/"
        if chosen not in machines:
            problem = f"has no machine {chosen!r}" if chosen else "holds several machines"
            raise _Refused(problem, _choice_of(self.name, machines), tuple(machines))
        self.facts |= {**machines[chosen], "name": chosen}
        return f"/{rr.escape_entity_path_part(chosen)}/"

    def _series(self, entity: str) -> Series:
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
                self.notes.append(f"{self.name} lacks the values of {lost} rows of {name}")
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


def _reach(streams: Mapping[str, Series]) -> str:
    stops = [series.time[-1] for series in streams.values() if len(series)]
    if not stops:
        return "no rows"
    first, last = min(stops), max(stops)
    if last - first < 1e-3:
        return f"up to {last:.3f} s"
    return f"its streams up to {first:.3f} s or later, the last to {last:.3f} s"
