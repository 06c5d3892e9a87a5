"""When bytes arrive on a line that takes its time for each of them."""

from collections import deque


class PacedQueue:
    """Bytes on their way, each due one byte time after the one before."""

    def __init__(self) -> None:
        self._due = deque[tuple[float, int]]()
        self._free = 0.0

    def send(self, data: bytes, now: float, byte_time: float) -> None:
        """Begin to send at `now`, or when the bytes before are through [s]."""
        time = max(self._free, now)
        for byte in data:
            time += byte_time
            self._due.append((time, byte))
        self._free = time

    def arrived(self, now: float) -> bytes:
        """Bytes that are through by `now`."""
        out = bytearray()
        while self._due and self._due[0][0] <= now:
            out.append(self._due.popleft()[1])
        return bytes(out)

    def clear(self) -> None:
        """The cable is out: what was on its way is lost."""
        self._due.clear()
        self._free = 0.0
