"""Where the loop hands its ticks to: a file (or viewer) by a writer's process, or memory.

The loop's end of a recording: hands rows to a process of its own, and never waits.
The process at the other end of the pipe (`twin.stream.child`) writes the file. It shares neither
interpreter lock nor terminal with the loop: whatever becomes of the loop, all that has reached the
pipe is written and the file is closed.
"""

import contextlib
import logging
import os
import pickle
import select
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import IO, Any, Self

from twin.errors import RecordingError
from twin.loop import Observer
from twin.plant.plant import Plant
from twin.platform import Platform
from twin.recording.read import mark_running
from twin.recording.recording import Recording
from twin.signals import Tick
from twin.stream.rows import Block, Header, Placed, StreamRows, series

READY_TIMEOUT = 60.0
"""[s] for the process to come up; it takes one, most of which passes while a machine compiles."""

CLOSE_TIMEOUT = 120.0
"""[s] for the process to write what is left; it is seldom a second behind."""

_PIPE_SIZE = 1 << 20
"""Bytes: some 40 s of a usual run, should the process be held up; the rest waits on our side."""

_THREADED = sys.platform == "win32"
"""Pipes there can neither be polled nor written without waiting: a thread does the waiting."""

_LENGTH = struct.Struct("<Q")


class RecordingWriter:
    """Writes one `.rrd`, or feeds a live viewer, or both, in another process."""

    def __init__(self, path: str | Path | None, *, viewer: bool = False) -> None:
        """Start the process; a file that exists is written over only by `start`.

        Raises:
            RecordingError: the file cannot be written.
        """
        self._path = None if path is None else Path(path)
        self._litter = self._path is not None and not self._path.exists()
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - what the process says
        try:
            self._process = self._start_process(viewer)
        except BaseException:
            self._words.close()
            raise
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        self._backlog: deque[memoryview] = deque()
        self._feed: _Feed | None = None
        if _THREADED:
            self._feed = _Feed(self._pipe)
        else:
            os.set_blocking(self._pipe, False)
        self._closed = False

    def start(
        self,
        machines: Platform | Mapping[str, Placed],
        provenance: Mapping[str, Any],
        *,
        remarks: bool = False,
    ) -> None:
        """Say what is recorded; returns when the process is ready for rows.

        Args:
            machines: the machine, or several by their names.
            provenance: where the recording comes from; JSON-able.
            remarks: whether `say` will be called: they are given a place in view.

        Raises:
            RecordingError: it has ended, or does not come up.
        """
        self._send("start", machines, dict(provenance), remarks)
        ready = self._process.stdout
        assert ready is not None
        if not _readable(ready, READY_TIMEOUT):
            raise RecordingError(
                self._name,
                f"the process that writes it is not ready after {READY_TIMEOUT:.0f} s",
                "is the computer overloaded, or the disk stuck?",
            )
        if not ready.read(1):
            raise self._failure()

    def declare(self, headers: Mapping[str, Header], machine: str = "") -> None:
        """Say what streams are, before their first rows; repetition does no harm."""
        self._send("declare", dict(headers), machine)

    def write(self, blocks: Mapping[str, Block], machine: str = "") -> None:
        """Hand over rows, of several machines those of one; returns at once.

        Raises:
            RecordingError: the process has ended.
        """
        self._litter = False
        # plain tuples: pickling the class beside each would take three times as long
        self._send("rows", {name: tuple(block) for name, block in blocks.items()}, machine)

    def say(self, time: float, words: str) -> None:
        """Hand over what is said of a moment [s]; returns at once.

        Raises:
            RecordingError: the process has ended.
        """
        self._send("said", time, words)

    def close(self) -> None:
        """Return when the file is complete.

        Raises:
            RecordingError: the process has failed, or has not finished in time.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._finish(time.monotonic() + CLOSE_TIMEOUT)
        finally:
            self._words.close()
            if self._process.stdout is not None:
                self._process.stdout.close()
        if self._litter and self._path is not None:
            self._path.unlink(missing_ok=True)

    def _finish(self, deadline: float) -> None:
        """Have the file completed until then; raises as `close`."""
        try:
            self._send("close")
            if self._feed is not None:
                self._feed.finish(deadline - time.monotonic())
            while self._backlog and time.monotonic() < deadline:
                select.select([], [self._pipe], [], 1.0)
                self._pump()
        finally:
            assert self._process.stdin is not None
            self._process.stdin.close()
        try:
            code = self._process.wait(max(deadline - time.monotonic(), 0.0))
        except subprocess.TimeoutExpired:
            raise RecordingError(
                self._name,
                f"is not complete {CLOSE_TIMEOUT:.0f} s after the run's end",
                "is the disk full, or very slow? The writer goes on until it is done",
            ) from None
        if code != 0:
            raise self._failure()
        for remark in self._said():
            logging.getLogger(__name__).warning(remark)

    def _send(self, *message: Any) -> None:
        payload = pickle.dumps(message, protocol=5)
        self._backlog.append(memoryview(_LENGTH.pack(len(payload)) + payload))
        self._pump()

    def _pump(self) -> None:
        """Write as much as the pipe takes."""
        if self._feed is not None:
            if self._feed.broken:
                raise self._failure()
            while self._backlog:
                self._feed.put(self._backlog.popleft())
            return
        try:
            while self._backlog:
                piece = self._backlog[0]
                written = os.write(self._pipe, piece)
                if written < len(piece):
                    self._backlog[0] = piece[written:]
                else:
                    self._backlog.popleft()
        except BlockingIOError:
            pass
        except BrokenPipeError:
            self._backlog.clear()
            raise self._failure() from None

    @property
    def _name(self) -> str | Path:
        return self._path or "the Rerun viewer"

    def _start_process(self, viewer: bool) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-P", "-m", "twin.stream.child"]
        command += ["--viewer"] if viewer else []
        if self._path is None:
            return self._popen(command, ())
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            file = self._path.open("ab")
        except OSError as problem:
            raise RecordingError(
                self._path, f"cannot be written: {problem.strerror}", "choose another place"
            ) from None
        with file:
            if not mark_running(file):
                raise RecordingError(
                    self._path,
                    "is being written by another run",
                    "wait until that has ended, or record into another file",
                )
            command += ["--file", str(self._path.resolve()), "--lock", str(file.fileno())]
            return self._popen(command, (file.fileno(),))

    def _popen(self, command: list[str], keep: tuple[int, ...]) -> "subprocess.Popen[bytes]":
        package = str(Path(__file__).parents[2])
        search = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._words,
            # Rerun's log is for its developers; what goes wrong it raises.
            env=os.environ | {"PYTHONPATH": os.pathsep.join(search), "RUST_LOG": "off"},
            pass_fds=keep if sys.platform != "win32" else (),
            start_new_session=True,  # Ctrl-C is for the loop
            pipesize=_PIPE_SIZE,
        )

    def _failure(self) -> RecordingError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5.0)
        words = self._said()
        last = words[-1] if words else f"exit code {self._process.returncode}, was it killed?"
        return RecordingError(
            self._name,
            f"the process that writes it has ended ({last})",
            "what it had written so far can be read; free the disk, or record elsewhere",
        )

    def _said(self) -> list[str]:
        self._words.seek(0)
        return self._words.read().decode(errors="replace").strip().splitlines()


class _Feed:
    """A thread that writes to a pipe and waits for it in the loop's place."""

    def __init__(self, pipe: int) -> None:
        self.broken = False
        self._pieces = SimpleQueue[memoryview | None]()
        self._thread = threading.Thread(target=self._write, args=(pipe,), daemon=True)
        self._thread.start()

    def put(self, piece: memoryview) -> None:
        """Have it written after those before."""
        self._pieces.put(piece)

    def finish(self, seconds: float) -> None:
        """Wait so long at most [s] until all is written."""
        self._pieces.put(None)
        self._thread.join(max(seconds, 0.0))

    def _write(self, pipe: int) -> None:
        while (piece := self._pieces.get()) is not None:
            try:
                while piece:
                    piece = piece[os.write(pipe, piece) :]
            except OSError:
                self.broken = True
                return


