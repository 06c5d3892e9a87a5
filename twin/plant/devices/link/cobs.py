"""Consistent overhead byte stuffing: bytes without a zero, so that a zero can end a frame.

Each run up to a zero is preceded by its length plus one (S. Cheshire, M. Baker, IEEE/ACM
Transactions on Networking 7(2), 1999). What is stuffed here holds at most 254 bytes: then the cost
is one byte, always.
"""

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
