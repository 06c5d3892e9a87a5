"""A session with a SOLAR-2 inclinometer: asked again and again, or listening to its stream.

Commands and replies of the SOLAR-2 inclinometer (Level Developments). Bytes and values.
Commands are seven characters without an end. Replies carry no checksum: a binary one is two big-
endian 32-bit numbers of thousandths of a degree, one in text two numbers of eight characters.
The data sheet is not public; this is what working programs for the same family do.
"""

import contextlib
import math
import re
import struct
import time
from dataclasses import dataclass
from typing import Literal

from twin.errors import DeviceError, UsageError
from twin.plant.devices.device import DeviceSettings, Sample, StreamLimits, missing
from twin.plant.devices.port import Port
from twin.plant.devices.sensor import SensorSession

READ = b"get-x&y"
START = b"setcasc"
STOP = b"stpcasc"
BINARY_REPLY = 8
TEXT_REPLY = 18
SHORTEST_INTERVAL, LONGEST_INTERVAL = 50, 9999
"""Of the stream [ms]."""
_TO_RADIANS = math.pi / 180.0
_PAIR = struct.Struct(">ii")
_NUMBER = re.compile(rb"[ +-]?[ ]*\d+\.\d+")
_WIDTH = 8
_LONGEST_LINE = 64

Angles = tuple[float, float]


def interval(milliseconds: int) -> bytes:
    """The command that sets the interval of the stream; the unit keeps it without power.

    Raises:
        ValueError: not 50 to 9999 ms.
    """
    if not SHORTEST_INTERVAL <= milliseconds <= LONGEST_INTERVAL:
        raise ValueError(
            f"an interval of {milliseconds} ms; the unit has {SHORTEST_INTERVAL} to "
            f"{LONGEST_INTERVAL} ms"
        )
    return b"str%04d" % milliseconds


def decode_binary(reply: bytes) -> Angles | None:
    """First and second angle [rad]; None: not of the length of a reply."""
    if len(reply) != BINARY_REPLY:
        return None
    first, second = _PAIR.unpack(reply)
    return first * 1e-3 * _TO_RADIANS, second * 1e-3 * _TO_RADIANS


def decode_text(line: bytes) -> Angles | None:
    """First and second angle [rad] of a line without its end; None: not two such numbers."""
    if len(line) != 2 * _WIDTH + 1:
        return None
    first, separator, second = line[:_WIDTH], line[_WIDTH : _WIDTH + 1], line[_WIDTH + 1 :]
    if separator.isdigit() or not (_NUMBER.fullmatch(first) and _NUMBER.fullmatch(second)):
        return None
    return (
        float(first.replace(b" ", b"")) * _TO_RADIANS,
        float(second.replace(b" ", b"")) * _TO_RADIANS,
    )


class LineParser:
    """Splits a stream of text into lines; keeps at most one unfinished line."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._skipping = False
        self.skipped = 0
        """Lines too long to be any, thrown away."""

    def feed(self, data: bytes) -> list[bytes]:
        """Lines that are complete with these bytes, without their ends and without empty ones."""
        self._buffer += data.replace(b"\r", b"\n")
        *lines, rest = self._buffer.split(b"\n")
        if self._skipping and lines:
            # the end of a line whose beginning is gone
            lines, self._skipping = lines[1:], False
        self._buffer = rest
        if len(rest) > _LONGEST_LINE:
            self._buffer = bytearray()
            self.skipped += not self._skipping
            self._skipping = True
        return [bytes(line) for line in lines if line]


def describe(reply: bytes, expected: str) -> str:
    """What a reply that is not the one expected tells about the unit."""
    if not reply:
        return "no answer; is it powered, and at this baud rate?"
    if b"$PLDL" in reply or reply.startswith(b"$"):
        return "it talks NMEA; send `$PLDL100,1*38` once to bring it back to its own commands"
    if reply.startswith(b"\xff\xff"):
        return "it does not know the command; is it a single-axis unit?"
    text = all(32 <= byte < 127 or byte in b"\r\n" for byte in reply)
    if text and expected == "binary" and len(reply) >= BINARY_REPLY:
        return "it answers in text; set the mode to text"
    if not text and expected == "text" and len(reply) == BINARY_REPLY:
        return "it answers in binary; set the mode to binary"
    return f"{len(reply)} bytes that are no answer ({reply[:8].hex(' ')})"


_STREAM = "inclinometer"
_STEP = math.radians(1e-3)
"""Of the numbers in its replies [rad]."""
_ANSWER = 0.1
"""How long an answer may take [s]; 4 ms on the line at 38,400 baud, and the sensor's own time."""
_FORGETS = 0.12
"""After that long without a character [s] the unit has forgotten half a command."""
_TRIES = 3


