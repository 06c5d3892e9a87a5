"""What the loop hands its ticks to: a file (or viewer), or memory."""

import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from twin.platform import Platform
from twin.recording.recording import Recording
from twin.signals import Tick
from twin.stream.rows import Rows, series
from twin.stream.writer import RecordingWriter

CHUNK = 0.9
"""Rows are handed to the writer after this much recorded time [s]: a file that is cut short lacks
no more than its last second."""

CHUNK_WALL = 0.5
"""Or after this much of the wall's time [s], whichever comes first: what is lost with the loop."""


class FileRecorder:
    """Records one run of the batch into an `.rrd`, a live viewer, or both.

    Construct it early: the writer's process then comes up while the machine is being compiled.
    Nobody may write to the arrays of a tick after it: they are read up to `CHUNK` later.
    """

    def __init__(self, path: str | Path | None, *, viewer: bool = False, run: int = 0) -> None:
        """Start the writer; a file that exists is written over only by `start`.

        Raises:
            RecordingError: the file cannot be written.
        """
        self._writer = RecordingWriter(path, viewer=viewer)
        self._run = run
        self._rows: Rows | None = None
        self._ticks: list[Tick] = []
        self._declared = 0
        self._sent = 0.0
        self._sent_wall = 0.0

    def start(
        self, platform: Platform, provenance: Mapping[str, Any], *, remarks: bool = False
    ) -> None:
        """Say what is recorded, before the first tick; `remarks`: that `say` will be called."""
        self._writer.start(platform, provenance, remarks=remarks)
        self._rows = Rows(platform, self._run)
        self._sent_wall = time.monotonic()

    def collect(self, tick: Tick) -> None:
        """One tick.

        Raises:
            RecordingError: the writer has failed.
        """
        self._ticks.append(tick)
        wall = time.monotonic()
        if tick.reading.time - self._sent >= CHUNK or wall - self._sent_wall >= CHUNK_WALL:
            self._sent, self._sent_wall = tick.reading.time, wall
            self._send()

    def say(self, time: float, words: str) -> None:
        """Words that the viewer shows beside a moment [s]; they are no data, and not read back.

        Raises:
            RecordingError: the writer has failed.
        """
        self._writer.say(time, words)

    def close(self) -> None:
        """Send what is left, and return when the file is complete.

        Raises:
            RecordingError: it is not.
        """
        if self._ticks:
            self._send()
        self._writer.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _send(self) -> None:
        if self._rows is None:
            raise RuntimeError("start() comes before the first tick")
        ticks, self._ticks = self._ticks, []
        blocks = self._rows.of(ticks)
        if len(self._rows.headers) > self._declared:
            self._declared = len(self._rows.headers)
            self._writer.declare(self._rows.headers)
        self._writer.write(blocks)


class MemoryRecorder:
    """Keeps every run of the batch; `recording(run)` gives one of them.

    Nobody may write to the arrays of a tick after it: they are kept as they are.
    """

    def __init__(self, platform: Platform, provenance: Mapping[str, Any] | None = None) -> None:
        self._platform = platform
        self._provenance = dict(provenance or {})
        self._ticks: list[Tick] = []

    def collect(self, tick: Tick) -> None:
        """One tick."""
        self._ticks.append(tick)

    def recording(self, run: int = 0) -> Recording:
        """What a file of that run would hold."""
        rows = Rows(self._platform, run)
        blocks = rows.of(self._ticks)
        streams = {name: series(rows.headers[name], block) for name, block in blocks.items()}
        return Recording(streams, self._provenance)
