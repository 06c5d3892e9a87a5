"""A session with the MDrive stages of one line: bounded moves, read back, hold as the safe state.

What is known of one stage between two looks at it, and what a new look means.
The counter of an open-loop drive can be believed as long as it lies where the last order allows:
between the start of the move and its target. Whatever is outside is doubted, and the second time it
means that the position is lost.

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
    SampleQueue,
    Worker,
    missing,
)
from twin.plant.devices.mdrive_line import DriveSettings, ErrorEffect, Line, Mode, error_named
from twin.plant.devices.port import Port
from twin.stop import check, requested

CONFIGURED, HOMED = 31001, 31002
"""What the mark register holds: set up, or set up and homed, since the drive got its power."""
_LOOKS = 3
"""How often a drive is asked for its error where the question itself is lost."""
_SLOW = 1.0
"""How long a drive may take to come to rest [s], beyond its ramp."""


def recognise(line: Line, address: str) -> Mode | None:
    """How the drive talks, asked in every way; None: it does not answer.

    Without a checksum first: a drive that wants one refuses, and does nothing.
    """
    line.activate()
    for checked in (False, True):
        mode = Mode(checked=checked)
        if line.ask(address, ["EM"], mode, tries=2) is not None:
            return mode
    return None


def set_up(
    name: str, line: Line, drive: DriveSettings, mark: str, wanted: Mode
) -> tuple[Mode, int, bool, tuple[int, ...]]:
    """Write the settings and read them back.

    Returns:
        How it talks from now on, P, whether it is still homed, and the errors that were pending.

    Raises:
        DeviceError: no answer, or another value than the one written.
    """
    mode = recognise(line, drive.address)
    who = f"{name}: drive {drive.address}"
    if mode is None:
        raise DeviceError(who, "does not answer", "check power, name (DN), party mode and baud")
    line.tell(drive.address, "SL 0", mode)
    line.tell(drive.address, f"EM={wanted.echo}", mode)
    line.tell(drive.address, f"CK={int(wanted.checked)}", mode)
    mode = wanted
    _expect(who, line, drive.address, mode, {"EM": wanted.echo, "CK": int(wanted.checked)})
    wait_for_rest(who, line, drive, mode)
    _expect(who, line, drive.address, mode, {"MS": drive.microsteps})
    result = _ask(who, line, drive.address, mode, [mark])[0]
    # now: a write that fails puts its own code in the place of a stall's
    before = pending_error(who, line, drive.address, mark, mode)
    for _ in range(2):
        # twice: VI and VM may be written in one order only, which depends on what they were
        for register, value in drive.registers().items():
            line.tell(drive.address, f"{register}={value}", mode)
    for number, (kind, level) in drive.inputs.items():
        line.tell(drive.address, f"S{number}={kind},{level}", mode)
    line.tell(drive.address, "DE=1", mode)
    _expect(who, line, drive.address, mode, {**drive.registers(), "DE": 1})
    for number, source in drive.inputs.items():
        answer = _ask(who, line, drive.address, mode, [f"S{number}"])
        if answer[:2] != source:
            raise _otherwise(who, f"S{number}", answer, source)
    after = pending_error(who, line, drive.address, mark, mode)
    # two of the writes may have failed on purpose
    errors = tuple(code for code in (before, after) if code not in (0, 22, 23, 35))
    homed = result == HOMED
    line.tell(drive.address, f"{mark}={HOMED if homed else CONFIGURED}", mode)
    _expect(who, line, drive.address, mode, {mark: HOMED if homed else CONFIGURED})
    position = _ask(who, line, drive.address, mode, ["P"])[0]
    return mode, position, homed, errors


def pending_error(who: str, line: Line, address: str, mark: str, mode: Mode) -> int:
    """The error code that waits in a drive; 0: none.

    Raises:
        DeviceError: no answer, or the code was read, which clears it, and lost on the line.
    """
    for _ in range(_LOOKS):
        if not _ask(who, line, address, mode, ["EF"])[0]:
            return 0
        answer = line.ask(address, ["ER"], mode, tries=1)
        if answer is not None:
            return answer[0]
        if not _ask(who, line, address, mode, ["EF"])[0]:
            break
    line.tell(address, f"{mark}={CONFIGURED}", mode)
    problem = "had an error whose code was lost on the line, perhaps a stall"
    raise DeviceError(who, problem, "capture the table, configure it anew and home it")


def seek_home(name: str, line: Line, drive: DriveSettings, mark: str, mode: Mode) -> int:
    """Run to the home switch, count from there; P afterwards.

    Raises:
        DeviceError: no home switch, an error of the drive, or not within the time.
    """
    who = f"{name}: drive {drive.address}"
    if not drive.has_home:
        raise DeviceError(who, "has no home switch", "set up an input of kind 1")
    address, slow = drive.address, drive.rate(drive.home_speed)
    try:
        line.tell(address, f"VM={slow}", mode)
        _expect(who, line, address, mode, {"VM": slow})
        _ask(who, line, address, mode, ["ER"])
        line.tell(address, f"HM {drive.home_method}", mode)
        wait_for_rest(who, line, drive, mode, _longest_search(drive))
        code = pending_error(who, line, address, mark, mode)
        if code:
            raise DeviceError(who, f"found no home: {error_named(code).sentence}", "look at it")
        home = drive.steps(drive.home_position)
        line.tell(address, f"P={home}", mode)
        _expect(who, line, address, mode, {"P": home})
        line.tell(address, f"{mark}={HOMED}", mode)
        _expect(who, line, address, mode, {mark: HOMED})
    finally:
        line.tell(address, "SL 0", mode)
        line.tell(address, f"VM={drive.rate(drive.speed)}", mode)
    _expect(who, line, address, mode, {"VM": drive.rate(drive.speed)})
    return home


def wait_for_rest(
    who: str, line: Line, drive: DriveSettings, mode: Mode, longest: float = 0.0
) -> None:
    """Until it stands.

    Raises:
        DeviceError: not within `longest` [s] and the time of its ramp.
        Stopped: a stop was requested; it was told to stop.
    """
    allowed = longest + drive.speed / drive.acceleration + _SLOW
    end = time.monotonic() + allowed
    while _ask(who, line, drive.address, mode, ["MV"])[0]:
        if requested() is not None:
            line.tell(drive.address, "SL 0", mode)
            check()
        if time.monotonic() > end:
            line.tell(drive.address, "SL 0", mode)
            raise DeviceError(who, f"still moves after {allowed:.1f} s", "look at it")
        time.sleep(0.01)


def _longest_search(drive: DriveSettings) -> float:
    low, high = drive.travel
    creep = drive.rate(drive.home_speed) ** 2 / (2.0 * drive.rate(drive.acceleration))
    return 1.5 * (high - low) / drive.home_speed + 3.0 * creep / drive.rate(drive.initial_speed)


def _ask(who: str, line: Line, address: str, mode: Mode, items: list[str]) -> tuple[int, ...]:
    answer = line.ask(address, items, mode)
    if answer is None or len(answer) < len(items):
        raise DeviceError(who, f"does not tell {' and '.join(items)}", "check the line and power")
    return answer


def _expect(who: str, line: Line, address: str, mode: Mode, wanted: dict[str, int]) -> None:
    """Read back, a few at a time: a drive's buffer is short."""
    names = list(wanted)
    for some in (names[k : k + 4] for k in range(0, len(names), 4)):
        answer = _ask(who, line, address, mode, some)
        for register, value in zip(some, answer, strict=True):
            if value != wanted[register]:
                raise _otherwise(who, register, value, wanted[register])