@dataclass(frozen=True, kw_only=True)
class Solar2Settings(DeviceSettings):
    """A SOLAR-2 on a serial port."""

    baud: int = 38400
    mode: Literal["binary", "text", "stream"] = "binary"
    """In which form it answers; `stream`: it sends text of itself."""
    rate: float = 20.0
    """Samples a second [Hz]; asked for, or expected of the stream."""
    x_first: bool = True
    """X stands first in a reply. Programs in use disagree: tilt it about one axis to see."""
    read_twice: bool = True
    """Ask twice for each sample, and take it if both agree: a reply has no checksum."""
    agreement: float = math.radians(0.2)
    """Largest difference of two readings a few milliseconds apart [rad]."""
    full_scale: float = math.radians(30.0)
    """[rad]; from there on a value is not valid."""
    largest_step: float = math.radians(3.0)
    """Between two samples that the machine can make [rad]."""
    frozen_after: int = 200
    """So many equal values in a row mean that the sensor has stopped; 0: never."""
    start_stream: bool = False
    """Set interval and start the stream, which the unit remembers without power; otherwise it is
    expected to stream already."""
    silence: float = 0.5
    """So long without a sample [s] is said to be silence."""

    def __post_init__(self) -> None:
        """Hold the parts against each other.

        Raises:
            UsageError: a rate that the unit or the line cannot give.
        """
        size = BINARY_REPLY if self.mode == "binary" else TEXT_REPLY
        each = 10 * (size + len(READ)) * (1 + self.read_twice) / self.baud + 0.01
        streams = self.mode == "stream"
        slowest = 1e3 / LONGEST_INTERVAL if streams and self.start_stream else 0.1
        fastest = 1e3 / SHORTEST_INTERVAL if streams else 1.0 / each
        if not slowest <= self.rate <= fastest:
            raise UsageError(
                f"{self.name}: {self.rate:g} Hz; in mode {self.mode} at {self.baud} baud it gives "
                f"{slowest:.5g} to {fastest:.0f} Hz"
            )

    def session(self) -> "Solar2":
        """A session with this device, not yet connected."""
        return Solar2(self)

    def limits(self) -> dict[str, StreamLimits]:
        """Of its angles: replies have no checksum, so steps are bounded."""
        return {
            _STREAM: StreamLimits(
                range=self.full_scale,
                largest_step=self.largest_step,
                frozen_after=self.frozen_after,
                resolution=_STEP,
                first_confirmed=math.isfinite(self.largest_step),
            )
        }


