"""The host's clock, and a device's clock against it.

A device's clock against the host's: offset and drift, as bounds that cannot be wrong.
A stamp that the device made on receiving something was made after the host had sent it; one that
the host then receives was made before it came. So every exchange, and every sample that arrives,
bounds the line host = offset + rate x device from one side, and what all of them leave open is the
interval (as in D. L. Mills' intersection for NTP). It holds for any delay and any jitter, as long
as the rate is constant over the window.
"""

import abc
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.plant.devices.port import Port


class HostTime(abc.ABC):
    """What time it is, and how one waits."""

    wall: bool
    """It goes on by itself."""

    @abc.abstractmethod
    def time(self) -> float:
        """Monotonic [s]."""

    @abc.abstractmethod
    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""

    @abc.abstractmethod
    def read(self, port: Port, timeout: float) -> bytes:
        """What arrives within `timeout` [s] where no thread reads; the first of it is enough."""

    @abc.abstractmethod
    def watch(self, port: Port) -> None:
        """A thread reads this port from now on."""


class WallTime(HostTime):
    """`time.monotonic`."""

    wall = True

    def time(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(max(seconds, 0.0))

    def read(self, port: Port, timeout: float) -> bytes:
        return port.read(timeout)

    def watch(self, port: Port) -> None:
        del port


WALL = WallTime()


Array = NDArray[np.float64]

LARGEST_DRIFT = 1e-2
"""[s/s]: a resonator without a crystal is within half of this."""

WINDOW = 64.0
"""So far back do bounds count [s]: within it a warming crystal's rate may be called constant."""

_BIN = 1.0
"""One bound a side is kept of each so long [s]."""

_GRID = 17
_ROUNDS = 8
"""Each leaves an eighth of the range of rates: together 6e-8 of it."""

_ROUNDING = 1e-8
"""[s]."""


@dataclass(frozen=True)
class ClockEstimate:
    """The line, at one instant of the device's clock."""

    device_time: float
    """[s]."""
    host_time: float
    """Of that instant [s], in the middle of its interval."""
    half_width: float
    """Of that interval [s]."""
    drift: float
    """How much faster the host's clock runs [s/s], in the middle of its interval."""
    drift_half_width: float
    """[s/s]."""

    def host(self, device_time: float) -> float:
        """When it was, by the host's clock [s]."""
        return self.host_time + (1.0 + self.drift) * (device_time - self.device_time)


class ClockFit:
    """Takes exchanges and arrivals, in the order of time, and keeps the bounds that matter."""

    def __init__(self) -> None:
        self.estimate: ClockEstimate | None = None
        """After the first exchange."""
        self.restarts = 0
        """Times that no line went through all bounds: the device's clock jumped or changed pace."""
        self._early: dict[int, tuple[float, float]] = {}
        """Bin -> device and host time of its tightest bound from below."""
        self._late: dict[int, tuple[float, float]] = {}

    def exchange(
        self, sent: float, device_received: float, device_sent: float, back: float
    ) -> None:
        """One question and its answer: host, device, device, host [s]."""
        number = int(back // _BIN)
        _keep(self._early, number, (device_received, sent), side=1.0)
        _keep(self._late, number, (device_sent, back), side=-1.0)
        for bounds in (self._early, self._late):
            for old in [n for n in bounds if n < number - WINDOW / _BIN]:
                del bounds[old]
        self.estimate = _line(self._early, self._late, device_sent)
        if self.estimate is None:
            self.restarts += 1
            self._early = {number: (device_received, sent)}
            self._late = {number: (device_sent, back)}
            self.estimate = _line(self._early, self._late, device_sent)

    def arrival(self, device_time: float, host_time: float) -> None:
        """Something stamped `device_time` came at `host_time` [s]."""
        _keep(self._late, int(host_time // _BIN), (device_time, host_time), side=-1.0)


def _keep(
    bounds: dict[int, tuple[float, float]], number: int, new: tuple[float, float], *, side: float
) -> None:
    """Keep the tighter of two bounds: from below (side 1) the later, from above the earlier."""
    old = bounds.get(number)
    if old is None or side * (new[1] - new[0]) > side * (old[1] - old[0]):
        bounds[number] = new


def _line(
    early: dict[int, tuple[float, float]], late: dict[int, tuple[float, float]], at: float
) -> ClockEstimate | None:
    """What lines above all `early` and below all `late` leave open; None if there is no such."""
    below, above = np.array(list(early.values())), np.array(list(late.values()))
    below[:, 0] -= at
    above[:, 0] -= at
    slow, fast = _rates(below, above)
    if slow > fast:
        return None
    lowest, highest = _lowest(below, slow, fast), -_lowest(-above, slow, fast)
    if lowest > highest + _ROUNDING:
        return None
    return ClockEstimate(
        device_time=at,
        host_time=0.5 * (lowest + highest),
        half_width=0.5 * max(highest - lowest, 0.0),
        drift=0.5 * (slow + fast) - 1.0,
        drift_half_width=0.5 * (fast - slow),
    )


def _rates(below: Array, above: Array) -> tuple[float, float]:
    """Slowest and fastest line over every point of one set and under every one of the other."""
    apart = above[:, 0] - below[:, 0, None]
    rise = above[:, 1] - below[:, 1, None]
    forward, backward = apart > 0.0, apart < 0.0
    fast = np.min(rise[forward] / apart[forward], initial=1.0 + LARGEST_DRIFT)
    slow = np.max(rise[backward] / apart[backward], initial=1.0 - LARGEST_DRIFT)
    return float(slow), float(fast)


def _lowest(points: Array, slow: float, fast: float) -> float:
    """Lowest value at 0 of a line over all points (x, y), at any rate in between."""
    lowest = np.inf
    for _ in range(_ROUNDS):
        rates = np.linspace(slow, fast, _GRID)
        needed = (points[:, 1, None] - points[:, 0, None] * rates).max(axis=0)
        best = int(needed.argmin())
        lowest = float(needed[best])
        # a maximum of straight lines is convex: the least lies beside the best of the grid
        slow, fast = rates[max(best - 1, 0)], rates[min(best + 1, _GRID - 1)]
    return lowest
