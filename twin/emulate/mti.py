"""An Xsens MTi on its serial line, from the vendor's tables of messages and data identifiers."""

import math
import random
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.emulate.emulated import EmulatedDevice
from twin.errors import UnknownName

FAULTS: Mapping[str, str] = {
    "bad_checksum": "the next frames have a wrong checksum (value: how many)",
    "truncated": "the next frames end early (value: how many)",
    "inner_preamble": "from now on data contains FA FF, as the temperature",
    "drop_packets": "the next packets are not sent (value: how many)",
    "duplicate_packets": "the next packets are sent twice (value: how many)",
    "time_wrap": "the sample time is set to shortly before it wraps",
    "time_step_back": "the sample time goes back (value: ticks)",
    "restart": "it boots of itself, and wakes up",
    "error": "it sends an error message (value: the code)",
    "not_a_number": "the gyro gives NaN from now on",
    "saturated": "the gyro gives its full scale from now on",
    "frozen": "values stand still while the counter runs",
    "well": "the values are sound again",
    "baud": "it talks at another rate (value: baud)",
}
"""What can go wrong inside it -> what then happens."""

_SIZES = {0x1020: 2, 0x1060: 4, 0x1070: 4, 0x10A0: 8, 0x10B0: 4, 0x3010: 4, 0xE010: 1, 0xE020: 4}
"""Items that are whole numbers."""
_REAL_ITEMS = {0x0810: 1, 0x2010: 4, 0x2030: 3, 0x4020: 3, 0x8020: 3, 0xC020: 3}
"""Items of real numbers that this unit has, and how many they are."""
_WITH_EVERY_PACKET = (0x1020, 0x1060, 0x1070, 0x10A0, 0x10B0, 0xE010, 0xE020)
_FACTORY_OUTPUTS = ((0x1020, 0xFFFF), (0x1060, 0xFFFF), (0x4020, 100), (0x8020, 100), (0xC020, 100))
_NOT_KNOWN, _NOT_A_PARAMETER, _TOO_MUCH = 0x04, 0x21, 0x29
_BAUD = {0x02: 115200, 0x01: 230400, 0x00: 460800, 0x80: 921600, 0x0A: 921600, 0x05: 38400}


def frame(message: int, data: bytes = b"") -> bytes:
    """A whole frame."""
    length = bytes([len(data)]) if len(data) < 255 else struct.pack(">BH", 255, len(data))
    inner = b"\xff" + bytes([message]) + length + data
    return b"\xfa" + inner + bytes([(256 - sum(inner) % 256) % 256])


def number(value: float, code: int) -> bytes:
    """A real number in the format that the two lowest bits of a data identifier name."""
    if code == 0:
        return struct.pack(">f", value)
    if code in (1, 2) and not math.isfinite(value):
        value = -2048.0  # fixed point has no NaN: the lowest number of fp12.20
    if code == 1:
        return struct.pack(">i", round(value * 1048576))
    if code == 3:
        return struct.pack(">d", value)
    six = (round(value * 4294967296) & 0xFFFFFFFFFFFF).to_bytes(6, "big")
    return six[2:] + six[:2]


