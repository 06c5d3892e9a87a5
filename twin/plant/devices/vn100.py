"""A session with a VN-100 (VectorNav): set up by its ASCII commands, read by its binary messages.

VN-100 user manual UM001 (firmware 2.1), sections 4.3 and 6: commands are `$VNWRG,75,...*CK`, CK the
exclusive or of all between `$` and `*` in hexadecimal. A binary message is FA, a byte of groups, a
u16 of fields for each group, the fields in their order, little-endian, and big-endian CRC-16
(polynomial 0x1021, start 0) of all behind FA. Of group 1 are used: time since start (u64 ns,
bit 0), quaternion (four floats, scalar last, NED from body, bit 4), angular rate (rad/s, bit 5),
acceleration (m/s^2, bit 8), and the field [Gauss], temperature and pressure (bit 10).
"""

import binascii
import struct
import time
from dataclasses import dataclass

import numpy as np

from twin.errors import DeviceError, UsageError
from twin.plant.devices.counters import Counters
from twin.plant.devices.device import DeviceSettings, Sample, StreamLimits
from twin.plant.devices.port import Port
from twin.plant.devices.sensor import SensorSession
from twin.plant.devices.xbus import Promptest
from twin.rotation import multiply
from twin.units import STANDARD_GRAVITY

SYNC = b"\xfa"
FASTEST = 800
"""Of its sensors [Hz]; messages come at whole parts of it."""
MOTION, FIELD = 0x0131, 0x0400
"""Fields of group 1: time, attitude, rate and acceleration; and the magnetometer's."""
_MOTION = struct.Struct("<Q4f3f3f")
_FIELD = struct.Struct("<5f")
_GAUSS = 1e-4
"""[T]."""
_ROOM_FROM_NED = np.array([0.0, 1.0, 0.0, 0.0])
_ANSWER, _TRIES = 0.25, 8
_LONGEST_ANSWER = 512


def checked(command: str) -> bytes:
    """An ASCII command with its checksum and end."""
    code = 0
    for byte in command.encode("ascii"):
        code ^= byte
    return f"${command}*{code:02X}\r\n".encode("ascii")


def decode_answer(line: bytes) -> str | None:
    """The text of an ASCII answer `$...*CK`; None: not one, or damaged."""
    start, star = line.rfind(b"$"), line.rfind(b"*")
    if start < 0 or star < start:
        return None
    text = line[start + 1 : star]
    if not text.isascii() or checked(text.decode("ascii")).rstrip() != line[start:].strip():
        return None
    return text.decode("ascii")


class BinaryParser:
    """Finds messages of one kind in bytes; keeps at most an unfinished one."""

    def __init__(self, counters: Counters, fields: int) -> None:
        """`fields` of group 1."""
        self._counters = counters
        self._head = SYNC + struct.pack("<BH", 1, fields)
        size = _MOTION.size + (_FIELD.size if fields & FIELD else 0)
        self.length = len(self._head) + size + 2
        """Of a message, its checksum included."""
        self._buffer = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Payload of each whole message."""
        self._buffer += data
        payloads: list[bytes] = []
        while (at := self._buffer.find(self._head)) >= 0:
            if at:
                self._counters.resyncs += 1
                self._buffer = self._buffer[at:]
            if len(self._buffer) < self.length:
                return payloads
            # a checksum behind its own bytes leaves nothing
            if binascii.crc_hqx(self._buffer[1 : self.length], 0) == 0:
                self._counters.frames += 1
                payloads.append(self._buffer[len(self._head) : self.length - 2])
                self._buffer = self._buffer[self.length :]
            else:
                self._counters.bad_checksums += 1
                self._buffer = self._buffer[1:]
        self._buffer = self._buffer[-len(self._head) + 1 :]
        return payloads


@dataclass(frozen=True, kw_only=True)
class Vn100Settings(DeviceSettings):
    """A VN-100 on a serial port."""

    baud: int = 115200
    rate: int = 100
    """Of all streams [Hz], a whole part of 800."""
    magnetometer: bool = False
    """Send the field too."""
    serial_port: int = 1
    """Which of the unit's two this line is."""
    silence: float = 0.25
    """So long without a message [s] is said to be silence."""

    def __post_init__(self) -> None:
        """Hold the parts against each other.

        Raises:
            UsageError: a rate that it has not, or a line that cannot carry it.
        """
        if self.rate < 1 or FASTEST % self.rate:
            raise UsageError(f"{self.name}: {self.rate} Hz is no whole part of {FASTEST} Hz")
        if self.serial_port not in (1, 2):
            raise UsageError(f"{self.name}: it has serial ports 1 and 2, not {self.serial_port}")
        load = 10 * BinaryParser(Counters(), self.fields).length * self.rate / self.baud
        if load > 0.95:
            raise UsageError(
                f"{self.name}: {self.rate} Hz need {100 * load:.0f} % of a line of {self.baud} "
                "baud; lower the rate, or raise the baud rate"
            )

    @property
    def fields(self) -> int:
        """Bits of group 1 that are asked for."""
        return MOTION | (FIELD if self.magnetometer else 0)

    def session(self) -> "Vn100":
        """A session with this device, not yet connected."""
        return Vn100(self)

    def limits(self) -> dict[str, StreamLimits]:
        """Full scales of its sensors (UM001, section 2)."""
        return {
            "gyro": StreamLimits(range=np.radians(2000.0)),
            "accelerometer": StreamLimits(range=16.0 * STANDARD_GRAVITY),
            "attitude": StreamLimits(range=1.01),
            "magnetometer": StreamLimits(range=2.5 * _GAUSS),
        }