class Solar2(SensorSession):
    """A SOLAR-2 that measures; `inclinometer` is its X and Y angle."""

    def __init__(self, settings: Solar2Settings) -> None:
        super().__init__(
            settings.name,
            settings.port,
            baud=settings.baud,
            stop_bits=1,
            streams={_STREAM: 2},
            silence=max(settings.silence, 3.0 / settings.rate),
        )
        self._settings = settings
        self._lines = LineParser()
        self._next = 0.0

    def _greet(self, port: Port) -> None:
        self._lines = LineParser()
        reply = b""
        for _ in range(_TRIES):
            if self._settings.mode == "stream":
                if self._settings.start_stream:
                    port.write(interval(round(1e3 / self._settings.rate)))
                    port.read(_ANSWER)
                    port.write(START)
                angles, reply = self._overhear(port)
            else:
                angles, reply = self._ask(port)
            if angles is not None:
                return
            port.read(_FORGETS)
        problem = describe(reply, "binary" if self._settings.mode == "binary" else "text")
        raise DeviceError(self.name, f"no angles on {port.url}", problem)

    def _set_up(self, port: Port) -> None:
        """Its settings outlive the power: none is written that nobody asked for."""
        self._next = time.monotonic()

    def close(self) -> None:
        self._end_worker()
        if self._port is not None and self._settings.start_stream and not self.fault:
            with contextlib.suppress(DeviceError):
                self._port.write(STOP)
        super().close()

    def _listen(self, port: Port) -> None:
        if self._settings.mode == "stream":
            self._follow(port)
            return
        wait = self._next - time.monotonic()
        if wait > 0.0:
            time.sleep(min(wait, 0.05))
            return
        period = 1.0 / self._settings.rate
        # what was missed is not caught up
        self._next += period * max(1, math.ceil((time.monotonic() - self._next) / period))
        angles, reply = self._ask(port)
        reason = ""
        if angles is not None and self._settings.read_twice:
            again, reply = self._ask(port)
            if again is None:
                angles = None
            elif max(abs(a - b) for a, b in zip(angles, again, strict=True)) > (
                self._settings.agreement
            ):
                reason = "two readings disagree"
            else:
                angles = again
        if angles is None:
            self.counters.timeouts += not reply
            self.counters.resyncs += bool(reply)
            why = describe(reply, self._settings.mode)
            self._queue.put(missing(_STREAM, 2, time.monotonic(), f"{self.name}: {why}"))
            time.sleep(_FORGETS)
            return
        self._judge(angles, len(reply) * port.byte_time, reason)

    def _follow(self, port: Port) -> None:
        for line in self._lines.feed(port.read(0.05)):
            angles = decode_text(line)
            if angles is None:
                self.counters.resyncs += 1
            else:
                self._judge(angles, TEXT_REPLY * port.byte_time, "")

    def _judge(self, angles: Angles, latency: float, reason: str) -> None:
        """Keep what has come."""
        self.counters.frames += 1
        value = angles if self._settings.x_first else (angles[1], angles[0])
        self._keep(
            Sample(
                _STREAM,
                value,
                time.monotonic(),
                latency=latency,
                valid=not reason,
                reason=f"{self.name}: {reason}" if reason else "",
            )
        )

    def _ask(self, port: Port) -> tuple[Angles | None, bytes]:
        """Angles, and the bytes of the reply."""
        port.waiting()
        port.write(READ)
        binary = self._settings.mode == "binary"
        size = BINARY_REPLY if binary else TEXT_REPLY
        reply, deadline = b"", time.monotonic() + _ANSWER
        while len(reply) < size and time.monotonic() < deadline:
            reply += port.read(_ANSWER / 4)
        if binary:
            angles = decode_binary(reply)
            # text read as numbers is some 700,000 degrees
            if angles is not None and max(map(abs, angles)) > math.pi:
                return None, reply
            return angles, reply
        return decode_text(reply.rstrip(b"\r\n")), reply

    def _overhear(self, port: Port) -> tuple[Angles | None, bytes]:
        """First angles of the stream, and all bytes until then."""
        heard, deadline = b"", time.monotonic() + 2.0 / self._settings.rate + _ANSWER
        while time.monotonic() < deadline:
            data = port.read(0.05)
            heard += data
            for line in self._lines.feed(data):
                angles = decode_text(line)
                if angles is not None:
                    return angles, heard
        return None, heard
