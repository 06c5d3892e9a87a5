"""The thread of a session, and the bounded queue between it and the loop."""

import threading
import traceback
from collections import deque
from collections.abc import Callable
from pathlib import Path

from twin.errors import TwinError
from twin.plant.devices.device import Counters, Sample

QUEUE = 4096
"""Samples kept for a loop that does not fetch them: 40 s of 100 Hz."""


class SampleQueue:
    """What arrived and has not been fetched; when full, the oldest go and are counted."""

    def __init__(self, counters: Counters, limit: int = QUEUE) -> None:
        self._samples = deque[Sample](maxlen=limit)
        self._counters = counters
        self._lock = threading.Lock()

    def put(self, sample: Sample) -> None:
        """Append one."""
        with self._lock:
            if len(self._samples) == self._samples.maxlen:
                self._counters.overflows += 1
            self._samples.append(sample)

    def take(self) -> list[Sample]:
        """All of them, oldest first; the queue is empty afterwards."""
        with self._lock:
            samples = list(self._samples)
            self._samples.clear()
        return samples


class Worker:
    """Does one short piece of work after another in a thread, until stopped or it fails."""

    def __init__(self, name: str, work: Callable[[], None], failed: Callable[[str], None]) -> None:
        """`work` blocks at most some tens of milliseconds; `failed` is told why it broke off."""
        self._work = work
        self._failed = failed
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """It still works."""
        return self._thread.is_alive()

    def stop(self, timeout: float = 1.0) -> None:
        """Let it finish its piece of work, at most `timeout` [s]."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                self._work()
        except TwinError as error:
            self._failed(str(error))
        except Exception as error:
            # A mistake of ours must end in a stopped session and a reason, not in a silent thread.
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            what = f"{type(error).__name__} at {where}: {error}"
            self._failed(f"{self._thread.name}: stopped by {what}; please report it")
