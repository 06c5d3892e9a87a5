"""What is said over our own link to a microcontroller: the table of messages, as data.

docs/link.md is the same table for people. Everything is little-endian. A frame is a header of 12
bytes, a payload and a CRC-16, at most 254 bytes together, stuffed (`cobs`) and ended by a zero.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Literal

VERSION = 1
"""Of the link. Ends of different versions do not talk."""

HEADER = struct.Struct("<BBHIHBB")
"""Version, type, sequence, sender's clock [us], last sequence received, state, flags."""

LONGEST_FRAME = 254
LONGEST_PAYLOAD = LONGEST_FRAME - HEADER.size - 2
SHORTEST_FRAME = HEADER.size + 2

LONGEST_TEXT = 32
"""Bytes of the name in a greeting."""


class FarEndState(IntEnum):
    """Of the far end; the host's frames carry the one it heard last."""

    safe = 0
    """Every actuator does what is safe: it takes no set-point."""
    armed = 1
    """Set-points are applied for as long as each says that it is valid."""
    fault = 2
    """Safe, and refuses to be armed until a DISARM acknowledges it."""


class Flag(IntFlag):
    """Bits of the header's last byte, set by the far end."""

    greeted = 1
    """It has heard a greeting with its own schema since it started. A host that sees this bit
    cleared knows that the far end has restarted, even if it missed the greeting."""
    live = 2
    """At least one set-point is in force."""


class MessageType(IntEnum):
    """The header's second byte."""

    hello = 1
    timesync = 2
    samples = 3
    setpoint = 4
    arm = 5
    disarm = 6
    safe_stop = 7
    event = 8


@dataclass(frozen=True)
class MessageFormat:
    """One row of the table."""

    sender: Literal["host", "far end", "both"]
    fixed: struct.Struct
    """What every payload of the type begins with."""
    fields: tuple[str, ...]
    """Names of what is in `fixed`, with units."""
    tail: Literal["", "text", "values", "rows"]
    """What follows. Values: 4 bytes a column. Rows: a clock [us] and values, several times."""
    meaning: str


MESSAGES: dict[MessageType, MessageFormat] = {
    MessageType.hello: MessageFormat(
        "both",
        struct.Struct("<IH"),
        ("schema hash", "longest valid_for [ms]"),
        "text",
        "Who is there, and which channels it carries. The far end answers each, and greets when it "
        "starts. The host gives 0 ms.",
    ),
    MessageType.timesync: MessageFormat(
        "both",
        struct.Struct("<qI"),
        ("host's clock [ns], sent back as it came", "far end's clock at receipt [us], 0 from host"),
        "",
        "The far end answers at once; with the clock in the header it makes four stamps.",
    ),
    MessageType.samples: MessageFormat(
        "far end",
        struct.Struct("<BB"),
        ("channel", "rows"),
        "rows",
        "Measured values of one channel, each row with the instant at which it was true.",
    ),
    MessageType.setpoint: MessageFormat(
        "host",
        struct.Struct("<BBH"),
        ("channel", "0", "valid_for [ms]"),
        "values",
        "Do this, for so long; the far end is safe by itself when the time is over.",
    ),
    MessageType.arm: MessageFormat(
        "host",
        struct.Struct("<IH"),
        ("schema hash", "valid_for [ms]"),
        "",
        "Take set-points; the first one must come within valid_for.",
    ),
    MessageType.disarm: MessageFormat(
        "host", struct.Struct("<"), (), "", "Be safe, and a fault is acknowledged."
    ),
    MessageType.safe_stop: MessageFormat(
        "host", struct.Struct("<"), (), "", "Be safe, whoever asks; a fault stays one."
    ),
    MessageType.event: MessageFormat(
        "far end",
        struct.Struct("<8sf"),
        ("code, ASCII, filled up with zeros", "value"),
        "",
        "Something happened; EVENTS says what the codes mean.",
    ),
}

EVENTS: dict[str, str] = {
    "ARMED": "it takes set-points",
    "SAFE": "it was told to be safe",
    "EXPIRED": "no new set-point came in time on channel {value:.0f}; it is safe",
    "UNARMED": "a message of type {value:.0f} was refused: it is not armed",
    "SCHEMA": "a greeting or an arming named another schema",
    "VALUE": "a set-point of channel {value:.0f} was refused: not finite, or valid for too long",
    "FAULTED": "it was not armed: a fault waits for a DISARM",
    "FULL": "{value:.0f} of its frames were lost since its last report: the line is too slow",
}
"""Codes that the link itself uses, and what they mean; a firmware adds its own faults."""


def sentence_of(code: str, value: float) -> str:
    """The sentence of an event; the code itself where it is a firmware's own."""
    return EVENTS[code].format(value=value) if code in EVENTS else f"{code} ({value:g})"