def _readable(pipe: IO[bytes], seconds: float) -> bool:
    """Whether a pipe has a byte, or is closed, within so many seconds."""
    if not _THREADED:
        return bool(select.select([pipe], [], [], seconds)[0])
    peeked = threading.Thread(target=lambda: pipe.peek(1), daemon=True)  # pyright: ignore[reportAttributeAccessIssue]
    peeked.start()
    peeked.join(seconds)
    return not peeked.is_alive()


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
        self._trees: dict[str, _MachineRows] = {}

    def start(
        self, platform: Platform, provenance: Mapping[str, Any], *, remarks: bool = False
    ) -> None:
        """Say what is recorded, before the first tick; `remarks`: that `say` will be called."""
        self._writer.start(platform, provenance, remarks=remarks)
        self._trees = {"": _MachineRows(self._writer, platform, self._run)}

    def start_several(
        self, machines: Mapping[str, Placed], provenance: Mapping[str, Any]
    ) -> dict[str, Observer]:
        """Say which machines are recorded, before the first tick; the observer of each."""
        self._writer.start(machines, provenance)
        self._trees = {
            name: _MachineRows(self._writer, placed.platform, self._run, name)
            for name, placed in machines.items()
            if placed.platform is not None
        }
        return dict(self._trees)

    def collect(self, tick: Tick) -> None:
        """One tick of a single machine.

        Raises:
            RecordingError: the writer has failed.
        """
        if not self._trees:
            raise RuntimeError("start() comes before the first tick")
        self._trees[""].collect(tick)

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
        for rows in self._trees.values():
            rows.send()
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


