"""An IMS (Schneider) MDrive from the MCode manual's tables and what labs saw.

What the manual leaves open is a field of the drive, so that a host can be tried with either answer.
"""

import random
import re
from dataclasses import dataclass, field

from twin.emulate.mdrive_axis import STALLED, Axis
from twin.emulate.mdrive_tables import (
    ACK,
    BAD_VALUE,
    BAUDS,
    BREAK,
    BUFFER,
    BUSY_HOMING,
    ESC,
    FAULTS,
    LOAD_MOVING,
    MICROSTEPS,
    NAK,
    NO_LABEL,
    NOT_PRINTABLE,
    READ_ONLY,
    READ_ONLY_NAMES,
    SAVE_MOVING,
    SPEEDS_CROSS,
    UNKNOWN,
    WRITABLE,
)
from twin.emulate.trapezoid import Ramps

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

    def start(self, now: float) -> None:
        """Power on: factory values but for what is saved; P is lost."""
        self.values = {name: default for name, (default, _, _) in WRITABLE.items()} | self.saved
        self.axis.halt(now)
        self.axis.count_from(0, now)
        self._sources = dict(self.inputs)
        self._party = False
        self._line = bytearray()
        self._todo: list[tuple[float, bytes]] = []
        self._out: list[tuple[float, bytes]] = []
        self._escaped = False
        self._announce = False
        if not self.values["PY"]:
            sign_on = b"Copyright 2001-2010 by Schneider Electric Motion USA\r\n>"
            self._out.append((now + 0.1, sign_on))

    def inject(self, fault: str, value: float, now: float) -> None:
        if fault == "extra_newline":
            self._escaped = True
        elif fault == "late_reply":
            self._late = value
        elif fault == "wrong_address":
            self._other = chr(int(value))
        elif fault == "error":
            self._fail(int(value))
            if int(value) == 72:
                self.axis.halt(now)
        elif fault == "reboot":
            self.start(now)
        elif fault == "stuck_moving":
            self.axis.stuck = True
        elif fault == "stall":
            self.axis.halt(now)
            self.values["ST"] = 1
            self._fail(STALLED)
        elif fault == "completion":
            self._out.append((now, self.name.encode()))
        elif fault == "baud":
            self.baud = int(value)
        else:
            self._counts[fault] += int(value) or 1

    def receive(self, data: bytes, now: float) -> bytes:
        """Bytes in; the echo out."""
        echo = bytearray()
        for byte in data:
            if byte == ESC:
                self.axis.halt(now)
                self._escaped = True
                self._line.clear()
            elif byte == BREAK and self.values["CE"]:
                self.start(now)
            elif byte == (0x0A if self.values["PY"] or self.values["CK"] else 0x0D):
                self._end_of_line(now)
            elif len(self._line) >= BUFFER:
                self._line.clear()
                self._fail(UNKNOWN)
                self._out.append((now, b"\r\n"))
            elif byte not in b"\r\n":
                self._line.append(byte)
                if self.values["EM"] == 0 and self._addressed(bytes(self._line)):
                    echo.append(byte)
        return bytes(echo)

    def advance(self, now: float) -> bytes:
        """What it says up to `now`."""
        while self._todo and self._todo[0][0] <= now:
            due, line = self._todo.pop(0)
            self._watch(due)
            self._execute(line, due)
        self._watch(now)
        out = b"".join(data for due, data in self._out if due <= now)
        self._out = [(due, data) for due, data in self._out if due > now]
        return out

    def _watch(self, now: float) -> None:
        kinds = frozenset(kind for kind, _ in self._sources.values())
        code = self.axis.watch(self._ramps(), kinds, now)
        if code:
            self._fail(code)
        if self._announce and not self.axis.moving(now):
            self._announce = False
            self._out.append((now, self.name.encode()))

    def _addressed(self, line: bytes) -> bool:
        if not self.values["PY"]:
            return True
        return self._party and line[:1] in (self.name.encode(), self._other.encode() or b"\0")

    def _end_of_line(self, now: float) -> None:
        line = bytes(self._line)
        self._line.clear()
        if self.values["PY"] and not self._party:
            self._party = not line  # one bare LF, and it listens
            return
        everybody = self.values["PY"] and line[:1] == b"*"
        several = self.values["PY"] and line[:1] == b"^" and self.values["QD"]
        if line and (self._addressed(line) or everybody or several):
            start = max([now, *(due for due, _ in self._todo)])
            self._todo.append((start + self.execution, line))

    def _execute(self, line: bytes, now: float) -> None:
        silent = bool(self.values["PY"] and line[:1] in (b"*", b"^") and self.values["DG"])
        body = line
        if self.values["CK"]:
            if sum(line) & 0x7F or self._take("not_acknowledged"):
                self._say(bytes([NAK]) if not silent else b"", now)
                return
            body = line[:-1]
        text = body.decode("ascii", "replace")[1 if self.values["PY"] else 0 :].strip()
        echo, checked, mode = body, bool(self.values["CK"]), self.values["EM"]
        value = self._obey(text, now)
        if silent:
            return
        if value is not None:
            value += bytes([_checksum(value)] if checked else []) + b"\r\n"
        self._say(self._framed(value, echo, mode, checked), now)

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

    def _say(self, reply: bytes, now: float) -> None:
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
        self._out.append((now + self._late, reply))
        self._late = 0.0

    def _take(self, fault: str) -> bool:
        due = self._counts[fault] > 0
        self._counts[fault] -= due
        return due

    def _fail(self, code: int) -> None:
        self.values["ER"] = code

    def _ramps(self) -> Ramps:
        return Ramps(*(float(self.values[name]) for name in ("VI", "VM", "A", "D")))

    def _obey(self, text: str, now: float) -> bytes | None:
        """Do it; what is to be printed, or None."""
        if not text:
            return None
        upper = text.upper()
        if upper.startswith("PR"):
            # text in quotes keeps its case
            return self._print(text[2:], now)
        found = re.fullmatch(r"([A-Z]+[1-4]?)\s*(=|\s)?\s*(.*)", upper)
        word, operand = (found[1], found[3]) if found else (upper, "")
        if word in ("MA", "MR", "SL", "HM"):
            self._move(word, operand, now)
        elif word == "DN" and len(operand) == 3:
            self.name = text.rstrip('" ')[-1]
        elif re.fullmatch("S[1-4]", word) and operand:
            kind, level = (int(part) for part in operand.split(",")[:2])
            self._sources[int(word[1])] = (kind, level)
        elif word == "BD":
            if operand not in BAUDS:
                self._fail(61)
        elif word in ("S", "IP", "FD"):
            self._memory(word, now)
        elif word in ("E", "H", "PS", "RS", "EX"):
            if word == "EX":
                self._escaped = False
                self._fail(NO_LABEL)
            elif word == "PS":
                self.axis.run(0.0, self._ramps(), now)
        else:
            self._assign(word, operand, now)
        return None

    def _assign(self, word: str, operand: str, now: float) -> None:
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
                self.axis.count_from(value, now)
            else:
                self.values[word] = value

    def _memory(self, word: str, now: float) -> None:
        if word in ("S", "IP") and self.axis.moving(now):
            self._fail(SAVE_MOVING if word == "S" else LOAD_MOVING)
        elif word == "S":
            self.saved, self.inputs = dict(self.values), dict(self._sources)
        elif word == "IP":
            self.values |= self.saved
        else:
            self.saved, self.inputs = {}, {}
            self.start(now)

    def _move(self, word: str, operand: str, now: float) -> None:
        parts = [part.strip() for part in operand.split(",")]
        first = str(self.values.get(parts[0], parts[0]))
        if not re.fullmatch(r"[+-]?\d+", first):
            self._fail(BAD_VALUE)
            return
        value = int(first)
        if word == "HM":
            self.axis.seek(value, self._ramps(), now)
        elif word == "SL":
            self.axis.run(float(value), self._ramps(), now)
        elif self.axis.homing:
            self._fail(BUSY_HOMING)
        elif self.values["DE"]:
            if self.axis.moving(now):
                if self.move_while_moving == "ignore":
                    return
                self.axis.halt(now)
            self._announce = parts[1:2] == ["1"]
            here = self.axis.counter(now)
            self.axis.go(value if word == "MA" else here + value, self._ramps(), now)

    def _print(self, text: str, now: float) -> bytes:
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
                shown = self._shown(item[2], now)
                if shown is None:
                    self._fail(NOT_PRINTABLE)
                    break
                out.append(shown)
        return "".join(out).encode("ascii", "replace")

    def _shown(self, name: str, now: float) -> str | None:
        if name == "ER":
            code, self.values["ER"] = self.values["ER"], 0
            return str(code)
        if re.fullmatch("S[1-4]", name):
            kind, level = self._sources.get(int(name[1]), (0, 0))
            return f"{kind}, {level}"
        live = {
            "P": self.axis.counter(now),
            "C1": self.axis.counter(now),
            "C2": 0,
            "V": self.axis.speed(now),
            "VC": 0,
            "MV": int(self.axis.moving(now)),
            "MP": int(self.axis.moving(now)),
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
