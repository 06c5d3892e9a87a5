"""Frames of our link: header, check, byte stuffing, and the parser.

Consistent overhead byte stuffing: bytes without a zero, so that a zero can end a frame.
Each run up to a zero is preceded by its length plus one (S. Cheshire, M. Baker, IEEE/ACM
Transactions on Networking 7(2), 1999). What is stuffed here holds at most 254 bytes: then the cost
is one byte, always.

Bytes as they come, to frames that passed every check.
Whatever comes, the parser raises nothing, keeps at most 255 bytes, and is whole again at the next
zero.
"""

import binascii
from dataclasses import dataclass
from typing import Literal, NamedTuple

from twin.plant.devices.link.messages import (
    HEADER,
    LONGEST_FRAME,
    LONGEST_PAYLOAD,
    MESSAGES,
    SHORTEST_FRAME,
    VERSION,
    MessageType,
)
from twin.plant.devices.link.schema import Schema

LONGEST = 254
"""Bytes that one stuffing byte is enough for."""


def stuff(data: bytes) -> bytes:
    """The bytes without a zero, one longer than `data`; the delimiter is not appended.

    Raises:
        ValueError: `data` is empty or longer than 254 bytes.
    """
    if not 0 < len(data) <= LONGEST:
        raise ValueError(f"{len(data)} bytes: one stuffing byte does for 1 to {LONGEST}")
    return b"".join(bytes((len(run) + 1,)) + run for run in data.split(b"\0"))


def unstuff(packet: bytes) -> bytes | None:
    """What was stuffed into a packet without zeros; None where it contradicts itself."""
    out = bytearray()
    place, end = 0, len(packet)
    while place < end:
        code = packet[place]
        stop = place + code
        if stop > end:
            return None
        out += packet[place + 1 : stop]
        if code < 255 and stop < end:
            out.append(0)
        place = stop
    return bytes(out)


class Frame(NamedTuple):
    """What one end says at an instant."""

    type: int
    """A `MessageType`, or one that a later firmware knows."""
    payload: bytes
    sequence: int = 0
    """Of this sender's frames, 16 bits."""
    time_us: int = 0
    """Sender's clock as the frame was made [us], 32 bits."""
    last_received: int = 0
    """Sequence of the last good frame that the sender has heard."""
    state: int = 0
    flags: int = 0


def checksum(data: bytes) -> int:
    """CRC-16/IBM-3740: polynomial 0x1021, start 0xFFFF; of b"123456789" it is 0x29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


def packed(frame: Frame) -> bytes:
    """The frame as it goes over the wire, its delimiter included.

    Raises:
        ValueError: the payload is longer than 240 bytes.
    """
    if len(frame.payload) > LONGEST_PAYLOAD:
        raise ValueError(f"a payload of {len(frame.payload)} bytes: {LONGEST_PAYLOAD} fit")
    head = HEADER.pack(
        VERSION,
        frame.type,
        frame.sequence & 0xFFFF,
        frame.time_us & 0xFFFFFFFF,
        frame.last_received & 0xFFFF,
        frame.state,
        frame.flags,
    )
    body = head + frame.payload
    return stuff(body + checksum(body).to_bytes(2, "little")) + b"\0"


_LONGEST_PACKET = LONGEST_FRAME + 1
_HELLO = int(MessageType.hello)


@dataclass
class ParserCounters:
    """What came, and what was wrong with it."""

    frames: int = 0
    """Passed every check."""
    malformed: int = 0
    """Too short, too long, or stuffed wrongly."""
    bad_checksum: int = 0
    bad_version: int = 0
    unknown: int = 0
    """Of a type that we do not know or that is not the other end's to send."""
    bad_payload: int = 0
    """Of a length that its type or its channel does not have."""
    gaps: int = 0
    """Frames that are missing between those that came, by their sequence numbers."""
    repeated: int = 0
    """Frames that came twice in a row; the second is dropped."""


class Parser:
    """The receiving half of one end."""

    def __init__(self, schema: Schema, sender: Literal["host", "far end"]) -> None:
        """Hear what `sender`, the other end, may say."""
        self.counters = ParserCounters()
        self.last_sequence: int | None = None
        """Of the last good frame; None before the first."""
        self._schema = schema
        self._known = {
            int(kind): kind for kind, row in MESSAGES.items() if row.sender in (sender, "both")
        }
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[Frame]:
        """The good frames that end in `data`."""
        packets = (self._rest + data).split(b"\0")
        self._rest = packets.pop()
        frames: list[Frame] = []
        for packet in packets:
            if self._skipping or len(packet) > _LONGEST_PACKET:
                self._skipping = False
                self.counters.malformed += 1
            elif packet:
                frame = self._checked(packet)
                if frame is not None:
                    frames.append(frame)
        if len(self._rest) > _LONGEST_PACKET:
            self._rest, self._skipping = b"", True
        elif self._skipping:
            self._rest = b""
        return frames

    def _checked(self, packet: bytes) -> Frame | None:
        counters = self.counters
        body = unstuff(packet)
        if body is None or len(body) < SHORTEST_FRAME:
            counters.malformed += 1
            return None
        if checksum(body[:-2]) != body[-2] | body[-1] << 8:
            counters.bad_checksum += 1
            return None
        version, kind, sequence, *rest = HEADER.unpack_from(body)
        if version != VERSION:
            counters.bad_version += 1
            return None
        if not self._in_sequence(kind, sequence):
            counters.repeated += 1
            return None
        known = self._known.get(kind)
        if known is None:
            counters.unknown += 1
            return None
        payload = body[HEADER.size : -2]
        if not self._schema.fits(known, payload):
            counters.bad_payload += 1
            return None
        counters.frames += 1
        return Frame(known, payload, sequence, *rest)

    def _in_sequence(self, kind: int, sequence: int) -> bool:
        last, self.last_sequence = self.last_sequence, sequence
        # who greets may have restarted, and begins to count anew
        if last is None or kind == _HELLO:
            return True
        self.counters.gaps += (sequence - last - 1) & 0xFFFF if sequence != last else 0
        return sequence != last
