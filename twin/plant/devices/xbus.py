"""The Xbus protocol of Xsens (Movella) trackers: frames, data and counters, as bytes and values.

Frames of the Xbus protocol: FA FF, message, length, data, checksum. Bytes in, messages out.
The checksum makes the sum of all bytes after the preamble a multiple of 256, so one corrupt frame
in 256 passes it. Nothing is stuffed: FA FF may stand inside data, and after a bad frame the search
begins again one byte behind its preamble.

What the Xbus protocol of Xsens (Movella) motion trackers is made of, as data.
From the vendor's public sources (message, data and baud-rate identifiers of its `xspublic` library)
and from Python drivers in use for the error codes.
"""

import math
import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

from twin.plant.devices.device import Counters

_START = b"\xfa\xff"
_EXTENDED = 0xFF
LONGEST = 2048
"""Bytes of data in one frame."""


@dataclass(frozen=True, slots=True)
class XbusMessage:
    """One frame that passed its check."""

    identifier: int
    data: bytes = b""


def encode(message: XbusMessage) -> bytes:
    """The bytes of a message.

    Raises:
        ValueError: more data than a frame holds.
    """
    size = len(message.data)
    if size > LONGEST:
        raise ValueError(f"{size} bytes of data: a frame holds {LONGEST}")
    length = bytes([size]) if size < _EXTENDED else b"\xff" + size.to_bytes(2, "big")
    body = bytes([0xFF, message.identifier]) + length + message.data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


class FrameParser:
    """Takes bytes as they come; keeps at most one unfinished frame."""

    def __init__(self, counters: Counters, longest: int = LONGEST) -> None:
        """`longest`: data that the device can have to send; more is a corrupt length at once."""
        self._counters = counters
        self._longest = longest
        self._buffer = bytearray()
        self._skipping = False

    def feed(self, data: bytes) -> list[XbusMessage]:
        """Messages that are complete with these bytes."""
        buffer = self._buffer
        buffer += data
        messages: list[XbusMessage] = []
        position = 0
        while True:
            start = buffer.find(_START, position)
            if start < 0:
                # the last byte may be the first of a preamble
                start = len(buffer) - (position < len(buffer) and buffer.endswith(b"\xfa"))
                self._skip(start - position)
                position = start
                break
            self._skip(start - position)
            position = start
            bounds = self._bounds(start)
            if bounds is None:
                break
            first, last = bounds
            if last > len(buffer):
                break
            if first == last or sum(buffer[start + 1 : last]) & 0xFF:
                self._counters.bad_checksums += first != last
                self._skip(1)
                position = start + 1
                continue
            messages.append(XbusMessage(buffer[start + 2], bytes(buffer[first : last - 1])))
            self._counters.frames += 1
            self._skipping = False
            position = last
        del buffer[:position]
        return messages

    def idle(self) -> list[XbusMessage]:
        """The line has been quiet: an unfinished frame will not be finished any more.

        A corrupt length makes the parser wait for up to 2 kB; what stands inside them comes out.
        """
        messages: list[XbusMessage] = []
        while len(self._buffer) > 1:
            self._skip(1)
            del self._buffer[0]
            messages += self.feed(b"")
        return messages

    def _bounds(self, start: int) -> tuple[int, int] | None:
        """First byte of the data and the one after the checksum; the same: no such length.

        None: the length has not arrived yet.
        """
        buffer = self._buffer
        if len(buffer) < start + 4:
            return None
        size, first = buffer[start + 3], start + 4
        if size == _EXTENDED:
            if len(buffer) < start + 6:
                return None
            size, first = int.from_bytes(buffer[start + 4 : start + 6], "big"), start + 6
            if size < _EXTENDED:
                return first, first
        if size > self._longest:
            return first, first
        return first, first + size + 1

    def _skip(self, count: int) -> None:
        """Bytes that belong to no frame; a run of them counts once."""
        if count > 0 and not self._skipping:
            self._skipping = True
            self._counters.resyncs += 1


class MessageId(IntEnum):
    """Messages that a driver sends or hears; an acknowledgement is the request's plus one."""

    REQUEST_DEVICE_ID = 0x00
    GO_TO_MEASUREMENT = 0x10
    REQUEST_FIRMWARE_REVISION = 0x12
    SET_BAUD_RATE = 0x18
    GO_TO_CONFIG = 0x30
    DATA = 0x36
    WAKE_UP = 0x3E
    WAKE_UP_ACKNOWLEDGE = 0x3F
    RESET = 0x40
    ERROR = 0x42
    WARNING = 0x43
    SET_OUTPUT_CONFIGURATION = 0xC0