class Vn100(SensorSession):
    """Measures `gyro`, `accelerometer`, `attitude` (z up) and, if asked for, `magnetometer`."""

    def __init__(self, settings: Vn100Settings) -> None:
        streams = {"gyro": 3, "accelerometer": 3, "attitude": 4}
        super().__init__(
            settings.name,
            settings.port,
            baud=settings.baud,
            stop_bits=1,
            streams={**streams, "magnetometer": 3} if settings.magnetometer else streams,
            silence=settings.silence,
        )
        self._settings = settings
        self._parser = BinaryParser(self.counters, settings.fields)
        self._promptest = Promptest()
        self._stamp = 0

    def _greet(self, port: Port) -> None:
        self.identity = self._ask(port, "VNRRG,01").rpartition(",")[2]

    def _set_up(self, port: Port) -> None:
        wanted = self._settings
        self._ask(port, "VNWRG,06,0")
        divisor = FASTEST // wanted.rate
        set_to = f"VNWRG,75,{wanted.serial_port},{divisor},01,{wanted.fields:04X}"
        answer = self._ask(port, set_to)
        if [part.lstrip("0") for part in answer.split(",")] != [
            part.lstrip("0") for part in set_to.split(",")
        ]:
            raise DeviceError(self.name, f"was told {set_to}, and says {answer}", "change the rate")
        self._parser = BinaryParser(self.counters, wanted.fields)
        self._promptest.forget()
        self._stamp = 0

    def _ask(self, port: Port, command: str) -> str:
        """Its answer; messages on the way are left out.

        Raises:
            DeviceError: it refuses, or says nothing.
        """
        name, kept, came = command[:8], b"", 0
        for _ in range(_TRIES):
            port.write(checked(command))
            deadline = time.monotonic() + _ANSWER
            while time.monotonic() < deadline:
                data = port.read(_ANSWER / 5)
                came += len(data)
                *lines, kept = (kept + data).split(b"\n")
                kept = kept[-_LONGEST_ANSWER:]
                for line in lines:
                    answer = decode_answer(line) or ""
                    if answer.startswith("VNERR"):
                        problem = f"refuses {command}: error {answer.rpartition(',')[2]}"
                        raise DeviceError(self.name, problem, "change the settings")
                    if answer.startswith(name):
                        return answer
            self.counters.timeouts += 1
        guess = f"is it at {self._settings.baud} baud?" if came else "is it powered and wired?"
        problem = f"no answer to {command} on {port.url}, {came} bytes came"
        raise DeviceError(self.name, problem, guess)

    def _listen(self, port: Port) -> None:
        payloads = self._parser.feed(port.read(0.05))
        now = time.monotonic()
        for payload in payloads:
            stamp, *values = _MOTION.unpack_from(payload)
            step = (stamp - self._stamp) * 1e-9 * self._settings.rate
            if self._stamp and stamp == self._stamp:
                self.counters.repeats += 1
                continue
            if self._stamp and 1.0 < step < 1e6:
                self.counters.gaps += round(step) - 1
            elif self._stamp and step < 0.0:
                self.notes.append(f"{self.name}: its clock begins anew")
                self._promptest.forget()
            self._stamp = stamp
            latency = self._parser.length * port.byte_time
            taken = self._promptest.host(stamp * 1e-9, now - latency)
            x, y, z, w = values[:4]
            streams = {
                "attitude": tuple(multiply(_ROOM_FROM_NED, np.array([w, x, y, z])).tolist()),
                "gyro": tuple(values[4:7]),
                "accelerometer": tuple(values[7:10]),
            }
            if self._settings.magnetometer:
                field = _FIELD.unpack_from(payload, _MOTION.size)[:3]
                streams["magnetometer"] = tuple(_GAUSS * each for each in field)
            for name, value in streams.items():
                sample = Sample(
                    name, value, taken + latency, latency=latency, device_time=stamp * 1e-9
                )
                self._keep(sample)
