"""One frame of our link: its header, its check, its stuffing."""

import binascii
from typing import NamedTuple

from twin.plant.devices.link.cobs import stuff
from twin.plant.devices.link.messages import HEADER, LONGEST_PAYLOAD, VERSION


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