ERRORS = {
    0x03: "a period that it does not know",
    0x04: "a message that it does not know, or not in this state",
    0x1E: "its timer ran over",
    0x20: "a baud rate that it does not know",
    0x21: "a parameter out of range",
    0x23: "its transmit buffer is full",
    0x24: "its transmit buffer is full",
    0x28: "an error inside the device",
    0x29: "more data than the line can carry",
    0x2D: "its supply dipped",
    0x2F: "it is too hot",
}
"""Code of an error message -> what the device complains about."""

BAUD_CODES = {
    9600: 0x09,
    19200: 0x07,
    38400: 0x05,
    115200: 0x02,
    230400: 0x01,
    460800: 0x00,
    921600: 0x80,
    2000000: 0x0C,
    3500000: 0x0E,
    4000000: 0x0D,
}
"""Baud -> code in SetBaudRate."""

PRECISIONS = {"float32": 0, "fp12.20": 1, "fp16.32": 2, "float64": 3}
"""Number format -> bits 0 and 1 of a data identifier."""

NUMBER_BYTES = (4, 4, 6, 8)
"""Size of one number, by those bits."""


@dataclass(frozen=True)
class DataItem:
    """One kind of data in an MTData2 message."""

    name: str
    width: int
    """Numbers in it."""
    integer: str = ""
    """Code of `struct` for integers; empty: real numbers in the format of the identifier."""


DATA_ITEMS = {
    0x1020: DataItem("packet_counter", 1, "H"),
    0x1060: DataItem("sample_time_fine", 1, "I"),
    0x1070: DataItem("sample_time_coarse", 1, "I"),
    0x10A0: DataItem("sample_time", 1, "Q"),
    0x10B0: DataItem("packet_counter_long", 1, "I"),
    0x0810: DataItem("temperature", 1),
    0x2010: DataItem("quaternion", 4),
    0x2020: DataItem("rotation_matrix", 9),
    0x2030: DataItem("euler_angles", 3),
    0x3010: DataItem("pressure", 1, "I"),
    0x4010: DataItem("velocity_increment", 3),
    0x4020: DataItem("acceleration", 3),
    0x4030: DataItem("free_acceleration", 3),
    0x4040: DataItem("acceleration_high_rate", 3),
    0x8020: DataItem("rate_of_turn", 3),
    0x8030: DataItem("orientation_increment", 4),
    0x8040: DataItem("rate_of_turn_high_rate", 3),
    0xC020: DataItem("magnetic_field", 3),
    0xE010: DataItem("status_byte", 1, "B"),
    0xE020: DataItem("status_word", 1, "I"),
}
"""Data identifier, its low four bits (number format, frame) cleared -> what it carries."""

PACKET_COUNTER = 0x1020
SAMPLE_TIME_FINE = 0x1060
TICKS = 10_000
"""Of SampleTimeFine a second."""
MAXIMUM_RATE = 0xFFFF
"""Asks for an item with every packet."""


@dataclass(frozen=True)
class XbusChannel:
    """A canonical stream that the device can give."""

    kind: int
    """Data identifier."""
    width: int


CHANNELS = {
    "gyro": XbusChannel(0x8020, 3),
    "accelerometer": XbusChannel(0x4020, 3),
    "magnetometer": XbusChannel(0xC020, 3),
    "attitude": XbusChannel(0x2010, 4),
    "temperature": XbusChannel(0x0810, 1),
}
"""Stream -> where it is from. An MTi-1 has no attitude; from an MTi-2 or -3 on there is one."""


class Wrapping:
    """Follows a counter modulo `span` by its shortest way, forwards or backwards."""

    def __init__(self, span: int) -> None:
        self._span = span
        self._last: int | None = None
        self.total = 0
        """Unwrapped, from the first value seen."""

    def step(self, value: int) -> int | None:
        """Difference to the value before, in [-span / 2, span / 2); None for the first."""
        if self._last is None:
            self._last, self.total = value, value
            return None
        half = self._span // 2
        difference = (value - self._last + half) % self._span - half
        self._last = value
        self.total += difference
        return difference

    def forget(self) -> None:
        """The device has begun anew."""
        self._last = None


class DeviceClock:
    """SampleTimeFine in seconds, unwrapped; it may step back, and then so does this."""

    def __init__(self, span: int) -> None:
        self._ticks = Wrapping(span)

    def read(self, ticks: int) -> tuple[float, float]:
        """The time, and the step from the one before [s]."""
        step = self._ticks.step(ticks) or 0
        return self._ticks.total / TICKS, step / TICKS

    def forget(self) -> None:
        """The device has begun anew."""
        self._ticks.forget()


