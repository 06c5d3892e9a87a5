"""The line of IMS (Schneider) MDrives: settings, MCode, party mode, retries.

What the MCode language of IMS (Schneider) MDrives is made of, as data.
From the "MCode Programming and Software Reference", sections 4 and 5 and the list of error codes.

Commands and replies of an MDrive in party mode. Values in, bytes out; bytes in, values out.
A reply does not say whose it is, nor to what. So each question prints a tag of its own before the
values: what is late, doubled or another drive's cannot be taken for the answer. In whatever echo
mode the drive is, the answer is found by that tag; prompts, echoes and empty lines are passed over.
"""

import itertools
import math
import re
import string
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction

from twin.errors import UsageError
from twin.plant.devices.device import Counters
from twin.plant.devices.port import Port

ACKNOWLEDGE, REFUSE = 0x06, 0x15
END = b"\n"
"""Ends a command in party mode and with checksums."""
LONGEST = 64
"""Characters that a drive's receive buffer holds, spaces included."""


class ErrorEffect(Enum):
    """What an error of a drive means for whoever moves it."""

    line = "a command was not understood, and is sent again where it matters"
    refused = "the command was refused"
    limit = "the stage is at a limit switch, and may only go back"
    lost = "the position is lost"
    stopped = "the drive has stopped"
    warning = "worth knowing"


@dataclass(frozen=True)
class ErrorCode:
    """One entry of the list."""

    sentence: str
    effect: ErrorEffect


ERRORS = {
    20: ErrorCode("unknown variable, or its receive buffer ran over", ErrorEffect.line),
    21: ErrorCode("value out of range", ErrorEffect.refused),
    22: ErrorCode("the initial speed VI is not below the maximum VM", ErrorEffect.refused),
    23: ErrorCode("the maximum speed VM is not above the initial VI", ErrorEffect.refused),
    24: ErrorCode("illegal data", ErrorEffect.line),
    25: ErrorCode("the variable can only be read", ErrorEffect.refused),
    30: ErrorCode("unknown label", ErrorEffect.line),
    34: ErrorCode("a variable cannot be executed", ErrorEffect.line),
    35: ErrorCode("the variable cannot be printed", ErrorEffect.line),
    37: ErrorCode("not in this drive", ErrorEffect.refused),
    40: ErrorCode("no program runs", ErrorEffect.warning),
    61: ErrorCode("baud rate out of range", ErrorEffect.refused),
    62: ErrorCode("settings were not loaded", ErrorEffect.refused),
    63: ErrorCode("characters came faster than it could take", ErrorEffect.line),
    70: ErrorCode("its memory has a wrong checksum", ErrorEffect.stopped),
    71: ErrorCode("it is getting too hot", ErrorEffect.warning),
    72: ErrorCode("it is too hot and has switched the motor off", ErrorEffect.lost),
    73: ErrorCode("it cannot save while it moves", ErrorEffect.refused),
    74: ErrorCode("it cannot load settings while it moves", ErrorEffect.refused),
    80: ErrorCode("no home switch is set up", ErrorEffect.refused),
    81: ErrorCode("no home switch is set up", ErrorEffect.refused),
    82: ErrorCode("it met both limit switches and no home switch", ErrorEffect.stopped),
    83: ErrorCode("it is at the limit switch towards plus", ErrorEffect.limit),
    84: ErrorCode("it is at the limit switch towards minus", ErrorEffect.limit),
    85: ErrorCode("it cannot move while it seeks home", ErrorEffect.refused),
    86: ErrorCode("the motor has stalled", ErrorEffect.lost),
    91: ErrorCode("its stop input is active", ErrorEffect.stopped),
    92: ErrorCode("its position error is too large", ErrorEffect.lost),
    93: ErrorCode("it cannot move while it corrects its position", ErrorEffect.refused),
}
"""Code in ER -> what it says, and what follows."""


