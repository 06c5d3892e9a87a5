"""An IMS (Schneider) MDrive from the MCode manual's tables and what labs saw.

How a stepper drive moves: at once at its initial speed, up a ramp, along, down a ramp, still.
MCode manual: the speed jumps to VI, ramps with A to VM, and with D down to VI, then stops. A short
move has no time to reach VM and turns round at the speed v with v^2 = VI^2 + 2 d A D / (A + D).

What the manual leaves open is a field of the drive, so that a host can be tried with either answer.
"""

import math
import random
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.emulate.emulated import EmulatedDevice
from twin.errors import UnknownName

FAULTS: Mapping[str, str] = {
    "lost_reply": "the next replies are not sent (value: how many)",
    "double_reply": "the next replies come twice (value: how many)",
    "garbled_reply": "the next replies have one wrong bit (value: how many)",
    "late_reply": "the next reply comes late (value: seconds)",
    "extra_newline": "every reply begins with a CR LF from now on",
    "wrong_address": "it answers to another name too (value: its code)",
    "error": "an error is pending (value: its code)",
    "reboot": "it starts anew of itself, without a word",
    "stuck_moving": "it says for ever that it moves",
    "stall": "the motor stands, and the drive knows",
    "newline_only": "the next replies are empty lines (value: how many)",
    "completion": "it sends its name of itself",
    "not_acknowledged": "the next commands are refused with NAK (value: how many)",
    "baud": "it talks at another rate (value: baud)",
}
"""What can go wrong inside it -> what then happens."""

ACK, NAK, ESC, BREAK = 0x06, 0x15, 0x1B, 0x03
BUFFER = 64
UNKNOWN, BAD_VALUE, READ_ONLY, NO_LABEL, NOT_PRINTABLE = 20, 21, 25, 30, 35
SPEEDS_CROSS, SAVE_MOVING, LOAD_MOVING, BUSY_HOMING = (22, 23), 73, 74, 85
BAUDS = {"48": 4800, "96": 9600, "19": 19200, "38": 38400, "11": 115200}
MICROSTEPS = (1, 2, 4, 5, 8, 10, 16, 25, 32, 50, 64, 100, 108, 125, 127, 128, 180, 200, 250, 256)

# name: (factory value, lowest, highest)
WRITABLE: Mapping[str, tuple[int, int, int]] = {
    "P": (0, -(2**31), 2**31 - 1),
    "VI": (1000, 1, 5_000_000),
    "VM": (768_000, 1, 5_000_000),
    "A": (1_000_000, 91, 1_525_878_997),
    "D": (1_000_000, 91, 1_525_878_997),
    "MS": (256, 1, 256),
    "RC": (25, 1, 100),
    "HC": (5, 0, 100),
    "HT": (500, 0, 65535),
    "MT": (0, 0, 65535),
    "DE": (1, 0, 1),
    "LM": (1, 1, 6),
    "EM": (0, 0, 3),
    "CK": (0, 0, 2),
    "PY": (0, 0, 1),
    "QD": (0, 0, 1),
    "DG": (1, 0, 1),
    "EE": (0, 0, 1),
    "ES": (1, 0, 3),
    "CE": (1, 0, 2),
    "ER": (0, 0, 99),
    "ST": (0, 0, 1),
    "R1": (0, -(2**31), 2**31 - 1),
    "R2": (0, -(2**31), 2**31 - 1),
    "R3": (0, -(2**31), 2**31 - 1),
    "R4": (0, -(2**31), 2**31 - 1),
}
READ_ONLY_NAMES = ("V", "VC", "MV", "MP", "EF", "BY", "VR", "PN", "SN", "C1", "C2")


@dataclass(frozen=True)
class Ramps:
    """What a drive plans with [microsteps, s]."""

    initial: float
    """VI."""
    maximum: float
    """VM."""
    up: float
    """A."""
    down: float
    """D."""


@dataclass(frozen=True)
class Stretch:
    """Constant acceleration for a while."""

    start: float
    position: float
    speed: float
    acceleration: float
    span: float

    def at(self, time: float) -> tuple[float, float]:
        """Position and speed."""
        t = min(max(time - self.start, 0.0), self.span)
        return (
            self.position + (self.speed + 0.5 * self.acceleration * t) * t,
            self.speed + self.acceleration * t,
        )


