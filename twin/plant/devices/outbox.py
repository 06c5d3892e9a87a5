"""Frames on their way from the loop to the thread that writes, so that the loop never waits."""

import queue
import time
from math import inf

WAITING = 64
"""Frames that may wait to be written before the line counts as stuck."""


class Outbox:
    """A bounded queue whose frames grow old: a line that stood must not bring late set-points."""

    def __init__(self) -> None:
        self._frames = queue.Queue[tuple[float, bytes]](WAITING)

    def post(self, frame: bytes, lifetime: float = inf) -> bool:
        """Hand over what is worth sending for `lifetime` [s]; False if too much waits already."""
        try:
            self._frames.put_nowait((time.monotonic() + lifetime, frame))
        except queue.Full:
            return False
        return True

    def take(self, timeout: float) -> bytes:
        """The oldest that is still worth it; nothing after `timeout` [s]."""
        try:
            until, frame = self._frames.get(timeout=timeout)
        except queue.Empty:
            return b""
        return frame if time.monotonic() < until else b""

    def clear(self) -> None:
        """Forget all that waits."""
        try:
            while True:
                self._frames.get_nowait()
        except queue.Empty:
            return

    @property
    def empty(self) -> bool:
        """Nothing waits."""
        return self._frames.empty()
