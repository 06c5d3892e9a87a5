"""Calls for help when nobody has said for a while that all is well."""

import threading
import time
from collections.abc import Callable


class Watchdog:
    """Runs in a thread of its own, so that a loop that hangs is noticed."""

    def __init__(self, limit: float, alarm: Callable[[float], None]) -> None:
        """`alarm` is called once, from the thread, with how long it was quiet [s].

        Args:
            limit: longest quiet time [s], by the monotonic clock.
            alarm: what to do then.
        """
        self._limit, self._alarm = limit, alarm
        self._fed = time.monotonic()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._thread.start()

    def feed(self) -> None:
        """All is well."""
        self._fed = time.monotonic()

    def stop(self) -> None:
        """Watch no longer."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)

    def _watch(self) -> None:
        while not self._ending.wait(max(self._fed + self._limit - time.monotonic(), 0.0)):
            quiet = time.monotonic() - self._fed
            if quiet >= self._limit:
                self._alarm(quiet)
                return