@dataclass(frozen=True)
class Profile:
    """Stretches one after the other, then rest at `target`."""

    stretches: tuple[Stretch, ...]
    target: float

    @property
    def end(self) -> float:
        """When it comes to rest; infinite for a slew."""
        return self.stretches[-1].start + self.stretches[-1].span if self.stretches else -math.inf

    def at(self, time: float) -> tuple[float, float]:
        """Position and speed."""
        if time >= self.end:
            return self.target, 0.0
        stretch = next(s for s in self.stretches if time < s.start + s.span)
        return stretch.at(time)


def at_rest(position: float) -> Profile:
    """Standing still."""
    return Profile((), position)


def move(position: float, target: float, ramps: Ramps, start: float) -> Profile:
    """From rest to rest."""
    distance, sign = abs(target - position), 1.0 if target >= position else -1.0
    if distance == 0.0:
        return at_rest(position)
    low, high, up, down = ramps.initial, ramps.maximum, ramps.up, ramps.down
    ramp = (high**2 - low**2) / 2.0 * (1.0 / up + 1.0 / down)
    if ramp > distance:
        high = math.sqrt(low**2 + 2.0 * distance * up * down / (up + down))
        ramp = distance
    spans = ((high - low) / up, (distance - ramp) / high, (high - low) / down)
    speeds, accelerations = (low, high, high), (up, 0.0, -down)
    stretches: list[Stretch] = []
    for span, speed, acceleration in zip(spans, speeds, accelerations, strict=True):
        stretches.append(Stretch(start, position, sign * speed, sign * acceleration, span))
        position, _ = stretches[-1].at(start + span)
        start += span
    return Profile(tuple(stretches), target)


def slew(position: float, speed: float, ramps: Ramps, start: float) -> Profile:
    """From rest to a speed, which is then kept."""
    sign, high = (1.0 if speed >= 0.0 else -1.0), abs(speed)
    low = min(ramps.initial, high)
    ramp = Stretch(start, position, sign * low, sign * ramps.up, (high - low) / ramps.up)
    reached, _ = ramp.at(start + ramp.span)
    return Profile((ramp, Stretch(start + ramp.span, reached, speed, 0.0, math.inf)), math.inf)


def stop(profile: Profile, ramps: Ramps, time: float) -> Profile:
    """Down the ramp from the motion at `time`; rests on a whole microstep."""
    position, speed = profile.at(time)
    sign, fast = (1.0 if speed >= 0.0 else -1.0), abs(speed)
    if fast <= ramps.initial:
        return at_rest(round(position))
    span = (fast - ramps.initial) / ramps.down
    ramp = Stretch(time, position, speed, -sign * ramps.down, span)
    return Profile((ramp,), round(ramp.at(time + span)[0]))


LIMIT_PLUS, LIMIT_MINUS, STALLED, NO_HOME, BOTH_LIMITS = 83, 84, 86, 80, 82
"""Error codes of a motion."""