def _otherwise(who: str, register: str, result: object, wanted: object) -> DeviceError:
    problem = f"{register} is {result}, not {wanted} as written"
    return DeviceError(who, problem, "set it in the drive, or correct the settings")


_SLACK = 2
"""Microsteps that a counter may lie outside of its move: it is printed while it changes."""
_PATIENCE = 0.1
"""So long after an order [s] a drive that stands has not heard it."""
_GRACE = 0.5
"""So long after the end of its move [s] a drive still says that it moves: it is stuck."""
_ORDERS = 3
"""So often an order is given."""
_FRESH = 0.5
"""An order that could not be given for so long [s] is dropped: whoever gave it may be dead."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a drive says of itself."""

    position: int
    """P [microsteps]."""
    moving: bool
    """MV."""
    time: float
    """Of the host [s]."""


class Tracker:
    """One stage."""

    def __init__(self, settings: DriveSettings) -> None:
        self.settings = settings
        self.position = 0
        self.homed = False
        self.moving = False
        self.stopping = False
        self.lost = ""
        """Why the position cannot be trusted; empty: it can, once homed."""
        self.unread = False
        """It has an error, and no answer came to the question which."""
        self.notes: list[str] = []
        self._start = self._target = 0
        self._given = 0.0
        self._orders = 0
        self._pending: tuple[int, float] | None = None
        self._blocked = 0
        self._doubts = 0

    @property
    def target(self) -> int:
        """Where it rests when what was ordered is done [microsteps]."""
        return self._target

    @property
    def doubted(self) -> bool:
        """The last look could not be believed, or the position is lost."""
        return bool(self._doubts or self.unread or self.lost)

    @property
    def name(self) -> str:
        """For messages."""
        return f"stage {self.settings.part} (drive {self.settings.address})"

    def rest(self, position: int) -> None:
        """It stands there, and is believed."""
        self.position = self._start = self._target = position
        self.moving = self.stopping = self.unread = False
        self._pending, self._orders, self._doubts, self._blocked = None, 0, 0, 0

    def allow(self, wanted: int) -> int:
        """The nearest target [microsteps] that travel, reach and limit switches let it have."""
        settings, here = self.settings, self._target
        low, high = (settings.steps(end) for end in settings.travel)
        allowed = max(min(wanted, high), low)
        # after the travel: a stage beyond it, above or below, is let back and not made to leap
        allowed = max(min(allowed, here + settings.reach), here - settings.reach)
        if self._blocked > 0:
            return min(allowed, here)
        return max(allowed, here) if self._blocked < 0 else allowed

    def want(self, target: int, host_time: float) -> None:
        """Go there as soon as it stands; what was wanted before is forgotten."""
        self._pending = (target, host_time)

    def drop(self) -> None:
        """Nothing is wanted any more."""
        self._pending = None

    def order(self, host_time: float) -> int | None:
        """The target that should be sent to the drive now, and counts as given; None: nothing."""
        if self.moving or self.stopping or self.lost:
            return None
        if self._pending is not None:
            (target, wanted), self._pending = self._pending, None
            # a loop wants the same in every tick: that is no new order, and must not renew the old
            if target != self._target:
                if host_time - wanted > _FRESH:
                    return None
                return self._give(target, host_time)
        if self.position == self._target or host_time - self._given < _PATIENCE:
            return None
        if self._orders >= _ORDERS:
            self.notes.append(f"{self.name}: does not move, {_ORDERS} orders were in vain")
            self.rest(self.position)
            return None
        self._given = host_time
        self._orders += 1
        return self._target

    def look(self, look: Look) -> str:
        """Take what the drive says; why it cannot be believed, or nothing."""
        low, high = sorted((self._start, self._target))
        if not low - _SLACK <= look.position <= high + _SLACK:
            return self.doubt(
                f"{self.name}: counter at {look.position}, not in {low} to {high}",
                f"{self.name}: its counter leapt from {self.position} to {look.position} "
                f"microsteps outside of {low} to {high}; capture the table and home it again",
            )
        self._doubts = 0
        self.position, self.moving = look.position, look.moving
        if look.moving:
            if look.time > self._given + self._longest() + _GRACE and not self.stopping:
                self.lost = (
                    f"{self.name}: says that it moves, long after its move must have ended; "
                    "switch it off and on, and home it again"
                )
            return self.lost
        if look.position != self._target and (self.stopping or look.position != self._start):
            if not self.stopping:
                self.notes.append(
                    f"{self.name}: stopped at {1e3 * self.settings.metres(look.position):.3f} mm, "
                    f"short of {1e3 * self.settings.metres(self._target):.3f} mm"
                )
            blocked, pending = self._blocked, self._pending
            self.rest(look.position)
            self._blocked, self._pending = blocked, pending
        elif look.position == self._target:
            self._start = self._target
        self.stopping = False
        return ""

    def doubt(self, reason: str, loss: str) -> str:
        """A look that cannot be; two in a row mean a loss, for one may be a wrong bit."""
        self._doubts += 1
        if self._doubts > 1:
            self.lost = loss
        return self.lost or reason

    def moved_off(self) -> None:
        """An order away from a limit switch was given: the switch blocks no more."""
        if self._blocked * (self._target - self._start) < 0:
            self._blocked = 0

    def hear_error(self, code: int | None) -> str:
        """Take an error code that was asked for; why the position cannot be believed, or nothing.

        Args:
            code: None: no answer came.
        """
        self.unread = code is None
        if code is None:
            return f"{self.name}: has an error, and which was not to be heard"
        self.complain(code)
        return self.lost

    def lose_error(self) -> str:
        """The code was read, which clears it, and the answer was lost: it may have been any."""
        self.unread = False
        self.lost = (
            f"{self.name}: had an error whose code was lost on the line, perhaps a stall; capture "
            "the table and home it again"
        )
        self.notes.append(self.lost)
        return self.lost

    def complain(self, code: int) -> None:
        """Take an error code of the drive."""
        if code == 0:
            return
        error = error_named(code)
        sentence = f"{self.name}: {error.sentence} (error {code})"
        self.notes.append(sentence)
        if error.effect is ErrorEffect.lost:
            self.lost = sentence + "; capture the table and home it again"
        elif error.effect is ErrorEffect.limit:
            self._blocked = 1 if code == 83 else -1
            self._pending = None

    def _give(self, target: int, host_time: float) -> int:
        self._start, self._target = self.position, target
        self._given, self._orders = host_time, 1
        return target

    def _longest(self) -> float:
        settings = self.settings
        distance = abs(self._target - self._start)
        ramps = 2.0 * settings.speed / settings.acceleration
        return distance / settings.rate(settings.speed) + ramps + settings.settling * 1e-3


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
        host_time = time.monotonic()
        with self._lock:
            for k, stage in enumerate(self.stages):
                target = stage.allow(stage.settings.steps(float(command[_COMMAND][k])))
                stage.want(target, host_time)
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
        host_time = time.monotonic()
        if host_time < self._silent_until[self._turn]:
            time.sleep(0.005)
            return
        self._serve(self._turn)

    def _serve(self, k: int) -> None:
        """Look at one stage, say what is known of it, and give it its order."""
        assert self._line is not None
        stage, mode = self.stages[k], self._modes[k]
        address = stage.settings.address
        reason = self._look(k)
        host_time = self._line.heard
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
            self._queue.put(missing(_STREAM, 1, host_time, f"{self.name}: {reason}", part))
            return
        value = (stage.settings.metres(stage.position),)
        self._queue.put(Sample(_STREAM, value, host_time, latency=latency, part=part))
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
        if not self.settings.checksum and apart > self._travel_between(
            stage, moving or stage.moving
        ):
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

    def _travel_between(self, stage: Tracker, moving: int | bool) -> int:
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
        host_time = time.monotonic()
        for stage in self.stages:
            stage.homed = False
            self._queue.put(missing(_STREAM, 1, host_time, reason, stage.settings.part))
