"""Which channels a far end carries, agreed by a hash in the greeting.

A channel is a stream of `twin.signals` as it crosses the wire: float32, or int32 in steps of a
scale (microsteps, counts). Values are SI on our side of this file.
"""

import struct
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from twin.plant.devices.link.messages import LONGEST_PAYLOAD, MESSAGES, VERSION, MessageType

Array = NDArray[np.float64]

NOTHING = -(2**31)
"""The int32 that says that there is no value; a float32 says it by not being a number."""

_LARGEST = 2**31 - 1


@dataclass(frozen=True)
class Channel:
    """One stream over the wire."""

    stream: str
    """As `twin.signals` names it, or a lab's own."""
    unit: str
    """Of the values on our side, SI."""
    columns: int
    """Numbers a sample."""
    number: Literal["float32", "int32"] = "float32"
    scale: float = 1.0
    """SI value of one count; of int32 only."""
    safe: Literal["", "zero", "hold"] = ""
    """Of a command: what the far end does when it is not armed. Zero: torque, moment or force 0.
    Hold: it stops and stays where it is. Empty: a measured channel."""

    def __post_init__(self) -> None:
        longest = (LONGEST_PAYLOAD - 6) // 4
        if not 0 < self.columns <= longest:
            raise ValueError(f"{self.stream}: {self.columns} columns; a frame holds 1 to {longest}")
        if self.number == "float32" and self.scale != 1.0:
            raise ValueError(f"{self.stream}: float32 travels in SI; a scale is for int32")
        if self.commanded != self.stream.startswith("command_"):
            raise ValueError(
                f"{self.stream}: a stream command_* states safe = 'zero' or 'hold', no other does"
            )

    @property
    def commanded(self) -> bool:
        """The host sends it."""
        return bool(self.safe)

    @property
    def size(self) -> int:
        """Bytes of one row of values."""
        return 4 * self.columns

    def packed(self, value: Array) -> bytes:
        """Values (columns,) in SI as bytes; what is not a number becomes `NOTHING`."""
        if self.number == "float32":
            # beyond float32 is infinite, which the far end refuses
            with np.errstate(over="ignore"):
                return value.astype("<f4").tobytes()
        counts = np.clip(np.round(value / self.scale), -_LARGEST, _LARGEST)
        return np.where(np.isnan(value), NOTHING, counts).astype("<i4").tobytes()

    def unpacked(self, data: bytes) -> Array:
        """Values (columns,) in SI; NaN where there is none."""
        kind = "f" if self.number == "float32" else "i"
        raw = struct.unpack(f"<{self.columns}{kind}", data)
        if self.number == "float32":
            return np.array(raw)
        return np.array([np.nan if count == NOTHING else count * self.scale for count in raw])

    def sent(self, value: Array) -> Array:
        """What arrives of values (columns,), after float32 or whole counts."""
        return self.unpacked(self.packed(value))


@dataclass(frozen=True)
class Schema:
    """The channels of one far end, numbered in this order."""

    channels: tuple[Channel, ...]

    @cached_property
    def text(self) -> str:
        """What the hash is taken of: a line a channel."""
        lines = [
            f"{channel.stream} {channel.unit} {channel.columns} {channel.number} "
            f"{channel.scale!r} {channel.safe or 'measured'}\n"
            for channel in self.channels
        ]
        return f"link {VERSION}\n" + "".join(lines)

    @cached_property
    def hash(self) -> int:
        """CRC-32 of the text."""
        return zlib.crc32(self.text.encode())

    def number_of(self, stream: str) -> int:
        """The channel that carries a stream.

        Raises:
            KeyError: none does.
        """
        for number, channel in enumerate(self.channels):
            if channel.stream == stream:
                return number
        raise KeyError(stream)

    def fits(self, kind: MessageType, payload: bytes) -> bool:
        """Is the payload as long as its type and its channel want it?"""
        message = MESSAGES[kind]
        rest = len(payload) - message.fixed.size
        if message.tail == "text":
            return rest >= 0
        if message.tail == "":
            return rest == 0
        if rest < 0 or payload[0] >= len(self.channels):
            return False
        channel = self.channels[payload[0]]
        if message.tail == "values":
            return channel.commanded and rest == channel.size
        return not channel.commanded and rest == payload[1] * (4 + channel.size)


_SAFE = {"": "LINK_MEASURED", "zero": "LINK_ZERO", "hold": "LINK_HOLD"}


def c_header(schema: Schema, name: str, longest_valid_ms: int) -> str:
    """`schema.h`: the channels' table, their numbers, and the hash for the greeting.

    Args:
        schema: What the far end carries.
        name: How it greets, ASCII.
        longest_valid_ms: The longest time for which it takes a set-point [ms].
    """
    numbers = [
        f"#define CHANNEL_{channel.stream.upper()} {number} /* {channel.columns} columns"
        f" [{channel.unit}], "
        + (f"{channel.scale!r} a count */" if channel.number == "int32" else "float32 */")
        for number, channel in enumerate(schema.channels)
    ]
    rows = [
        f"    {{{channel.columns}, {int(channel.number == 'int32')}, {_SAFE[channel.safe]}}},"
        for channel in schema.channels
    ]
    return "\n".join(
        (
            "/* The channels of a far end, made by a program: do not edit. */",
            "#ifndef SCHEMA_H",
            "#define SCHEMA_H",
            "",
            '#include "link.h"',
            "",
            *numbers,
            "",
            "static const struct link_channel schema_channels[] = {",
            *rows,
            "};",
            "",
            "static const struct link_schema schema = {",
            f"    0x{schema.hash:08X}u, {longest_valid_ms}, {len(schema.channels)}, "
            f'schema_channels, "{name}",',
            "};",
            "",
            "#endif",
            "",
        )
    )