@dataclass
class Axis:
    """A stage: what the drive counts, and where the carriage really is."""

    position: int = 0
    """Where the carriage stands at the start, from the middle of its travel [microsteps]."""
    travel: int = 503_937
    """Either way to the limit switches [microsteps]; 25 mm of a 2.54 mm screw."""
    margin: int = 20_000
    """From a limit switch to the end stop."""
    home: int = 0
    """The home switch is closed from here on towards minus."""
    profile: Profile = field(default_factory=lambda: at_rest(0.0))
    homing: int = 0
    stuck: bool = False
    """It reports that it moves, permanently."""

    def __post_init__(self) -> None:
        self._offset = self.position
        """Carriage less counter."""
        self._phase = 0
        self._braking = set[int]()
        """Limit switches on which it brakes."""

    def counter(self, time: float) -> int:
        """P."""
        return round(self.profile.at(time)[0])

    def speed(self, time: float) -> int:
        """V [microsteps/s]."""
        return round(self.profile.at(time)[1])

    def carriage(self, time: float) -> float:
        """Where it really is, from the middle of its travel [microsteps]."""
        return self.profile.at(time)[0] + self._offset

    def moving(self, time: float) -> bool:
        """MV."""
        return self.stuck or time < self.profile.end or self.homing > 0

    def count_from(self, value: int, time: float) -> None:
        """P = value, at rest."""
        self._offset += self.counter(time) - value
        self.profile = at_rest(value)

    def go(self, target: int, ramps: Ramps, time: float) -> None:
        self.profile = move(self.counter(time), target, ramps, time)

    def run(self, speed: float, ramps: Ramps, time: float) -> None:
        if speed:
            self.profile = slew(self.counter(time), speed, ramps, time)
        else:
            self.homing = 0
            self.profile = stop(self.profile, ramps, time)

    def halt(self, time: float) -> None:
        """At once, without a ramp."""
        self.homing = 0
        self.profile = at_rest(self.counter(time))

    def seek(self, way: int, ramps: Ramps, time: float) -> None:
        """HM 1..4: 1 and 2 go to minus, 3 and 4 to plus; 1 and 3 creep back, 2 and 4 on."""
        self.homing, self._phase = way, 0
        self.run(-ramps.maximum if way < 3 else ramps.maximum, ramps, time)

    def watch(self, ramps: Ramps, switches: frozenset[int], time: float) -> int:
        """Follow switches and stops up to `time`; an error code, or 0.

        `switches`: kinds of inputs that are set up: 1 home, 2 limit plus, 3 limit minus.
        """
        carriage, speed = self.carriage(time), self.profile.at(time)[1]
        if abs(carriage) > self.travel + self.margin and speed * carriage > 0.0:
            # the end stop: the motor slips, the counter goes on
            self._offset -= round(carriage - math.copysign(self.travel + self.margin, carriage))
        for kind, sign, code in ((2, 1.0, LIMIT_PLUS), (3, -1.0, LIMIT_MINUS)):
            pressed = kind in switches and sign * carriage >= self.travel
            if not pressed or speed == 0.0:
                self._braking.discard(kind)
            elif sign * speed > 0.0 and kind not in self._braking:
                self._braking.add(kind)
                self.homing = 0
                self.profile = stop(self.profile, ramps, time)
                return code
        if self.homing:
            return self._seek_on(ramps, switches, time)
        return 0

    def _seek_on(self, ramps: Ramps, switches: frozenset[int], time: float) -> int:
        if 1 not in switches:
            self.halt(time)
            return NO_HOME
        to_minus = self.homing < 3
        closed = self.carriage(time) <= self.home
        result = closed if to_minus else not closed
        creep = Ramps(ramps.initial, ramps.initial, ramps.up, ramps.down)
        back = 1.0 if to_minus else -1.0
        if self._phase == 0 and result:
            self.profile = stop(self.profile, ramps, time)
            self._phase = 1
        elif self._phase == 1 and time >= self.profile.end:
            fast = ramps if self.homing in (2, 4) else creep
            self.profile = slew(self.counter(time), back * fast.maximum, fast, time)
            self._phase = 2
        elif self._phase == 2 and not result:
            self.profile = stop(self.profile, ramps, time)
            self._phase = 3 if self.homing in (2, 4) else 5
        elif self._phase == 3 and time >= self.profile.end:
            self.profile = slew(self.counter(time), -back * creep.maximum, creep, time)
            self._phase = 4
        elif self._phase == 4 and result:
            self.profile = stop(self.profile, ramps, time)
            self._phase = 5
        elif self._phase == 5 and time >= self.profile.end:
            self.homing = 0
        return 0


_ITEM = re.compile(r'"([^"]*)"|([A-Z][A-Z0-9]*)|[ ,]+')


