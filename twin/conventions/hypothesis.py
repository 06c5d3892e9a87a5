"""One way in which a log may have been misread: its corrections, and the body they give."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.conventions.correction import Correction
from twin.conventions.turning import SMALL_LAG
from twin.conventions.wheels import WheelReading

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hypothesis:
    """A handful of corrections, what they cost and what they leave unexplained."""

    corrections: tuple[Correction, ...]
    cost: float
    """[nats]: of the corrections, of lags however small, and of leaning over."""
    misfit: float
    """[nats]: of what is left unexplained."""
    attitude: Array
    """(4, 4) right = attitude @ read."""
    gyro: Array
    """(3, 3)."""
    force: Array
    """(3, 3), of the accelerometer."""
    gyro_lag: float
    """Own clock [s]."""
    attitude_lag: float
    """Own clock [s]."""
    wheels: WheelReading | None = None

    @property
    def words(self) -> str:
        """What is wrong; empty for the log as read."""
        return ", and ".join(c.words for c in self.corrections if c.words)

    @property
    def out_of_step(self) -> bool:
        """Whether gyro and attitude are on clocks further apart than a latency."""
        return abs(self.gyro_lag - self.attitude_lag) > SMALL_LAG + 1e-9

    @property
    def score(self) -> float:
        """[nats], the less the better; good enough to rank, not to decide."""
        return self.misfit + self.cost

    def says_less_than(self, other: "Hypothesis") -> bool:
        """Whether it corrects some of what the other does, in the same way, and nothing else."""
        return self._told < other._told

    @property
    def _told(self) -> set[tuple[object, ...]]:
        return {(c.stream, c.kind, c.axes, c.lag > 0.0) for c in self.corrections}
