"""Counters of a device that wrap, packets and ticks of its clock, and that clock against ours."""

import math
from collections import deque

from twin.plant.devices.xbus.tables import TICKS


class Wrapping:
    """Follows a counter modulo `span` by its shortest way, forwards or backwards."""

    def __init__(self, span: int) -> None:
        self._span = span
        self._last: int | None = None
        self.total = 0
        """Unwrapped, from the first value seen."""

    def step(self, value: int) -> int | None:
        """Difference to the value before, in [-span / 2, span / 2); None for the first."""
        if self._last is None:
            self._last, self.total = value, value
            return None
        half = self._span // 2
        difference = (value - self._last + half) % self._span - half
        self._last = value
        self.total += difference
        return difference

    def forget(self) -> None:
        """The device has begun anew."""
        self._last = None


class DeviceClock:
    """SampleTimeFine in seconds, unwrapped; it may step back, and then so does this."""

    def __init__(self, span: int) -> None:
        self._ticks = Wrapping(span)

    def read(self, ticks: int) -> tuple[float, float]:
        """The time, and the step from the one before [s]."""
        step = self._ticks.step(ticks) or 0
        return self._ticks.total / TICKS, step / TICKS

    def forget(self) -> None:
        """The device has begun anew."""
        self._ticks.forget()


_APART = 1e-4
"""At least between two samples [s]: a tick of the device's clock."""
SPAN = 10.0
"""So far back the promptest sample may lie [s]."""


class Promptest:
    """When a stamp of the device was by the host's clock, after the promptest sample of late.

    A busy host reads several samples at one instant, and they were not measured so. No sample comes
    before it was taken: the least of arrival less stamp is the clocks' difference, but for the
    shortest delay. It is taken over some seconds, in which a crystal drifts by less than that.
    """

    def __init__(self) -> None:
        self._last = -math.inf
        self._least = deque[tuple[float, float]]()
        """Arrival and its difference to the stamp, of those that may yet be the least."""

    def host(self, stamp: float, arrival: float) -> float:
        """The host's time of the stamp [s], after that of the stamp before.

        A prompter sample moves all later ones back, but never before one that was told.
        """
        while self._least and self._least[-1][1] >= arrival - stamp:
            self._least.pop()
        self._least.append((arrival, arrival - stamp))
        while arrival - self._least[0][0] > SPAN:
            self._least.popleft()
        self._last = max(stamp + self._least[0][1], self._last + _APART)
        return self._last

    def forget(self) -> None:
        """The device's clock has stepped."""
        self._least.clear()