@dataclass
class EmulatedMti(EmulatedDevice):
    """One unit at rest, with noise; set `values` to move it."""

    baud: int = 115200
    device_id: int = 0x03880011
    has_orientation: bool = False
    """MTi-1: no; what such a unit answers to a request for it is not known, this one refuses."""
    wake_window: float = 0.5
    """How long it waits at boot for the acknowledgement [s]; not known for certain."""
    latency: float = 0.002
    """From a request to its answer [s]."""
    seed: int = 0
    on_the_beat: bool = False
    """It samples at whole periods of the time of its line, independent of its start."""
    values: dict[int, tuple[float, ...]] = field(
        default_factory=lambda: {
            0x0810: (25.0,),
            0x2010: (1.0, 0.0, 0.0, 0.0),
            0x2030: (0.0, 0.0, 0.0),
            0x4020: (0.0, 0.0, 9.81),
            0x8020: (0.01, -0.02, 0.03),
            0xC020: (0.5, 0.0, 0.5),
        }
    )
    """Data identifier -> mean value, in the units of the line."""
    noise: Mapping[int, float] = field(
        default_factory=lambda: {0x4020: 0.002, 0x8020: 1e-4, 0xC020: 1e-3, 0x0810: 0.01}
    )

    def __post_init__(self) -> None:
        self._chance = random.Random(self.seed)
        self._stored = list(_FACTORY_OUTPUTS)
        self._inbox = bytearray()
        self._outbox: list[tuple[float, bytes]] = []
        self._counts = dict.fromkeys(FAULTS, 0)
        self._ill = ""
        self._tick_offset = 0
        self._next_baud: int | None = None
        self._boot(0.0)

    def power_cycle(self, time: float) -> None:
        self._inbox.clear()
        self._outbox.clear()
        self._boot(time)

    def inject(self, fault: str, value: float = 0.0) -> None:
        if fault not in FAULTS:
            raise UnknownName("fault of an MTi", fault, FAULTS)
        if fault in ("not_a_number", "saturated", "frozen", "well"):
            self._ill = "" if fault == "well" else fault
            self._still = dict(self._last)
        elif fault == "time_wrap":
            self._tick_offset = 0xFFFFFFFF - 500 - round(1e4 * self._time)
        elif fault == "time_step_back":
            self._tick_offset -= int(value)
        elif fault == "restart":
            self._boot(self._time)
        elif fault == "error":
            self._outbox.append((self._time, frame(0x42, bytes([int(value)]))))
        elif fault == "baud":
            self.baud = int(value)
        elif fault == "inner_preamble":
            self._counts[fault] = 1
        else:
            self._counts[fault] += int(value) or 1

    def receive(self, data: bytes, time: float) -> bytes:
        self._time = time
        self._inbox += data
        while self._inbox:
            if self._inbox[0] != 0xFA:
                del self._inbox[0]
                continue
            if len(self._inbox) < 5:
                break
            whole = 5 + self._inbox[3]
            if self._inbox[3] == 255 or sum(self._inbox[1:whole]) % 256:
                if self._inbox[3] != 255 and len(self._inbox) < whole:
                    break
                del self._inbox[0]
                continue
            if len(self._inbox) < whole:
                break
            self._obey(self._inbox[2], bytes(self._inbox[4 : whole - 1]), time)
            del self._inbox[:whole]
        return b""

    def advance(self, time: float) -> bytes:
        self._time = time
        if self._state == "waking" and time >= self._wakes_until:
            self._measure(time)
        while self._state == "measurement" and self._next_packet <= time:
            self._outbox.append((self._next_packet, self._packet(self._next_packet)))
            self._sent += 1
            self._next_packet = self._first_packet + self._sent / self._rate
        out = b"".join(data for due, data in self._outbox if due <= time)
        self._outbox = [(due, data) for due, data in self._outbox if due > time]
        return out

    def _boot(self, time: float) -> None:
        self._time = time
        self._state = "waking"
        # a new rate holds from the next start on
        self.baud, self._next_baud = self._next_baud or self.baud, None
        self._outputs = list(self._stored)
        self._wakes_until = time + self.wake_window
        self._packets, self._started = 0, time
        self._last: dict[int, tuple[float, ...]] = {}
        self._still: dict[int, tuple[float, ...]] = {}
        self._outbox.append((time, frame(0x3E)))

    def _measure(self, time: float) -> None:
        self._state = "measurement"
        rates = [rate for _, rate in self._outputs if 0 < rate < 0xFFFF]
        self._rate = max(rates, default=100)
        first = time + 1.0 / self._rate
        if self.on_the_beat:
            first = math.ceil(first * self._rate - 1e-6) / self._rate
        self._first_packet = self._next_packet = first
        self._sent = 0

    def _obey(self, message: int, data: bytes, time: float) -> None:
        if message == 0x3F and self._state == "waking":
            self._state = "config"
            return
        if message == 0x30:
            self._state = "config"
            self._answer(time, 0x31)
        elif message == 0x40:
            self._answer(time, 0x41)
            self._boot(time + self.latency)
        elif self._state != "config":
            # outside Config such requests are not valid
            return
        elif message == 0x10:
            self._answer(time, 0x11)
            self._stored = list(self._outputs)
            self._measure(time + self.latency)
        elif message == 0x00:
            self._answer(time, 0x01, self.device_id.to_bytes(4, "big"))
        elif message == 0x12:
            self._answer(time, 0x13, bytes([1, 9, 0]))
        elif message == 0x18:
            known = len(data) == 1 and data[0] in _BAUD
            self._answer(time, 0x19 if known else 0x42, b"" if known else b"\x20")
            self._next_baud = _BAUD.get(data[0]) if known else None
        elif message == 0xC0:
            self._configure(data, time)
        else:
            self._answer(time, 0x42, bytes([_NOT_KNOWN]))

    def _answer(self, time: float, message: int, data: bytes = b"") -> None:
        self._outbox.append((time + self.latency, frame(message, data)))

    def _configure(self, data: bytes, time: float) -> None:
        if data and len(data) % 4 == 0:
            wanted = [struct.unpack_from(">HH", data, k) for k in range(0, len(data), 4)]
            kinds = [identifier & 0xFFF0 for identifier, _ in wanted]
            lacking = [k for k in kinds if k not in _SIZES and k not in _REAL_ITEMS]
            if not self.has_orientation:
                lacking += [k for k in kinds if k & 0xF000 == 0x2000]
            if lacking or len(wanted) > 32:
                self._answer(time, 0x42, bytes([_NOT_A_PARAMETER]))
                return
            rates = [rate for _, rate in wanted if 0 < rate < 0xFFFF]
            size = 5 + sum(3 + self._size(identifier) for identifier, _ in wanted)
            if size * 10 * max(rates, default=100) > self.baud:
                self._answer(time, 0x42, bytes([_TOO_MUCH]))
                return
            self._outputs = [
                (identifier, 0xFFFF if identifier & 0xFFF0 in _WITH_EVERY_PACKET else rate)
                for identifier, rate in wanted
            ]
        listed = b"".join(struct.pack(">HH", *each) for each in self._outputs)
        self._answer(time, 0xC1, listed)

    @staticmethod
    def _size(identifier: int) -> int:
        kind = identifier & 0xFFF0
        if kind in _SIZES:
            return _SIZES[kind]
        return _REAL_ITEMS[kind] * (4, 4, 6, 8)[identifier & 3]

    def _packet(self, time: float) -> bytes:
        self._packets += 1
        data = b""
        for identifier, rate in self._outputs:
            kind = identifier & 0xFFF0
            every = 1 if rate in (0, 0xFFFF) else max(1, round(self._rate / rate))
            if self._sent % every:
                continue
            inner = self._whole(kind, time) if kind in _SIZES else self._reals(identifier)
            data += struct.pack(">HB", identifier, len(inner)) + inner
        if self._take("drop_packets"):
            return b""
        out = frame(0x36, data)
        if self._take("bad_checksum"):
            out = out[:-1] + bytes([out[-1] ^ 0x55])
        if self._take("truncated"):
            out = out[: len(out) // 2]
        return out + out if self._take("duplicate_packets") else out

    def _take(self, fault: str) -> bool:
        due = self._counts[fault] > 0
        self._counts[fault] -= due
        return due

    def _whole(self, kind: int, time: float) -> bytes:
        ticks = round((time - self._started) * 1e4) + self._tick_offset
        value = {
            0x1020: self._packets & 0xFFFF,
            0x10B0: self._packets & 0xFFFFFFFF,
            0x1060: ticks & 0xFFFFFFFF,
            0x1070: ticks // 10000 & 0xFFFFFFFF,
            0x10A0: ticks & 0xFFFFFFFFFFFFFFFF,
            0x3010: 101325,
        }.get(kind, 0)
        return value.to_bytes(_SIZES[kind], "big")

    def _reals(self, identifier: int) -> bytes:
        kind = identifier & 0xFFF0
        noise = self.noise.get(kind, 0.0)
        values = tuple(each + self._chance.gauss(0.0, noise) for each in self.values[kind])
        if self._ill == "frozen":
            values = self._still.get(kind, values)
        if kind == 0x8020 and self._ill == "not_a_number":
            values = (math.nan,) * 3
        if kind == 0x8020 and self._ill == "saturated":
            values = (math.radians(2000.0), 0.0, 0.0)
        self._last[kind] = values
        if kind == 0x0810 and self._counts["inner_preamble"]:
            return b"\x41\xfa\xff\x36"[: self._size(identifier)].ljust(self._size(identifier))
        return b"".join(number(each, identifier & 3) for each in values)
