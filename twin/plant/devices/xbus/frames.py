"""Frames of the Xbus protocol: FA FF, message, length, data, checksum. Bytes in, messages out.

The checksum makes the sum of all bytes after the preamble a multiple of 256, so one corrupt frame
in 256 passes it. Nothing is stuffed: FA FF may stand inside data, and after a bad frame the search
begins again one byte behind its preamble.
"""

from dataclasses import dataclass

from twin.plant.devices.device import Counters

_START = b"\xfa\xff"
_EXTENDED = 0xFF
LONGEST = 2048
"""Bytes of data in one frame."""


@dataclass(frozen=True, slots=True)
class Message:
    """One frame that passed its check."""

    identifier: int
    data: bytes = b""


def encode(message: Message) -> bytes:
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

    def feed(self, data: bytes) -> list[Message]:
        """Messages that are complete with these bytes."""
        buffer = self._buffer
        buffer += data
        messages: list[Message] = []
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
            messages.append(Message(buffer[start + 2], bytes(buffer[first : last - 1])))
            self._counters.frames += 1
            self._skipping = False
            position = last
        del buffer[:position]
        return messages

    def idle(self) -> list[Message]:
        """The line has been quiet: an unfinished frame will not be finished any more.

        A corrupt length makes the parser wait for up to 2 kB; what stands inside them comes out.
        """
        messages: list[Message] = []
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