class _MachineRows:
    """Observer that hands the ticks of one machine to the writer, chunk by chunk."""

    def __init__(
        self, writer: RecordingWriter, platform: Platform, run: int, name: str = ""
    ) -> None:
        self._writer, self._name = writer, name
        self._rows = StreamRows(platform, run)
        self._ticks: list[Tick] = []
        self._declared = 0
        self._sent = 0.0
        self._sent_wall = time.monotonic()

    def collect(self, tick: Tick) -> None:
        """One tick."""
        self._ticks.append(tick)
        wall = time.monotonic()
        if tick.reading.time - self._sent >= CHUNK or wall - self._sent_wall >= CHUNK_WALL:
            self._sent, self._sent_wall = tick.reading.time, wall
            self.send()

    def send(self) -> None:
        """What has come since the last chunk."""
        if not self._ticks:
            return
        ticks, self._ticks = self._ticks, []
        blocks = self._rows.of(ticks)
        if len(self._rows.headers) > self._declared:
            self._declared = len(self._rows.headers)
            self._writer.declare(self._rows.headers, self._name)
        self._writer.write(blocks, self._name)


class Recorded:
    """A recorder that is closed in the end. A recording that cannot be completed then is no error
    of the flight, which has its report: `problem` has it.

    Raises:
        RecordingError: the file cannot be begun.
    """

    def __init__(self, path: Path | None, *, viewer: bool) -> None:
        self.recorder = FileRecorder(path, viewer=viewer)
        self.problem: RecordingError | None = None

    def __enter__(self) -> Self:
        self.recorder.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *ended: Any) -> None:
        try:
            self.recorder.__exit__(kind, *ended)
        except RecordingError as problem:
            if kind is not None:
                raise
            self.problem = problem


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
        rows = StreamRows(self._platform, run)
        blocks = rows.of(self._ticks)
        streams = {name: series(rows.headers[name], block) for name, block in blocks.items()}
        return Recording(streams, self._provenance)


SECONDS = 2.0
"""How far back a flight record reaches."""


class FlightRecorder:
    """Observer of a loop that keeps a record of each run of the batch that ends early.

    It holds references to the last ticks' arrays, so that watching a thousand runs costs no copy.
    """

    def __init__(self, plant: Plant) -> None:
        self.records: dict[int, Recording] = {}
        """Row of the batch -> its last seconds; the reason is in the provenance."""
        self._plant = plant
        ticks = round(SECONDS * plant.platform.control_rate) + 1
        self._last: deque[Tick] = deque(maxlen=max(ticks, 2))

    def collect(self, tick: Tick) -> None:
        """One tick."""
        self._last.append(tick)
        if len(self._plant.stopped) > len(self.records):
            for run in self._plant.stopped.keys() - self.records.keys():
                self.records[run] = self._record(run)

    def keep(self, reason: str) -> None:
        """Record a run that no plant has stopped; of one that has not begun there is nothing."""
        if self._last and not self.records:
            self.records[0] = self._record(0, reason)

    def _record(self, run: int, reason: str = "") -> Recording:
        platform = self._plant.platform
        reason = reason or self._plant.stopped[run]
        facts = {"platform": platform.name, "run": run, "reason": reason}
        memory = MemoryRecorder(platform, facts)
        for tick in self._last:
            memory.collect(tick)
        return memory.recording(run)
