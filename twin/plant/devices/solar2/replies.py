"""Commands and replies of the SOLAR-2 inclinometer (Level Developments). Bytes and values.

Commands are seven characters without an end. Replies carry no checksum: a binary one is two big-
endian 32-bit numbers of thousandths of a degree, one in text two numbers of eight characters.
The data sheet is not public; this is what working programs for the same family do.
"""

import math
import re
import struct

READ = b"get-x&y"
START = b"setcasc"
STOP = b"stpcasc"
BINARY_REPLY = 8
TEXT_REPLY = 18
SHORTEST_INTERVAL, LONGEST_INTERVAL = 50, 9999
"""Of the stream [ms]."""
_TO_RADIANS = math.pi / 180.0
_PAIR = struct.Struct(">ii")
_NUMBER = re.compile(rb"[ +-]?[ ]*\d+\.\d+")
_WIDTH = 8
_LONGEST_LINE = 64

Angles = tuple[float, float]


def interval(milliseconds: int) -> bytes:
    """The command that sets the interval of the stream; the unit keeps it without power.

    Raises:
        ValueError: not 50 to 9999 ms.
    """
    if not SHORTEST_INTERVAL <= milliseconds <= LONGEST_INTERVAL:
        raise ValueError(
            f"an interval of {milliseconds} ms; the unit has {SHORTEST_INTERVAL} to "
            f"{LONGEST_INTERVAL} ms"
        )
    return b"str%04d" % milliseconds


def decode_binary(reply: bytes) -> Angles | None:
    """First and second angle [rad]; None: not of the length of a reply."""
    if len(reply) != BINARY_REPLY:
        return None
    first, second = _PAIR.unpack(reply)
    return first * 1e-3 * _TO_RADIANS, second * 1e-3 * _TO_RADIANS


def decode_text(line: bytes) -> Angles | None:
    """First and second angle [rad] of a line without its end; None: not two such numbers."""
    if len(line) != 2 * _WIDTH + 1:
        return None
    first, separator, second = line[:_WIDTH], line[_WIDTH : _WIDTH + 1], line[_WIDTH + 1 :]
    if separator.isdigit() or not (_NUMBER.fullmatch(first) and _NUMBER.fullmatch(second)):
        return None
    return (
        float(first.replace(b" ", b"")) * _TO_RADIANS,
        float(second.replace(b" ", b"")) * _TO_RADIANS,
    )


class LineParser:
    """Splits a stream of text into lines; keeps at most one unfinished line."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._skipping = False
        self.skipped = 0
        """Lines too long to be any, thrown away."""

    def feed(self, data: bytes) -> list[bytes]:
        """Lines that are complete with these bytes, without their ends and without empty ones."""
        self._buffer += data.replace(b"\r", b"\n")
        *lines, rest = self._buffer.split(b"\n")
        if self._skipping and lines:
            # the end of a line whose beginning is gone
            lines, self._skipping = lines[1:], False
        self._buffer = rest
        if len(rest) > _LONGEST_LINE:
            self._buffer = bytearray()
            self.skipped += not self._skipping
            self._skipping = True
        return [bytes(line) for line in lines if line]


def describe(reply: bytes, expected: str) -> str:
    """What a reply that is not the one expected tells about the unit."""
    if not reply:
        return "no answer; is it powered, and at this baud rate?"
    if b"$PLDL" in reply or reply.startswith(b"$"):
        return "it talks NMEA; send `$PLDL100,1*38` once to bring it back to its own commands"
    if reply.startswith(b"\xff\xff"):
        return "it does not know the command; is it a single-axis unit?"
    text = all(32 <= byte < 127 or byte in b"\r\n" for byte in reply)
    if text and expected == "binary" and len(reply) >= BINARY_REPLY:
        return "it answers in text; set the mode to text"
    if not text and expected == "text" and len(reply) == BINARY_REPLY:
        return "it answers in binary; set the mode to binary"
    return f"{len(reply)} bytes that are no answer ({reply[:8].hex(' ')})"