@dataclass
class EmulatedDrive:
    """One drive; `saved` is what a lab has put into its memory (name, party mode ...)."""

    name: str = "1"
    axis: Axis = field(default_factory=Axis)
    saved: dict[str, int] = field(default_factory=lambda: {"PY": 1})
    inputs: dict[int, tuple[int, int]] = field(default_factory=dict[int, tuple[int, int]])
    """Input -> kind and active level, as saved."""
    execution: float = 0.003
    """CET: from the end of a command to its reply [s]; 1 to 5 ms in the manual."""
    newline_before_value: bool = False
    """EM=1 sends an empty line before a value; programs in use disagree."""
    move_while_moving: str = "ignore"
    """A new MA in motion is `ignore`d or `retarget`s; the manual does not say."""
    baud: int = 9600

    def __post_init__(self) -> None:
        self._counts = dict.fromkeys(FAULTS, 0)
        self._late = 0.0
        self._other = ""
        self._chance = random.Random(self.name)
        self.start(0.0)

    def start(self, time: float) -> None:
        """Power on: factory values but for what is saved; P is lost."""
        self.values = {name: default for name, (default, _, _) in WRITABLE.items()} | self.saved
        self.axis.halt(time)
        self.axis.count_from(0, time)
        self._sources = dict(self.inputs)
        self._party = False
        self._line = bytearray()
        self._todo: list[tuple[float, bytes]] = []
        self._out: list[tuple[float, bytes]] = []
        self._escaped = False
        self._announce = False
        if not self.values["PY"]:
            sign_on = b"Copyright 2001-2010 by Schneider Electric Motion USA\r\n>"
            self._out.append((time + 0.1, sign_on))

    def inject(self, fault: str, value: float, time: float) -> None:
        if fault == "extra_newline":
            self._escaped = True
        elif fault == "late_reply":
            self._late = value
        elif fault == "wrong_address":
            self._other = chr(int(value))
        elif fault == "error":
            self._fail(int(value))
            if int(value) == 72:
                self.axis.halt(time)
        elif fault == "reboot":
            self.start(time)
        elif fault == "stuck_moving":
            self.axis.stuck = True
        elif fault == "stall":
            self.axis.halt(time)
            self.values["ST"] = 1
            self._fail(STALLED)
        elif fault == "completion":
            self._out.append((time, self.name.encode()))
        elif fault == "baud":
            self.baud = int(value)
        else:
            self._counts[fault] += int(value) or 1

    def receive(self, data: bytes, time: float) -> bytes:
        """Bytes in; the echo out."""
        echo = bytearray()
        for byte in data:
            if byte == ESC:
                self.axis.halt(time)
                self._escaped = True
                self._line.clear()
            elif byte == BREAK and self.values["CE"]:
                self.start(time)
            elif byte == (0x0A if self.values["PY"] or self.values["CK"] else 0x0D):
                self._end_of_line(time)
            elif len(self._line) >= BUFFER:
                self._line.clear()
                self._fail(UNKNOWN)
                self._out.append((time, b"\r\n"))
            elif byte not in b"\r\n":
                self._line.append(byte)
                if self.values["EM"] == 0 and self._addressed(bytes(self._line)):
                    echo.append(byte)
        return bytes(echo)

    def advance(self, time: float) -> bytes:
        """What it says up to `time`."""
        while self._todo and self._todo[0][0] <= time:
            due, line = self._todo.pop(0)
            self._watch(due)
            self._execute(line, due)
        self._watch(time)
        out = b"".join(data for due, data in self._out if due <= time)
        self._out = [(due, data) for due, data in self._out if due > time]
        return out

    def _watch(self, time: float) -> None:
        kinds = frozenset(kind for kind, _ in self._sources.values())
        code = self.axis.watch(self._ramps(), kinds, time)
        if code:
            self._fail(code)
        if self._announce and not self.axis.moving(time):
            self._announce = False
            self._out.append((time, self.name.encode()))

    def _addressed(self, line: bytes) -> bool:
        if not self.values["PY"]:
            return True
        return self._party and line[:1] in (self.name.encode(), self._other.encode() or b"\0")

    def _end_of_line(self, time: float) -> None:
        line = bytes(self._line)
        self._line.clear()
        if self.values["PY"] and not self._party:
            self._party = not line  # one bare LF, and it listens
            return
        everybody = self.values["PY"] and line[:1] == b"*"
        several = self.values["PY"] and line[:1] == b"^" and self.values["QD"]
        if line and (self._addressed(line) or everybody or several):
            start = max([time, *(due for due, _ in self._todo)])
            self._todo.append((start + self.execution, line))

    def _execute(self, line: bytes, time: float) -> None:
        silent = bool(self.values["PY"] and line[:1] in (b"*", b"^") and self.values["DG"])
        body = line
        if self.values["CK"]:
            if sum(line) & 0x7F or self._take("not_acknowledged"):
                self._say(bytes([NAK]) if not silent else b"", time)
                return
            body = line[:-1]
        text = body.decode("ascii", "replace")[1 if self.values["PY"] else 0 :].strip()
        echo, checked, mode = body, bool(self.values["CK"]), self.values["EM"]
        value = self._obey(text, time)
        if silent:
            return
        if value is not None:
            value += bytes([_checksum(value)] if checked else []) + b"\r\n"
        self._say(self._framed(value, echo, mode, checked), time)

    def _framed(self, value: bytes | None, echo: bytes, mode: int, checked: bool) -> bytes:
        prompt = b"?" if self.values["ER"] else b">"
        done = bytes([ACK]) if checked else b""
        if mode == 0:
            return (b"" if checked else b"\r\n") + (value or b"") + done + prompt
        if mode == 1:
            if value is None:
                return done or b"\r\n"
            return (b"\r\n" if self.newline_before_value else b"") + value + done
        if mode == 2:
            return value or b""
        check = bytes([_checksum(echo)]) if checked else b""
        return echo + check + done + b"\r\n" + (value or b"")

    def _say(self, reply: bytes, time: float) -> None:
        if not reply or self._take("lost_reply"):
            return
        if self._take("newline_only"):
            reply = b"\r\n"
        if self._take("garbled_reply"):
            where = self._chance.randrange(len(reply))
            flipped = reply[where] ^ 1 << self._chance.randrange(7)
            reply = reply[:where] + bytes([flipped]) + reply[where + 1 :]
        if self._escaped:
            reply = b"\r\n" + reply
        if self._take("double_reply"):
            reply += reply
        self._out.append((time + self._late, reply))
        self._late = 0.0

    def _take(self, fault: str) -> bool:
        due = self._counts[fault] > 0
        self._counts[fault] -= due
        return due

    def _fail(self, code: int) -> None:
        self.values["ER"] = code

    def _ramps(self) -> Ramps:
        return Ramps(*(float(self.values[name]) for name in ("VI", "VM", "A", "D")))

    def _obey(self, text: str, time: float) -> bytes | None:
        """Do it; what is to be printed, or None."""
        if not text:
            return None
        upper = text.upper()
        if upper.startswith("PR"):
            # text in quotes keeps its case
            return self._print(text[2:], time)
        result = re.fullmatch(r"([A-Z]+[1-4]?)\s*(=|\s)?\s*(.*)", upper)
        word, operand = (result[1], result[3]) if result else (upper, "")
        if word in ("MA", "MR", "SL", "HM"):
            self._move(word, operand, time)
        elif word == "DN" and len(operand) == 3:
            self.name = text.rstrip('" ')[-1]
        elif re.fullmatch("S[1-4]", word) and operand:
            kind, level = (int(part) for part in operand.split(",")[:2])
            self._sources[int(word[1])] = (kind, level)
        elif word == "BD":
            if operand not in BAUDS:
                self._fail(61)
        elif word in ("S", "IP", "FD"):
            self._memory(word, time)
        elif word in ("E", "H", "PS", "RS", "EX"):
            if word == "EX":
                self._escaped = False
                self._fail(NO_LABEL)
            elif word == "PS":
                self.axis.run(0.0, self._ramps(), time)
        else:
            self._assign(word, operand, time)
        return None

    def _assign(self, word: str, operand: str, time: float) -> None:
        if word in READ_ONLY_NAMES:
            self._fail(READ_ONLY)
        elif word not in WRITABLE:
            self._fail(UNKNOWN)
        elif not re.fullmatch(r"[+-]?\d+", operand):
            self._fail(BAD_VALUE)
        else:
            value = int(operand)
            _, low, high = WRITABLE[word]
            if not low <= value <= high or (word == "MS" and value not in MICROSTEPS):
                self._fail(BAD_VALUE)
            elif word == "VI" and value >= self.values["VM"]:
                self._fail(SPEEDS_CROSS[0])
            elif word == "VM" and value <= self.values["VI"]:
                self._fail(SPEEDS_CROSS[1])
            elif word == "P":
                self.axis.count_from(value, time)
            else:
                self.values[word] = value

    def _memory(self, word: str, time: float) -> None:
        if word in ("S", "IP") and self.axis.moving(time):
            self._fail(SAVE_MOVING if word == "S" else LOAD_MOVING)
        elif word == "S":
            self.saved, self.inputs = dict(self.values), dict(self._sources)
        elif word == "IP":
            self.values |= self.saved
        else:
            self.saved, self.inputs = {}, {}
            self.start(time)

    def _move(self, word: str, operand: str, time: float) -> None:
        parts = [part.strip() for part in operand.split(",")]
        first = str(self.values.get(parts[0], parts[0]))
        if not re.fullmatch(r"[+-]?\d+", first):
            self._fail(BAD_VALUE)
            return
        value = int(first)
        if word == "HM":
            self.axis.seek(value, self._ramps(), time)
        elif word == "SL":
            self.axis.run(float(value), self._ramps(), time)
        elif self.axis.homing:
            self._fail(BUSY_HOMING)
        elif self.values["DE"]:
            if self.axis.moving(time):
                if self.move_while_moving == "ignore":
                    return
                self.axis.halt(time)
            self._announce = parts[1:2] == ["1"]
            here = self.axis.counter(time)
            self.axis.go(value if word == "MA" else here + value, self._ramps(), time)

    def _print(self, text: str, time: float) -> bytes:
        out: list[str] = []
        position = 0
        text = text.strip()
        while position < len(text):
            item = _ITEM.match(text, position) or _ITEM.match(text.upper(), position)
            if item is None:
                self._fail(NOT_PRINTABLE)
                break
            position = item.end()
            if item[1] is not None:
                out.append(item[1])
            elif item[2] is not None:
                shown = self._shown(item[2], time)
                if shown is None:
                    self._fail(NOT_PRINTABLE)
                    break
                out.append(shown)
        return "".join(out).encode("ascii", "replace")

    def _shown(self, name: str, time: float) -> str | None:
        if name == "ER":
            code, self.values["ER"] = self.values["ER"], 0
            return str(code)
        if re.fullmatch("S[1-4]", name):
            kind, level = self._sources.get(int(name[1]), (0, 0))
            return f"{kind}, {level}"
        live = {
            "P": self.axis.counter(time),
            "C1": self.axis.counter(time),
            "C2": 0,
            "V": self.axis.speed(time),
            "VC": 0,
            "MV": int(self.axis.moving(time)),
            "MP": int(self.axis.moving(time)),
            "EF": int(self.values["ER"] != 0),
            "BY": 0,
        }
        if name in live:
            return str(live[name])
        if name in ("VR", "PN", "SN", "DN"):
            texts = {"VR": "3.010", "PN": "MDI1PRD17A4-EQ", "SN": "1234", "DN": self.name}
            return texts[name]
        return str(self.values[name]) if name in self.values else None


