"""A session with the MDrive stages of one line: bounded moves, read back, hold as the safe state.

A drive has no watchdog: what it was told last it does to the end. So it is only ever given absolute
moves of at most VM x 0.25 s, and never a slew. Truth is the counter, a whole number of microsteps.
"""

import math
import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np

from twin.errors import CommandError, DeviceError, UsageError
from twin.plant.devices.device import (
    Counters,
    Device,
    DeviceCommand,
    DeviceSettings,
    Sample,
    missing,
)
from twin.plant.devices.mdrive.line import Line, Mode
from twin.plant.devices.mdrive.settings import DriveSettings
from twin.plant.devices.mdrive.setup import CONFIGURED, HOMED, recognise, seek_home, set_up
from twin.plant.devices.mdrive.tracker import Look, Tracker
from twin.plant.devices.port import Port
from twin.plant.devices.worker import SampleQueue, Worker

_STREAM, _COMMAND = "stage_position", "command_stage_position"
_MISSES = 3
"""Answers missing one after the other, until a drive counts as silent."""
_SILENT = 2.0
"""A silent drive is asked again after that long [s], so that the others are not kept waiting."""


@dataclass(frozen=True, kw_only=True)
class MDriveSettings(DeviceSettings):
    """MDrive stages on one RS-422 or RS-485 line."""

    drives: tuple[DriveSettings, ...]
    baud: int = 9600
    """As saved in the drives (BD); all drives of a line share it."""
    checksum: bool = True
    """CK=1; otherwise each position is printed twice and both must agree."""
    echo_mode: int = 1
    """EM, 0 to 3: what the drives are set to. 1 acknowledges every command."""
    mark: str = "R1"
    """User register of the drives that tells a power cycle; no program of theirs may use it."""

    def __post_init__(self) -> None:
        """Hold the parts against each other.

        Raises:
            UsageError: no drive, or two of one name.
        """
        names = [drive.address for drive in self.drives]
        if not names or len(set(names)) < len(names):
            raise UsageError(f"{self.name}: drives {names}; give each its own address")
        if self.echo_mode not in range(4):
            raise UsageError(f"{self.name}: echo mode {self.echo_mode}; an MDrive has 0 to 3")

    def session(self) -> "MDrive":
        """A session with these drives, not yet connected."""
        return MDrive(self)


