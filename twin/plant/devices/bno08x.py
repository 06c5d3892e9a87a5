"""A session with a BNO08x (Bosch, CEVA/Hillcrest) in its mode UART-RVC.

BNO080 data sheet 1000-3927, section 1.3.5.2: 100 packets a second at 115,200 baud, unasked, each of
19 bytes, little-endian: AA AA, u8 index, yaw, pitch and roll as i16 of 0.01 deg, acceleration along
X, Y and Z as i16 of 1e-3 g, three reserved bytes, and the sum of all behind the header modulo 256.
The rotations are about Z, then Y, then X. There is no gyro in it, and nothing can be set.
"""

import struct
import time
from dataclasses import dataclass

import numpy as np

from twin.errors import DeviceError
from twin.plant.devices.counters import Counters
from twin.plant.devices.device import DeviceSettings, Sample, StreamLimits
from twin.plant.devices.port import Port
from twin.plant.devices.sensor import SensorSession
from twin.rotation import from_euler_zyx
from twin.units import STANDARD_GRAVITY

HEADER = b"\xaa\xaa"
RATE = 100.0
"""[Hz]."""
_PACKET = struct.Struct("<B3h3h3xB")
LENGTH = len(HEADER) + _PACKET.size
_ANGLE = np.radians(0.01)
_ACCELERATION = 1e-3 * STANDARD_GRAVITY
_GREETING = 1.0
"""How long a first packet may take [s]: a unit needs some 0.5 s after its reset."""


class RvcParser:
    """Finds packets in bytes; keeps at most an unfinished one."""

    def __init__(self, counters: Counters) -> None:
        self._counters = counters
        self._buffer = b""

    def feed(self, data: bytes) -> list[tuple[int, ...]]:
        """Index, three angles and three accelerations, as counted, of each whole packet."""
        self._buffer += data
        packets: list[tuple[int, ...]] = []
        while (at := self._buffer.find(HEADER)) >= 0:
            if at:
                self._counters.resyncs += 1
                self._buffer = self._buffer[at:]
            if len(self._buffer) < LENGTH:
                return packets
            body = self._buffer[len(HEADER) : LENGTH]
            if sum(body[:-1]) & 0xFF == body[-1]:
                self._counters.frames += 1
                packets.append(_PACKET.unpack(body)[:-1])
                self._buffer = self._buffer[LENGTH:]
            else:
                # the header may have stood in the data of another
                self._counters.bad_checksums += 1
                self._buffer = self._buffer[1:]
        self._buffer = self._buffer[-1:] if self._buffer.endswith(HEADER[:1]) else b""
        return packets


@dataclass(frozen=True, kw_only=True)
class Bno08xSettings(DeviceSettings):
    """A BNO08x whose pins select UART-RVC (PS1 low, PS0 high)."""

    baud: int = 115200
    silence: float = 0.25
    """So long without a packet [s] is said to be silence."""

    def session(self) -> "Bno08x":
        """A session with this device, not yet connected."""
        return Bno08x(self)

    def limits(self) -> dict[str, StreamLimits]:
        """Steps of its numbers; a checksum of eight bits lets one message in 256 through."""
        return {
            "attitude": StreamLimits(range=1.01, resolution=_ANGLE / 2),
            "accelerometer": StreamLimits(range=32.0 * STANDARD_GRAVITY, resolution=_ACCELERATION),
        }


class Bno08x(SensorSession):
    """Measures `attitude` (z up, heading from where it was switched on) and `accelerometer`."""

    def __init__(self, settings: Bno08xSettings) -> None:
        super().__init__(
            settings.name,
            settings.port,
            baud=settings.baud,
            stop_bits=1,
            streams={"attitude": 4, "accelerometer": 3},
            silence=settings.silence,
        )
        self._parser = RvcParser(self.counters)
        self._index: int | None = None

    def _greet(self, port: Port) -> None:
        self._parser = RvcParser(self.counters)
        end, came = time.monotonic() + _GREETING, 0
        while time.monotonic() < end:
            data = port.read(0.05)
            came += len(data)
            if self._parser.feed(data):
                return
        guess = "is it in UART-RVC, and at 115200 baud?" if came else "is it powered?"
        raise DeviceError(self.name, f"no packet on {port.url}: {came} bytes came", guess)

    def _set_up(self, port: Port) -> None:
        self._index = None

    def _listen(self, port: Port) -> None:
        packets = self._parser.feed(port.read(0.05))
        now = time.monotonic()
        for place, (index, *counts) in enumerate(packets):
            if self._index is not None:
                step = (index - self._index) & 0xFF
                if step == 0:
                    self.counters.repeats += 1
                    continue
                self.counters.gaps += step - 1
            self._index = index
            # of several that came at once the last is new, and each before it a period older
            age = LENGTH * port.byte_time + (len(packets) - 1 - place) / RATE
            yaw, pitch, roll = (np.array(_ANGLE * count) for count in counts[:3])
            attitude = from_euler_zyx(yaw, pitch, roll)
            force = tuple(_ACCELERATION * count for count in counts[3:])
            self._keep(Sample("attitude", tuple(attitude.tolist()), now, latency=age))
            self._keep(Sample("accelerometer", force, now, latency=age))
