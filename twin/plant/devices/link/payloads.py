"""Payloads of the link's messages, both ways: what they carry, and the bytes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.plant.devices.link.messages import LONGEST_PAYLOAD, LONGEST_TEXT, MESSAGES, MessageType
from twin.plant.devices.link.schema import Channel, Schema

Array = NDArray[np.float64]

_HELLO = MESSAGES[MessageType.hello].fixed
_TIMESYNC = MESSAGES[MessageType.timesync].fixed
_SAMPLES = MESSAGES[MessageType.samples].fixed
_SETPOINT = MESSAGES[MessageType.setpoint].fixed
_ARM = MESSAGES[MessageType.arm].fixed
_EVENT = MESSAGES[MessageType.event].fixed


class Hello(NamedTuple):
    """Who is there."""

    schema_hash: int
    longest_valid_ms: int
    name: str

    def packed(self) -> bytes:
        """Characters that are not ASCII are replaced, and the name is cut at 32."""
        name = self.name.encode("ascii", "replace")[:LONGEST_TEXT]
        return _HELLO.pack(self.schema_hash, self.longest_valid_ms) + name

    @classmethod
    def unpacked(cls, payload: bytes) -> "Hello":
        """From a payload that passed `Schema.fits`."""
        name = payload[_HELLO.size :][:LONGEST_TEXT].decode("ascii", "replace")
        schema_hash, longest_valid_ms = _HELLO.unpack_from(payload)
        return cls(schema_hash, longest_valid_ms, name)


class TimeSync(NamedTuple):
    """One leg of an exchange of clocks."""

    host_ns: int
    received_us: int = 0

    def packed(self) -> bytes:
        """12 bytes."""
        return _TIMESYNC.pack(self.host_ns, self.received_us)

    @classmethod
    def unpacked(cls, payload: bytes) -> "TimeSync":
        """From a payload that passed `Schema.fits`."""
        return cls(*_TIMESYNC.unpack(payload))


class SampleRows(NamedTuple):
    """Samples of one channel."""

    channel: int
    time_us: tuple[int, ...]
    """Far end's clock, 32 bits, one a row."""
    value: Array
    """(rows, columns), SI; NaN where there is none."""

    def packed(self, schema: Schema) -> bytes:
        """As many bytes as rows need; `rows_in_a_frame` of them fit."""
        channel = schema.channels[self.channel]
        rows = (
            time.to_bytes(4, "little") + channel.packed(row)
            for time, row in zip(self.time_us, self.value, strict=True)
        )
        return _SAMPLES.pack(self.channel, len(self.time_us)) + b"".join(rows)

    @classmethod
    def unpacked(cls, payload: bytes, schema: Schema) -> "SampleRows":
        """From a payload that passed `Schema.fits`."""
        number, rows = _SAMPLES.unpack_from(payload)
        channel = schema.channels[number]
        stride = 4 + channel.size
        places = range(_SAMPLES.size, _SAMPLES.size + rows * stride, stride)
        times = tuple(int.from_bytes(payload[p : p + 4], "little") for p in places)
        values = [channel.unpacked(payload[p + 4 : p + stride]) for p in places]
        return cls(number, times, np.array(values).reshape(rows, channel.columns))


class SetPoint(NamedTuple):
    """What one channel is to do, and for how long."""

    channel: int
    valid_for_ms: int
    value: Array
    """(columns,), SI."""

    def packed(self, schema: Schema) -> bytes:
        """4 bytes and 4 a column."""
        head = _SETPOINT.pack(self.channel, 0, self.valid_for_ms)
        return head + schema.channels[self.channel].packed(self.value)

    @classmethod
    def unpacked(cls, payload: bytes, schema: Schema) -> "SetPoint":
        """From a payload that passed `Schema.fits`."""
        number, _, valid_for = _SETPOINT.unpack_from(payload)
        return cls(number, valid_for, schema.channels[number].unpacked(payload[_SETPOINT.size :]))


class ArmRequest(NamedTuple):
    """Permission to move, of one schema, for a time."""

    schema_hash: int
    valid_for_ms: int

    def packed(self) -> bytes:
        """6 bytes."""
        return _ARM.pack(self.schema_hash, self.valid_for_ms)

    @classmethod
    def unpacked(cls, payload: bytes) -> "ArmRequest":
        """From a payload that passed `Schema.fits`."""
        return cls(*_ARM.unpack(payload))


class Event(NamedTuple):
    """Something happened at the far end."""

    code: str
    value: float

    def packed(self) -> bytes:
        """12 bytes; the code is cut at eight characters."""
        return _EVENT.pack(self.code.encode("ascii", "replace")[:8], self.value)

    @classmethod
    def unpacked(cls, payload: bytes) -> "Event":
        """From a payload that passed `Schema.fits`."""
        code, value = _EVENT.unpack(payload)
        return cls(code.split(b"\0")[0].decode("ascii", "replace"), value)


def rows_in_a_frame(channel: Channel) -> int:
    """Samples of a channel that one frame holds."""
    return (LONGEST_PAYLOAD - _SAMPLES.size) // (4 + channel.size)
