"""Our layout of an `.rrd`: one entity a stream, its exact times beside it, facts as JSON.

Scalars carry the values as float64. Rerun's own timeline counts whole nanoseconds, so the times are
a column of float64 too. What is drawn only (`plots/`, `world/`) has no header and is not read back.
"""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from twin.errors import RecordingError
from twin.recording.rrd_reader import (
    APPLICATION,
    COLUMNS,
    ENDING,
    PROVENANCE,
    STREAM,
    TIME,
    TIMELINE,
    UNIT,
)

Array = NDArray[np.float64]

ROWS_PER_CHUNK = 16384
"""What the viewer loads in one piece; longer blocks are split."""

PALETTE = ((214, 69, 65), (61, 153, 112), (52, 109, 219), (230, 150, 30), (130, 90, 200))
"""Colours of a stream's columns, in order: x red, y green, z blue."""

_LATEST = 9.2e18
"""Nanoseconds that a timeline can hold; a time beyond is drawn there."""

_SCALARS = next(iter(rr.Scalars.columns(scalars=[0.0]))).component_descriptor()
_TIME = rr.ComponentDescriptor(TIME)


LOOPBACK = "127.0.0.1"
"""The viewer listens here; left to itself it would on all of the computer's addresses, and take
what anybody in the network sends."""

VIEWER_PORT = 9876
"""Rerun's own."""

_COMES = 20.0
"""A viewer has so long to come up [s]."""


def open_viewer() -> None:
    """Start Rerun's viewer unless one listens, and wait until it does.

    Raises:
        RuntimeError: it is not there, or has ended.
    """
    if _listens():
        return
    beside = Path(sys.executable).with_name("rerun")
    command = [str(beside) if beside.exists() else "rerun", *viewer_arguments()]
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"RERUN_APP_ONLY": "true"},
            start_new_session=True,  # it stays when the run is over
        )
    except OSError as problem:
        raise RuntimeError(f"{command[0]}: {problem.strerror}") from None
    end = time.monotonic() + _COMES
    while not _listens():
        if process.poll() is not None:
            raise RuntimeError(f"it has ended with code {process.returncode}")
        if time.monotonic() > end:
            raise RuntimeError(f"it did not come up within {_COMES:g} s")
        time.sleep(0.05)


def viewer_arguments() -> list[str]:
    """Of the viewer's command line."""
    return [f"--bind={LOOPBACK}", f"--port={VIEWER_PORT}", "--hide-welcome-screen",
            "--memory-limit=75%", "--expect-data-soon"]  # fmt: skip


def _listens() -> bool:
    with socket.socket() as line:
        return line.connect_ex((LOOPBACK, VIEWER_PORT)) == 0