def error_named(code: int) -> ErrorCode:
    """The entry of that code; an unknown one stops the drive."""
    return ERRORS.get(code, ErrorCode("an error that is not in the list", ErrorEffect.stopped))


@dataclass(frozen=True)
class Register:
    """A variable that a host may set."""

    low: int
    high: int


SETTABLE = {
    "VI": Register(1, 5_000_000),
    "VM": Register(1, 5_000_000),
    "A": Register(91, 1_525_878_997),
    "D": Register(91, 1_525_878_997),
    "RC": Register(1, 100),
    "HC": Register(0, 100),
    "HT": Register(0, 65535),
    "MT": Register(0, 65535),
    "LM": Register(1, 6),
}
"""Variables that the settings of a drive write, and their ranges."""

HOME_INPUT, PLUS_INPUT, MINUS_INPUT = 1, 2, 3
"""Kinds of an input: home switch, limit switch towards plus, and towards minus."""


_KEPT = 512
"""Bytes of a reply that are looked at; the longest answer has less than 100."""
_NUMBERS = rb"(-?\d{1,10}(?:(?:_|, )-?\d{1,10})*)"
_BETWEEN = re.compile("_|, ")


def checksum(text: bytes) -> int:
    """Two's complement of the sum of the characters, with the highest bit set."""
    return -sum(text) & 0xFF | 0x80


def frame(address: str, command: str, *, checked: bool) -> bytes:
    """A command to one drive.

    Raises:
        ValueError: longer than a drive's buffer, or not in ASCII.
    """
    text = (address + command).encode("ascii")
    if checked:
        text += bytes([checksum(text)])
    if len(text) > LONGEST:
        raise ValueError(f"{command!r} has more than {LONGEST} characters")
    return text + END


def question(tag: str, items: Sequence[str]) -> str:
    """The command that prints the tag and then the items, one line."""
    return f'PR "{tag}"' + ',"_"'.join(items)


class ExchangeState(Enum):
    """How far an exchange has come."""

    waiting = "the answer is not there yet"
    done = "the answer is there, or the acknowledgement"
    refused = "the drive has refused the command (NAK): it came with a wrong checksum"
    corrupt = "an answer came with a wrong checksum"


class Answer:
    """What comes back after a question."""

    def __init__(self, tag: str, *, checked: bool) -> None:
        self._checked = checked
        check = rb"(?:([\x80-\xff])[\r\n]|[\r\n]{1,2}([\x80-\xff]))" if checked else rb"[\r\n]"
        self._pattern = re.compile(re.escape(tag.encode("ascii")) + _NUMBERS + check)
        self._tag = tag.encode("ascii")
        self._buffer = b""
        self.values: tuple[int, ...] = ()
        self.state = ExchangeState.waiting

    def feed(self, data: bytes) -> ExchangeState:
        """Take what has arrived."""
        if self.state is not ExchangeState.waiting:
            return self.state
        self._buffer = (self._buffer + data)[-_KEPT:]
        result = self._pattern.search(self._buffer)
        if result is None:
            if bytes([REFUSE]) in self._buffer:
                self.state = ExchangeState.refused
        elif self._checked and checksum(self._tag + result[1]) != (result[2] or result[3])[0]:
            self.state = ExchangeState.corrupt
        else:
            self.values = tuple(map(int, _BETWEEN.split(result[1].decode("ascii"))))
            self.state = ExchangeState.done
        return self.state


class Acknowledgement:
    """What comes back after a command that prints nothing.

    Nobody relies on it: what was commanded is read back. It says only when the next may be sent.
    """

    def __init__(self, sent: bytes, *, echo_mode: int, checked: bool) -> None:
        self._echo = sent.rstrip(END)
        self._echo_mode, self._checked = echo_mode, checked
        self._buffer = b""
        self.state = ExchangeState.done if echo_mode == 2 else ExchangeState.waiting

    def feed(self, data: bytes) -> ExchangeState:
        """Take what has arrived."""
        if self.state is not ExchangeState.waiting:
            return self.state
        self._buffer = (self._buffer + data)[-_KEPT:]
        rest = self._buffer.replace(self._echo, b"")
        if self._checked:
            if bytes([ACKNOWLEDGE]) in rest:
                self.state = ExchangeState.done
            elif bytes([REFUSE]) in rest:
                self.state = ExchangeState.refused
        elif self._echo_mode == 0:
            if b">" in rest or b"?" in rest:
                self.state = ExchangeState.done
        elif b"\n" in rest:
            self.state = ExchangeState.done
        return self.state


