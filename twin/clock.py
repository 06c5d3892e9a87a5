"""Time for the loop: simulated (as fast as it goes) or the wall's, with lateness accounted.

Ticks stand at whole multiples of the period, computed and never accumulated. A wall clock that is
late skips the ticks it has missed and counts them; it never runs a burst to catch up.
"""

import abc
import time
from collections.abc import Iterator
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
    own: list[float] = field(default_factory=list[float])
    """How long each tick took, all phases together [s]; empty on a simulated clock."""

    def lateness_at(self, percent: float) -> float:
        """Percentile of the lateness [s]; 0 on a simulated clock."""
        return float(np.percentile(self.lateness, percent)) if self.lateness else 0.0

    def own_at(self, percent: float) -> float:
        """Percentile of what a tick took [s]; 0 on a simulated clock."""
        return float(np.percentile(self.own, percent)) if self.own else 0.0


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
            self.timing.own.append(now - number * period - self.timing.lateness[-1])
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
