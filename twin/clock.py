"""Time for the loop: simulated (as fast as it goes) or the wall's, with lateness accounted.

Ticks stand at whole multiples of the period, computed and never accumulated. A wall clock that is
late skips the ticks it has missed and counts them; it never runs a burst to catch up.
"""

import abc
import ctypes
import gc
import os
import time
from collections.abc import Generator, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError

Array = NDArray[np.float64]

PHASES = ("read", "estimate", "control", "write", "record")

LONGEST = 1e6
"""Of a run [s]: eleven days and a half."""


@dataclass
class Timing:
    """What a loop cost, phase by phase, and how late its ticks came."""

    ticks: int = 0
    overruns: int = 0
    """Ticks skipped because the one before took too long."""
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(PHASES, 0.0))
    """Wall seconds spent in each phase."""
    lateness: list[float] = field(default_factory=list[float])
    """How long after its deadline each tick began [s]; empty on a simulated clock."""
    durations: list[float] = field(default_factory=list[float])
    """How long each tick took, all phases together [s]; empty on a simulated clock."""

    def lateness_at(self, percent: float) -> float:
        """Percentile of the lateness [s]; 0 on a simulated clock."""
        return float(np.percentile(self.lateness, percent)) if self.lateness else 0.0

    def duration_at(self, percent: float) -> float:
        """Percentile of what a tick took [s]; 0 on a simulated clock."""
        return float(np.percentile(self.durations, percent)) if self.durations else 0.0


PRIORITY = 40
"""Of a loop among real-time threads: above usual work, below the kernel's own interrupts (50)."""

_MCL_CURRENT, _MCL_FUTURE = 1, 2


@contextmanager
def ahead_of_others() -> Generator[list[str]]:
    """This thread runs ahead of all usual work, no memory is swapped, and no garbage is collected.

    Threads and processes that this one starts do not inherit its priority: a recorder that competes
    with the loop would void it. What the computer does not permit is given as sentences; the rest
    is had without it. Everything is as before when the block ends.
    """
    missing: list[str] = []
    with ExitStack() as stack:
        for take in (_priority, _locked_memory, _without_collector):
            if problem := take(stack):
                missing.append(problem)
        yield missing


def _priority(stack: ExitStack) -> str:
    if not hasattr(os, "sched_setscheduler"):
        return "this system has no SCHED_FIFO: the loop has the priority of any program"
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except OSError as problem:
        return f"no priority ({problem.strerror}): `twin doctor` says how to permit it"
    stack.callback(os.sched_setscheduler, 0, *before)
    return ""


def _locked_memory(stack: ExitStack) -> str:
    try:
        library = ctypes.CDLL(None, use_errno=True)
        refused = library.mlockall(_MCL_CURRENT | _MCL_FUTURE)
    except (OSError, AttributeError):
        return "this system cannot lock memory: it may be swapped"
    if refused:
        reason = os.strerror(ctypes.get_errno())
        return f"memory is not locked ({reason}): `twin doctor` says how to permit it"
    stack.callback(library.munlockall)
    return ""


def _without_collector(stack: ExitStack) -> str:
    if gc.isenabled():
        gc.collect()
        gc.freeze()
        gc.disable()
        stack.callback(gc.enable)
        stack.callback(gc.unfreeze)
    return ""


class Clock(abc.ABC):
    """Gives the loop its ticks, and times its phases."""

    def __init__(self) -> None:
        self.timing = Timing()
        self._mark = 0.0
        self._spent: dict[str, float] = dict.fromkeys(PHASES, 0.0)

    @abc.abstractmethod
    def ticks(self, period: float, duration: float) -> Iterator[float]:
        """Times 0, period, 2 period ... up to and including `duration` [s]."""

    def lap(self, phase: str) -> None:
        """The phase that began at the last lap, or at the tick, has ended."""
        now = time.perf_counter()
        self._spent[phase] = now - self._mark
        self.timing.seconds[phase] += self._spent[phase]
        self._mark = now

    def cycle(self) -> Array | None:
        """(6,) how late the tick in hand began, and what each of its phases took, the last that of
        the tick before [s]; None where time is simulated."""
        if not self.timing.lateness:
            return None
        return np.array([self.timing.lateness[-1], *self._spent.values()])

    def _tick(self) -> None:
        self.timing.ticks += 1
        self._mark = time.perf_counter()


class SimulatedClock(Clock):
    """The next tick comes at once."""

    def ticks(self, period: float, duration: float) -> Iterator[float]:
        for number in range(last_tick(period, duration) + 1):
            self._tick()
            yield number * period


class WallClock(Clock):
    """Ticks at absolute deadlines of the monotonic clock."""

    def __init__(self, start: float | None = None) -> None:
        """`start`: when tick 0 is due, `time.monotonic` [s]; as soon as ticks are asked for."""
        super().__init__()
        self._start = start

    def ticks(self, period: float, duration: float) -> Iterator[float]:
        start = time.monotonic() if self._start is None else self._start
        last = last_tick(period, duration)
        number = 0
        while number <= last:
            wait = start + number * period - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            self.timing.lateness.append(time.monotonic() - start - number * period)
            self._tick()
            yield number * period
            now = time.monotonic() - start
            self.timing.durations.append(now - number * period - self.timing.lateness[-1])
            due = int(now / period) + 1
            self.timing.overruns += max(min(due, last + 1) - number - 1, 0)
            number = max(due, number + 1)


def check_duration(duration: float) -> None:
    """Whether a run can last so long [s].

    Raises:
        UsageError: it cannot.
    """
    if not 0.0 < duration <= LONGEST:
        raise UsageError(
            f"duration is {duration:g} s; give a time above zero, {LONGEST:g} s at most"
        )


def last_tick(period: float, duration: float) -> int:
    """Number of the last tick at or before `duration`."""
    return int(np.floor(duration / period * (1.0 + 1e-12) + 1e-9))
