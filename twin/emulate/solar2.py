"""A SOLAR-2 inclinometer on its serial line, from what is known of its makers' protocol."""

import math
import random
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from twin.emulate.emulated import EmulatedDevice
from twin.errors import UnknownName

FAULTS: Mapping[str, str] = {
    "short_reply": "the next replies lack their last byte (value: how many)",
    "text": "it answers in text from now on",
    "binary": "it answers in binary from now on",
    "nmea": "it sends NMEA sentences and knows no command but the way back",
    "stale": "it gives the same value again and again",
    "saturated": "it gives the end of its range",
    "well": "the values are sound again",
    "baud": "it talks at another rate (value: baud)",
}
"""What can go wrong inside it -> what then happens."""

_FILTERS_HZ = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
_FILTERS_MS = (8000, 4000, 2000, 1000, 500, 250, 125, 62, 31)
_FORGET = 0.1
"""A pause between two characters of a command [s] that makes it forget them."""


@dataclass
class EmulatedSolar2(EmulatedDevice):
    """One unit at a constant tilt but for its noise; set `x` and `y` to tilt it."""

    baud: int = 38400
    text: bool = False
    x_first: bool = True
    x: float = 1.5
    """[deg]"""
    y: float = -2.25
    """[deg]"""
    noise: float = 0.002
    """[deg], 1 sigma."""
    range: float = 30.0
    """[deg]"""
    filter: int = 7
    """Low-pass, 1 to 9."""
    interval: float = 1.0
    """Of its stream [s]."""
    streaming: bool = False
    latency: float = 0.002
    """From a command to the reply [s]."""
    seed: int = 0

    def __post_init__(self) -> None:
        self._chance = random.Random(self.seed)
        self._inbox = b""
        self._heard = -1.0
        self._outbox: list[tuple[float, bytes]] = []
        self._short, self._ill, self._nmea = 0, "", False
        self._time = 0.0
        self._zero = (0.0, 0.0)
        self._filtered = (self.x, self.y)
        self._still = (self.x, self.y)
        self._next = self.interval

    def show(self, x: float, y: float) -> None:
        """It stands so from now on [deg], and whatever filters it has done so."""
        self.x, self.y = x, y
        self._filtered = (x, y)

    def power_cycle(self, time: float) -> None:
        self._inbox = b""
        self._outbox.clear()
        self._filtered = (self.x, self.y)
        self._next = time + self.interval

    def inject(self, fault: str, value: float = 0.0) -> None:
        if fault not in FAULTS:
            raise UnknownName("fault of a SOLAR-2", fault, FAULTS)
        if fault == "short_reply":
            self._short += int(value) or 1
        elif fault in ("text", "binary"):
            self.text = fault == "text"
        elif fault == "nmea":
            self._nmea = True
        elif fault == "baud":
            self.baud = int(value)
        else:
            self._ill = "" if fault == "well" else fault
            self._still = self._filtered

    def receive(self, data: bytes, time: float) -> bytes:
        if time - self._heard > _FORGET:
            self._inbox = b""
        self._heard = time
        self._inbox += data
        if self._nmea:
            if b"$PLDL100,1*38\r\n" in self._inbox:
                self._nmea, self._inbox = False, b""
            self._inbox = self._inbox[-32:]
            return b""
        while len(self._inbox) >= 7:
            command, self._inbox = self._inbox[:7], self._inbox[7:]
            reply = self._obey(command)
            if self._short and reply:
                self._short, reply = self._short - 1, reply[:-1]
            self._outbox.append((time + self.latency, reply))
        return b""

    def advance(self, time: float) -> bytes:
        self._settle(time - self._time)
        self._time = time
        while (self.streaming or self._nmea) and self._next <= time:
            x, y = self._measure()
            sentence = b"$PLDL1,%.3f,%.3f*00\r\n" % (x, y)
            self._outbox.append((self._next, sentence if self._nmea else self._in_text(x, y)))
            self._next += self.interval
        out = b"".join(data for due, data in self._outbox if due <= time)
        self._outbox = [(due, data) for due, data in self._outbox if due > time]
        return out

    def _settle(self, span: float) -> None:
        """The low-pass moves on by `span` [s]."""
        share = 1.0 - math.exp(-2.0 * math.pi * _FILTERS_HZ[self.filter - 1] * max(span, 0.0))
        x, y = self._filtered
        self._filtered = (x + share * (self.x - x), y + share * (self.y - y))

    def _measure(self) -> tuple[float, float]:
        if self._ill == "stale":
            return self._still
        if self._ill == "saturated":
            return self.range, self._filtered[1]
        first, second = (
            max(-self.range, min(self.range, angle - zero + self._chance.gauss(0.0, self.noise)))
            for angle, zero in zip(self._filtered, self._zero, strict=True)
        )
        return first, second

    def _in_text(self, x: float, y: float) -> bytes:
        pair = (x, y) if self.x_first else (y, x)
        return b"%+08.3f,%+08.3f\r" % pair

    def _obey(self, command: bytes) -> bytes:
        text = command.decode("ascii", "replace")
        if text == "get-x&y":
            x, y = self._measure()
            if self.text:
                return self._in_text(x, y)
            pair = (x, y) if self.x_first else (y, x)
            return struct.pack(">ii", *(round(1000.0 * angle) for angle in pair))
        if text == "gettemp":
            return b"+28.1\r" if self.text else struct.pack(">h", 2810)
        if text == "get-flt":
            return struct.pack(">h", _FILTERS_MS[self.filter - 1])
        if text[:6] == "setflt" and text[6] in "123456789":
            self.filter = int(text[6])
        elif text == "setzcur":
            self._zero = self._filtered
        elif text == "setzfac":
            self._zero = (0.0, 0.0)
        elif text == "setoasc":
            self.text = True
        elif text in ("setcasc", "stpcasc"):
            self.streaming = text == "setcasc"
            self._next = self._time + self.interval
        elif text[:3] == "str" and text[3:].isdigit() and int(text[3:]) >= 50:
            self.interval = int(text[3:]) / 1e3
        else:
            return b"\xff\xff"
        return b"OK"