_OWN_TIME = 0.09
"""What drive and adapter may add to the time on the line [s]: 5 ms to execute, 2 x 16 ms of a USB
adapter's latency, and as much again."""
_ANSWER_BYTES = 48
_TRIES = 3


@dataclass
class Mode:
    """How a drive talks now."""

    echo: int = 0
    checked: bool = False


class Line:
    """Half-duplex: nobody speaks before the answer or its time is over."""

    def __init__(self, port: Port, counters: Counters) -> None:
        self._port, self._counters = port, counters
        self._letters = itertools.cycle(string.ascii_letters)
        self.heard = 0.0
        """When the last answer was complete, `time.monotonic` [s]."""
        self.wire = 0.0
        """How long that answer took on the line, at most [s]."""

    def activate(self) -> None:
        """The bare end of line that wakes party mode after power-up; harmless at other times."""
        self._port.write(END)
        time.sleep(0.01 + self._port.byte_time)

    def ask(
        self, address: str, items: Sequence[str], mode: Mode, tries: int = _TRIES
    ) -> tuple[int, ...] | None:
        """Values of the items; None: no answer that can be trusted."""
        for _ in range(tries):
            tag = address + next(self._letters)
            answer = Answer(tag, checked=mode.checked)
            sent = frame(address, question(tag, items), checked=mode.checked)
            state = self._exchange(sent, answer)
            if state is ExchangeState.done:
                self._counters.frames += 1
                self.wire = _ANSWER_BYTES // 2 * self._port.byte_time
                return answer.values
            self._count(state)
        return None

    def tell(self, address: str, command: str, mode: Mode, tries: int = _TRIES) -> bool:
        """Send a command; whether it was acknowledged. Only what was refused is sent again."""
        sent = frame(address, command, checked=mode.checked)
        for _ in range(tries):
            heard = Acknowledgement(sent, echo_mode=mode.echo, checked=mode.checked)
            state = self._exchange(sent, heard)
            if state is ExchangeState.done:
                return True
            self._count(state)
            if state is not ExchangeState.refused:
                break
        return False

    def _exchange(self, sent: bytes, reply: Answer | Acknowledgement) -> ExchangeState:
        self._port.waiting()
        self._port.write(sent)
        if reply.state is ExchangeState.done:
            # nothing comes back: give the drive time to execute
            time.sleep(len(sent) * self._port.byte_time + 0.008)
            return ExchangeState.done
        wire = (2 * len(sent) + _ANSWER_BYTES) * self._port.byte_time
        deadline = time.monotonic() + wire + _OWN_TIME
        while (left := deadline - time.monotonic()) > 0.0:
            state = reply.feed(self._port.read(min(left, 0.02)))
            if state is not ExchangeState.waiting:
                break
        self.heard = time.monotonic()
        return reply.state

    def _count(self, state: ExchangeState) -> None:
        self._counters.timeouts += state is ExchangeState.waiting
        self._counters.bad_checksums += state in (ExchangeState.corrupt, ExchangeState.refused)