class MDrive(Device):
    """The stages of one line. A sample is of one stage, named by its part."""

    def __init__(self, settings: MDriveSettings) -> None:
        self.settings = settings
        self.name = settings.name
        self.streams = {_STREAM: len(settings.drives)}
        self.commands = {_COMMAND: len(settings.drives)}
        self.counters = Counters()
        self.notes = deque[str](maxlen=100)
        self.fault = ""
        self.armed = False
        self.stages = [Tracker(drive) for drive in settings.drives]
        self._modes = [Mode() for _ in settings.drives]
        self._silent_until = [0.0 for _ in settings.drives]
        self._misses = [0 for _ in settings.drives]
        self._queue = SampleQueue(self.counters)
        self._port: Port | None = None
        self._line: Line | None = None
        self._worker: Worker | None = None
        self._lock = threading.Lock()
        self._stop, self._stopped = threading.Event(), threading.Event()
        self._turn = 0
        self._items = ["P", "MV", "EF", settings.mark] + ([] if settings.checksum else ["P"])

    def connect(self) -> None:
        if self._line is not None and not self.fault:
            return
        self.close()
        self.fault = ""
        self._port = Port(self.name, self.settings.port, baud=self.settings.baud)
        self._line = Line(self._port, self.counters)
        for drive in self.settings.drives:
            if recognise(self._line, drive.address) is None:
                self.close()
                raise DeviceError(
                    f"{self.name}: drive {drive.address}",
                    f"does not answer on {self.settings.port}",
                    "check power, wiring, name (DN), party mode (PY=1) and baud (BD)",
                )

    def configure(self) -> None:
        self.connect()
        self.disarm()
        self._end_worker()
        assert self._line is not None
        wanted = Mode(self.settings.echo_mode, self.settings.checksum)
        for k, drive in enumerate(self.settings.drives):
            if self.stages[k].lost:
                self._forget_home(k)
            mode, position, homed, errors = set_up(
                self.name, self._line, drive, self.settings.mark, wanted
            )
            self._modes[k] = mode
            stage = self.stages[k] = Tracker(drive)
            stage.rest(position)
            stage.homed = homed
            for error in errors:
                stage.complain(error)
            self._collect_notes(stage)
        self.identity = ", ".join(
            f"drive {stage.settings.address} of {stage.settings.part}"
            f"{'' if stage.homed else ' (not homed)'}"
            for stage in self.stages
        )
        self._start_worker()

    def home(self, captured: bool) -> None:
        """Run every stage to its home switch and count from there; takes seconds.

        Args:
            captured: The table cannot move: air off, or clamped, and somebody has looked.

        Raises:
            DeviceError: not captured, not configured, or a drive that finds no home.
        """
        if not captured:
            raise DeviceError(
                self.name,
                "homing runs a stage over its whole travel and would throw a floating table",
                "capture the table first",
            )
        if self._line is None or self._worker is None:
            raise DeviceError(self.name, "is not configured", "configure it before homing")
        self.disarm()
        self._end_worker()
        try:
            for k, stage in enumerate(self.stages):
                stage.homed, stage.lost = False, ""
                mark, drive = self.settings.mark, stage.settings
                stage.rest(seek_home(self.name, self._line, drive, mark, self._modes[k]))
                stage.homed = True
        finally:
            self._queue.take()
            self._start_worker()

    def arm(self) -> None:
        self._refuse_if_unfit()
        if self._worker is None:
            raise DeviceError(self.name, "is not configured", "configure it before arming")
        self._stop.clear()
        self.armed = True

    def read(self) -> list[Sample]:
        return self._queue.take()

    def write(self, command: DeviceCommand) -> DeviceCommand:
        for stream, value in command.items():
            if stream != _COMMAND:
                raise CommandError(f"{self.name} takes no {stream}, only {_COMMAND}")
            if np.shape(value) != (len(self.stages),) or not np.all(np.isfinite(value)):
                raise CommandError(
                    f"{self.name}: {_COMMAND} {np.array(value).tolist()}; "
                    f"give {len(self.stages)} finite numbers"
                )
        if not self.armed:
            raise DeviceError(self.name, "is not armed", "arm it before commanding it")
        self._refuse_if_unfit()
        if _COMMAND not in command:
            return {}
        applied = np.empty(len(self.stages))
        now = time.monotonic()
        with self._lock:
            for k, stage in enumerate(self.stages):
                target = stage.allow(stage.settings.steps(float(command[_COMMAND][k])))
                stage.want(target, now)
                applied[k] = stage.settings.metres(target)
        return {_COMMAND: applied}

    def safe_stop(self, floating: bool) -> None:
        """Stop on the ramp (SL 0) and hold, floating or not: no stage may slide or fall."""
        self.armed = False
        self._stopped.clear()
        self._stop.set()

    def disarm(self) -> None:
        self.armed = False
        with self._lock:
            for stage in self.stages:
                stage.drop()

    def close(self) -> None:
        if self._worker is not None and self._worker.alive:
            self.safe_stop(floating=True)
            self._stopped.wait(2.0)
        self._end_worker()
        if self._port is not None:
            self._port.close()
        self._port = self._line = None

    def unfit(self) -> str:
        try:
            self._refuse_if_unfit()
        except DeviceError as refusal:
            return str(refusal)
        return ""

    def _refuse_if_unfit(self) -> None:
        if self.fault:
            raise DeviceError(self.name, self.fault, "connect anew")
        for stage in self.stages:
            if stage.lost:
                raise DeviceError(self.name, stage.lost, "no stage moves until then")
            if not stage.homed:
                raise DeviceError(self.name, f"{stage.name} is not homed", "home it when captured")

    def _work(self) -> None:
        assert self._line is not None
        if self._stop.is_set() and not self._stopped.is_set():
            for stage, mode in zip(self.stages, self._modes, strict=True):
                with self._lock:
                    stage.drop()
                    stage.stopping = True
                self._line.tell(stage.settings.address, "SL 0", mode)
            self._stopped.set()
        self._turn = (self._turn + 1) % len(self.stages)
        now = time.monotonic()
        if now < self._silent_until[self._turn]:
            time.sleep(0.005)
            return
        self._serve(self._turn)

    def _serve(self, k: int) -> None:
        """Look at one stage, say what is known of it, and give it its order."""
        assert self._line is not None
        stage, mode = self.stages[k], self._modes[k]
        address = stage.settings.address
        reason = self._look(k)
        now = self._line.heard
        if reason and not stage.lost and not self._misses[k]:
            # once more, at once: a corrupt answer must not cost a sample
            reason = self._look(k)
        if stage.doubted:
            self._line.tell(address, "SL 0", mode)
        if stage.lost:
            self._forget_home(k)
            self._leave(k)
        self._collect_notes(stage)
        if not reason and not stage.homed:
            reason = f"{stage.name}: is not homed"
        part, latency = stage.settings.part, self._line.wire
        if reason:
            self._queue.put(missing(_STREAM, 1, now, f"{self.name}: {reason}", part))
            return
        value = (stage.settings.metres(stage.position),)
        self._queue.put(Sample(_STREAM, value, now, latency=latency, part=part))
        with self._lock:
            order = stage.order(time.monotonic()) if self.armed else None
        if order is not None:
            self._line.tell(address, f"MA {order}", mode)
            stage.moved_off()

    def _look(self, k: int) -> str:
        """Ask one drive; why the answer cannot be believed, or nothing."""
        assert self._line is not None
        stage, mode, mark = self.stages[k], self._modes[k], self.settings.mark
        answer = self._line.ask(stage.settings.address, self._items, mode, tries=2)
        if answer is None or len(answer) != len(self._items):
            return self._silence(k)
        self._misses[k] = 0
        if stage.lost:
            return stage.lost
        if answer[3] != (HOMED if stage.homed else CONFIGURED):
            return stage.doubt(
                f"{stage.name}: {mark} is {answer[3]}, as if it had started anew",
                f"{stage.name}: has started anew ({mark} is {answer[3]}), its position is lost; "
                "capture the table, configure and home it again",
            )
        position, moving, failing = answer[:3]
        apart = abs(answer[-1] - position)
        if not self.settings.checksum and apart > self._apart(stage, moving or stage.moving):
            return f"{stage.name}: two readings disagree, {position} and {answer[-1]}"
        if failing:
            # reading clears it: asked again, a drive whose answer was lost would say 0
            code = self._line.ask(stage.settings.address, ["ER"], mode, tries=1)
            if unsure := stage.hear_error(code[0] if code else None):
                return unsure
        elif stage.unread:
            return stage.lose_error()
        with self._lock:
            return stage.lost or stage.look(Look(position, bool(moving), self._line.heard))

    def _silence(self, k: int) -> str:
        """A drive did not answer; one that does not for long may have started anew."""
        assert self._line is not None
        stage = self.stages[k]
        self._misses[k] += 1
        if self._misses[k] < _MISSES:
            return f"{stage.name}: no answer that can be trusted"
        self._leave(k)
        self._line.activate()
        saved = Mode(checked=False)
        woken = self._line.ask(stage.settings.address, ["EM"], saved, tries=1)
        if woken is not None and self.settings.checksum:
            stage.lost = (
                f"{stage.name}: has started anew, its position is lost; "
                "capture the table, configure and home it again"
            )
        return stage.lost or f"{stage.name}: does not answer"

    def _forget_home(self, k: int) -> None:
        """The drive itself must not say to a later session that it is homed."""
        assert self._line is not None
        address, mode = self.stages[k].settings.address, self._modes[k]
        self._line.tell(address, f"{self.settings.mark}={CONFIGURED}", mode)

    def _leave(self, k: int) -> None:
        """Ask the others first."""
        self._silent_until[k] = time.monotonic() + (_SILENT if len(self.stages) > 1 else 0.0)

    def _apart(self, stage: Tracker, moving: int | bool) -> int:
        """How far a stage can go between two numbers of one answer [microsteps]."""
        return math.ceil(0.02 * stage.settings.rate(stage.settings.speed)) if moving else 0

    def _collect_notes(self, stage: Tracker) -> None:
        self.notes.extend(f"{self.name}: {note}" for note in stage.notes)
        stage.notes.clear()

    def _start_worker(self) -> None:
        self._stop.clear()
        self._stopped.clear()
        self._worker = Worker(self.name, self._work, self._fail)

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.stop(3.0)
            self._worker = None

    def _fail(self, reason: str) -> None:
        self.fault, self.armed = reason, False
        self._stopped.set()
        now = time.monotonic()
        for stage in self.stages:
            stage.homed = False
            self._queue.put(missing(_STREAM, 1, now, reason, stage.settings.part))