def _checksum(text: bytes) -> int:
    return (256 - sum(text) % 256) % 256 | 0x80


@dataclass
class EmulatedMDrives(EmulatedDevice):
    """Drives that share one line."""

    drives: list[EmulatedDrive] = field(default_factory=lambda: [EmulatedDrive()])

    def __post_init__(self) -> None:
        self._time = 0.0

    @property
    def baud(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.drives[0].baud

    def receive(self, data: bytes, time: float) -> bytes:
        return _together([drive.receive(data, time) for drive in self.drives])

    def advance(self, time: float) -> bytes:
        self._time = time
        return _together([drive.advance(time) for drive in self.drives])

    def power_cycle(self, time: float) -> None:
        for drive in self.drives:
            drive.start(time)

    def inject(self, fault: str, value: float = 0.0) -> None:
        """Upon the first drive; `2:stall` is the drive named 2."""
        name, _, kind = fault.rpartition(":")
        if kind not in FAULTS:
            raise UnknownName("fault of an MDrive", kind, FAULTS)
        drive = next((d for d in self.drives if d.name == name), self.drives[0])
        drive.inject(kind, value, self._time)


def _together(said: list[bytes]) -> bytes:
    """Who talks alone is heard; two at once pull the line both ways."""
    voices = [each for each in said if each]
    if len(voices) < 2:
        return b"".join(voices)
    longest = max(map(len, voices))
    padded = [each.ljust(longest, b"\xff") for each in voices]
    mixed = bytearray(padded[0])
    for other in padded[1:]:
        for k, byte in enumerate(other):
            mixed[k] &= byte
    return bytes(mixed)