_MICROSTEPS = (1, 2, 4, 5, 8, 10, 16, 25, 32, 50, 64, 100, 108, 125, 127, 128, 180, 200, 250, 256)


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """One drive and the stage that it moves; plus is where its counter grows."""

    address: str
    """Its name on the line (DN), one letter or digit; saved in the drive by the laboratory."""
    part: str
    """The stage, as the platform calls it."""
    travel: tuple[float, float]
    """Soft limits [m], 0 where the counter is 0."""
    speed: float
    """Maximum speed, VM [m/s]. The factory value is 38.1 mm/s on this screw."""
    acceleration: float = 0.0508
    """Up and down the ramp, A and D [m/s^2]."""
    initial_speed: float = 5.08e-5
    """VI [m/s]."""
    lead: float = 2.54e-3
    """Travel of a turn [m]; 0.1 inch."""
    full_steps: int = 200
    """Of the motor, a turn."""
    microsteps: int = 256
    """A full step, MS. It is read, and never changed: the counter would mean something else."""
    run_current: int = 25
    """RC [%]."""
    hold_current: int = 5
    """HC [%]. A stage that must not slip on a floating table may need more."""
    settling: int = 0
    """MT: so long after a move it counts as moving [ms]."""
    inputs: Mapping[int, tuple[int, int]] = field(default_factory=dict[int, tuple[int, int]])
    """Input 1 to 4 -> kind (1 home, 2 limit plus, 3 limit minus) and active level (0, 1)."""
    limit_behaviour: int = 1
    """LM: 1 to 3 stop on the ramp, 4 to 6 at once."""
    home_method: int = 1
    """HM: 1 and 2 seek towards minus, 3 and 4 towards plus; 1 and 3 creep back, 2 and 4 on."""
    home_speed: float = 1e-3
    """[m/s]"""
    home_position: float = 0.0
    """Where the home switch is [m]."""

    def __post_init__(self) -> None:
        """Hold the parts against each other.

        Raises:
            UsageError: a value that the drive does not take.
        """
        if len(self.address) != 1 or not self.address.isascii() or not self.address.isalnum():
            raise UsageError(f"address {self.address!r}: an MDrive's name is a letter or a digit")
        if self.microsteps not in _MICROSTEPS:
            raise UsageError(f"stage {self.part}: an MDrive has no {self.microsteps} microsteps")
        if not self.travel[0] < self.travel[1]:
            raise UsageError(f"stage {self.part}: travel {self.travel} m; give lowest and highest")
        for name, value in self.registers().items():
            bounds = SETTABLE[name]
            if not bounds.low <= value <= bounds.high:
                raise UsageError(
                    f"stage {self.part}: {name} would be {value}; "
                    f"the drive takes {bounds.low} to {bounds.high}"
                )
        for speed in (self.speed, self.home_speed):
            if self.rate(speed) <= self.rate(self.initial_speed):
                raise UsageError(
                    f"stage {self.part}: its speeds must be above the initial {self.initial_speed}"
                )

    @property
    def steps_per_metre(self) -> Fraction:
        """Exact, as it is no whole number: 20157.48 a millimetre."""
        return self.full_steps * self.microsteps / Fraction(self.lead).limit_denominator(10**9)

    def steps(self, position: float) -> int:
        """Nearest microstep."""
        return round(Fraction(position) * self.steps_per_metre)

    def metres(self, steps: int) -> float:
        """Position of a microstep."""
        return float(steps / self.steps_per_metre)

    def rate(self, speed: float) -> int:
        """[microsteps/s], or /s^2."""
        return math.floor(speed * float(self.steps_per_metre) + 0.5)

    @property
    def reach(self) -> int:
        """Longest move [microsteps]: a drive has no watchdog, so no order may outlast its host."""
        return self.rate(self.speed) // 4

    def registers(self) -> dict[str, int]:
        """What is written before the first move, in an order in which VI stays below VM."""
        return {
            "RC": self.run_current,
            "HC": self.hold_current,
            "MT": self.settling,
            "LM": self.limit_behaviour,
            "A": self.rate(self.acceleration),
            "D": self.rate(self.acceleration),
            "VI": self.rate(self.initial_speed),
            "VM": self.rate(self.speed),
        }

    @property
    def has_home(self) -> bool:
        """A home switch is wired."""
        return any(kind == HOME_INPUT for kind, _ in self.inputs.values())
