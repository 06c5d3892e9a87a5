"""Emulated inertial units that see a simulated machine: VN-100 and BNO08x in UART-RVC.

Written from the documents that `twin.plant.devices.vn100` and `.bno08x` cite.
"""

import struct
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from twin.emulate.emulated import EmulatedDevice
from twin.emulate.machine import Share, Simultaneous
from twin.errors import UnknownName
from twin.rotation import multiply, to_euler_zyx

Array = NDArray[np.float64]

FAULTS: Mapping[str, str] = {"frozen": "it repeats its values for `value` seconds"}
_GRAVITY = 9.80665


class EmulatedImu(EmulatedDevice):
    """Sends a message of each instant."""

    def __init__(self, share: Share, baud: int, sources: Collection[str]) -> None:
        """Switch it on; `sources` are what the machine shows it, and the rest stands still."""
        self._share, self.baud = share, baud
        self._instants = Simultaneous(sources)
        self._sent: dict[str, Array] | None = None
        self._now, self._frozen = 0.0, -1.0

    def receive(self, data: bytes, time: float) -> bytes:
        return b""

    def power_cycle(self, time: float) -> None:
        """It has no memory."""

    def inject(self, fault: str, value: float = 0.0) -> None:
        if fault not in FAULTS:
            raise UnknownName("fault of an inertial unit", fault, FAULTS)
        self._frozen = self._now + value

    def advance(self, time: float) -> bytes:
        self._now, out = time, b""
        for instant, values in self._instants.complete(self._share.step({}, time)):
            known = _REST | values
            if time < self._frozen and self._sent is not None:
                known = self._sent
            self._sent = known
            if all(map(_finite, known.values())):
                out += self._packed(instant, known)
        return out

    def _packed(self, time: float, values: Mapping[str, Array]) -> bytes:
        raise NotImplementedError


_REST = {
    "attitude": np.array([1.0, 0.0, 0.0, 0.0]),
    "gyro": np.zeros(3),
    "accelerometer": np.array([0.0, 0.0, _GRAVITY]),
    "magnetometer": np.array([2e-5, 0.0, -4e-5]),
}


def _finite(value: Array) -> bool:
    return bool(np.isfinite(value).all())


class EmulatedBno08x(EmulatedImu):
    """A BNO08x, which says what it has unasked."""

    def __init__(self, share: Share, sources: Collection[str], baud: int = 115200) -> None:
        """Switch it on."""
        super().__init__(share, baud, sources)
        self._index = 0

    def power_cycle(self, time: float) -> None:
        super().power_cycle(time)
        self._index = 0

    def _packed(self, time: float, values: Mapping[str, Array]) -> bytes:
        angles = np.degrees(to_euler_zyx(values["attitude"])) / 0.01
        force = values["accelerometer"] / _GRAVITY / 1e-3
        counts = np.clip(np.round([*angles, *force]), -32768, 32767).astype(int).tolist()
        body = struct.pack("<B6h3x", self._index, *counts)
        self._index = (self._index + 1) % 256
        return b"\xaa\xaa" + body + bytes([sum(body) % 256])


class EmulatedVn100(EmulatedImu):
    """A VN-100, which sends ASCII until it is told to send binary messages."""

    def __init__(self, share: Share, sources: Collection[str], baud: int = 115200) -> None:
        """Switch it on, as from the factory."""
        super().__init__(share, baud, sources)
        self._fields = 0
        self._line = b""

    def power_cycle(self, time: float) -> None:
        super().power_cycle(time)
        self._fields, self._line = 0, b""

    def receive(self, data: bytes, time: float) -> bytes:
        *lines, self._line = (self._line + data).split(b"\n")
        self._line = self._line[-200:]
        return b"".join(self._answered(line.strip()) for line in lines)

    def _answered(self, line: bytes) -> bytes:
        if not line.startswith(b"$") or b"*" not in line:
            return b""
        text, code = line[1:].rsplit(b"*", 1)
        check = 0
        for byte in text:
            check ^= byte
        if code.upper() != b"%02X" % check:
            return self._said(b"VNERR,04")
        match text.split(b","):
            case [b"VNRRG", b"01"]:
                return self._said(b"VNRRG,01,VN-100S-CR")
            case [b"VNWRG", b"06", _]:
                return self._said(text)
            case [b"VNWRG", b"75", mode, divisor, b"01", fields]:
                if not divisor.isdigit() or mode not in (b"1", b"2"):
                    return self._said(b"VNERR,06")
                self._fields = int(fields, 16)
                return self._said(b"VNWRG,75,%s,%s,01,%04X" % (mode, divisor, self._fields))
            case _:
                return self._said(b"VNERR,03")

    @staticmethod
    def _said(text: bytes) -> bytes:
        check = 0
        for byte in text:
            check ^= byte
        return b"$%s*%02X\r\n" % (text, check)

    def _packed(self, time: float, values: Mapping[str, Array]) -> bytes:
        if not self._fields:
            return self._said(b"VNYPR,+000.000,+00.000,+000.000")
        w, x, y, z = multiply(np.array([0.0, -1.0, 0.0, 0.0]), values["attitude"])
        body = struct.pack("<BHQ", 1, self._fields, round(1e9 * time) + 1)
        body += struct.pack("<4f3f3f", x, y, z, w, *values["gyro"], *values["accelerometer"])
        if self._fields & 0x0400:
            body += struct.pack("<5f", *(values["magnetometer"] / 1e-4), 25.0, 101.3)
        return b"\xfa" + body + struct.pack(">H", _crc(body))


def _crc(data: bytes) -> int:
    """UM001, section 4.3.5."""
    crc = 0
    for byte in data:
        crc = (crc >> 8) | (crc << 8) & 0xFFFF
        crc ^= byte
        crc ^= (crc & 0xFF) >> 4
        crc ^= (crc << 12) & 0xFFFF
        crc ^= ((crc & 0xFF) << 5) & 0xFFFF
    return crc