class RrdFile:
    """Writes streams into a file, or into a live viewer."""

    def __init__(self, path: Path | None) -> None:
        """Open the file (written over if it exists); without a path, a viewer.

        Raises:
            RecordingError: the file cannot be written, or no viewer can be started.
        """
        self.rerun = rr.RecordingStream(APPLICATION)
        try:
            if path is not None:
                self.rerun.save(path)
            else:
                open_viewer()
                self.rerun.connect_grpc(f"rerun+http://{LOOPBACK}:{VIEWER_PORT}/proxy")
        except RuntimeError as problem:
            reason = str(problem).strip().splitlines()[0]
            remedy = "is the disk full?" if path else "is there a display, and `rerun` on the path?"
            raise RecordingError(
                path or "the Rerun viewer", f"cannot be opened: {reason}", remedy
            ) from None

    def provenance(self, facts: Mapping[str, Any]) -> None:
        """Where the recording comes from; JSON-able."""
        self._note(PROVENANCE, facts)

    def declare(self, stream: str, columns: Iterable[str], unit: str, tree: str = "") -> None:
        """Say what a stream's columns are, before its first rows; `tree` is its machine's."""
        names = list(columns)
        path = tree + entity(stream)
        header: dict[str, Any] = {STREAM: stream, COLUMNS: names, UNIT: unit}
        self.rerun.log(path, rr.AnyValues(**header), static=True, strict=True)
        colors = [PALETTE[i % len(PALETTE)] for i in range(len(names))]
        style = rr.SeriesLines(names=names, colors=colors)
        self.rerun.log(path, style, static=True, strict=True)
        self.rerun.flush()  # what is logged is batched; chunks would overtake it

    def write(self, rows: Mapping[str, tuple[Array, Array]], tree: str = "") -> None:
        """Append rows, by stream: times (m,) [s] and values (m, k); of a machine's `tree`."""
        self.send(
            chunk
            for stream, (time, value) in rows.items()
            for chunk in scalars(tree + entity(stream), time, value, exact=True)
        )

    def send(self, chunks: Iterable[Chunk]) -> None:
        """Append anything else that is to be seen."""
        rr.send_chunks(chunks, recording=self.rerun)

    def say(self, path: str, time: float, words: str) -> None:
        """Append words that are to be seen at a moment [s]."""
        columns = rr.TextLog.columns(text=[words])
        self.rerun.send_columns(path, indexes=[timeline(np.array([time]))], columns=columns)

    def flush(self) -> None:
        """Return when all that was written is in the file."""
        self.rerun.flush()

    def close(self, ending: str = "") -> None:
        """Write the end of the recording and the file's index.

        `ending` is a sentence for readers where a recording did not end well.
        """
        self._note(ENDING, ending)
        self.rerun.disconnect()

    def _note(self, path: str, facts: object) -> None:
        text = json.dumps(facts, indent=2, ensure_ascii=False)
        self.rerun.log(path, rr.TextDocument(text), static=True, strict=True)
        self.rerun.flush()


def tree_of(machine: str) -> str:
    """Path above the entities of a machine in a recording of several; empty of a single one."""
    return f"{rr.escape_entity_path_part(machine)}/" if machine else ""


def entity(stream: str) -> str:
    """Entity path of a stream; a name with odd characters is escaped."""
    return rr.escape_entity_path_part(stream)


def timeline(time: Array) -> rr.TimeColumn:
    """Times [s] as whole nanoseconds of the viewer's timeline."""
    with np.errstate(over="ignore"):
        nanoseconds = np.clip(np.nan_to_num(time) * 1e9, -_LATEST, _LATEST)
    return rr.TimeColumn(TIMELINE, duration=np.rint(nanoseconds).astype("timedelta64[ns]"))


class _Exact:
    """float64 times as eight bytes each: numbers would appear in every plot of their stream."""

    def __init__(self, time: Array) -> None:
        self._time = np.ascontiguousarray(time, dtype="<f8")

    def as_arrow_array(self) -> pa.FixedSizeBinaryArray:
        data = pa.py_buffer(self._time)
        return pa.FixedSizeBinaryArray.from_buffers(pa.binary(8), len(self._time), [None, data])


def scalars(path: str, time: Array, value: Array, *, exact: bool = False) -> list[Chunk]:
    """Chunks of k scalars a row; `exact` adds the times as float64."""
    chunks: list[Chunk] = []
    width = value.shape[1]
    for first in range(0, len(time), ROWS_PER_CHUNK):
        part = slice(first, first + ROWS_PER_CHUNK)
        stamp = time[part]
        rows = np.arange(len(stamp) + 1, dtype=np.int32)
        batch = rr.components.ScalarBatch(np.ascontiguousarray(value[part]).ravel())
        columns = [rr.ComponentColumn(_SCALARS, batch, offsets=rows * width)]
        if exact:
            columns.append(rr.ComponentColumn(_TIME, _Exact(stamp), offsets=rows))
        chunks.append(Chunk.from_columns(path, indexes=[timeline(stamp)], columns=columns))
    return chunks