_APART = 1e-4
"""At least between two samples [s]: a tick of the device's clock."""
SPAN = 10.0
"""So far back the promptest sample may lie [s]."""


class Promptest:
    """When a stamp of the device was by the host's clock, after the promptest sample of late.

    A busy host reads several samples at one instant, and they were not measured so. No sample comes
    before it was taken: the least of arrival less stamp is the clocks' difference, but for the
    shortest delay. It is taken over some seconds, in which a crystal drifts by less than that.
    """

    def __init__(self) -> None:
        self._last = -math.inf
        self._least = deque[tuple[float, float]]()
        """Arrival and its difference to the stamp, of those that may yet be the least."""

    def host(self, stamp: float, arrival: float) -> float:
        """The host's time of the stamp [s], after that of the stamp before.

        A prompter sample moves all later ones back, but never before one that was told.
        """
        while self._least and self._least[-1][1] >= arrival - stamp:
            self._least.pop()
        self._least.append((arrival, arrival - stamp))
        while arrival - self._least[0][0] > SPAN:
            self._least.popleft()
        self._last = max(stamp + self._least[0][1], self._last + _APART)
        return self._last

    def forget(self) -> None:
        """The device's clock has stepped."""
        self._least.clear()


_FORMAT, _FRAME = 0x3, 0xC
_REALS = {
    (width, code): struct.Struct(form)
    for width in {item.width for item in DATA_ITEMS.values()}
    for code, form in enumerate((f">{width}f", f">{width}i", ">" + width * "Ih", f">{width}d"))
}
_INTEGERS = {
    item.integer: struct.Struct(">" + item.integer) for item in DATA_ITEMS.values() if item.integer
}
_MOST_OUTPUTS = 32


@dataclass(frozen=True, slots=True)
class Item:
    """One item of a message."""

    kind: int
    """Its data identifier with the number format and the frame cleared."""
    values: tuple[float, ...]
    """As sent: rad/s, m/s^2, deg, degC; counters are whole numbers."""


@dataclass(frozen=True, slots=True)
class OutputSetting:
    """One line of an output configuration."""

    identifier: int
    rate: int
    """[Hz]; 0xFFFF (or 0) with every packet."""


def decode_data(data: bytes) -> list[Item] | None:
    """Items in the order sent, without those unknown; None: lengths that contradict the data."""
    items: list[Item] = []
    position, end = 0, len(data)
    while position < end:
        if position + 3 > end:
            return None
        identifier, size = data[position] << 8 | data[position + 1], data[position + 2]
        position += 3
        if position + size > end:
            return None
        kind = identifier & ~(_FORMAT | _FRAME)
        known = DATA_ITEMS.get(kind)
        if known is not None:
            values = _numbers(known, identifier & _FORMAT, data, position, size)
            if values is None:
                return None
            items.append(Item(kind, values))
        position += size
    return items


def _numbers(
    item: DataItem, code: int, data: bytes, start: int, size: int
) -> tuple[float, ...] | None:
    layout = _INTEGERS[item.integer] if item.integer else _REALS[item.width, code]
    if layout.size != size:
        return None
    raw = layout.unpack_from(data, start)
    if item.integer or code in (0, 3):
        return raw
    if code == 1:
        return tuple(number / 2.0**20 for number in raw)
    # fp16.32: the fraction comes first, then the signed whole part
    return tuple(whole + part / 2.0**32 for part, whole in zip(raw[::2], raw[1::2], strict=True))


def packet_bytes(outputs: Iterable[OutputSetting]) -> int:
    """Bytes on the line of a message with all these items."""
    size = 0
    for output in outputs:
        item = DATA_ITEMS[output.identifier & ~(_FORMAT | _FRAME)]
        number = (
            struct.calcsize(">" + item.integer)
            if item.integer
            else NUMBER_BYTES[output.identifier & _FORMAT]
        )
        size += 3 + item.width * number
    return size + (5 if size < 255 else 7)


def encode_outputs(outputs: Iterable[OutputSetting]) -> bytes:
    """Data of SetOutputConfiguration.

    Raises:
        ValueError: more than 32 items.
    """
    chosen = list(outputs)
    if len(chosen) > _MOST_OUTPUTS:
        raise ValueError(f"{len(chosen)} items: an output configuration holds {_MOST_OUTPUTS}")
    return b"".join(struct.pack(">HH", each.identifier, each.rate) for each in chosen)


def decode_outputs(data: bytes) -> list[OutputSetting] | None:
    """The configuration that is in effect, from its acknowledgement; None: not a whole list."""
    if len(data) % 4:
        return None
    return [OutputSetting(*pair) for pair in struct.iter_unpack(">HH", data)]
