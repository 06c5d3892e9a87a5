"""One way in which a log may have been misread: its corrections, and the body they give."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.conventions.correction import Correction
from twin.conventions.gravity import Upright
from twin.conventions.turning import SMALL_LAG, Turning
from twin.conventions.wheels import WheelReading
from twin.recording import Series

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AttitudeReading:
    """The attitude as its file's angles are read, held against gyro and gravity."""

    change: Correction | None
    """Of signs and order of Euler angles; None: as read, and of every quaternion."""
    series: Series
    turning: Turning
    upright: Upright | None


@dataclass(frozen=True)
class Hypothesis:
    """A handful of corrections, what they cost and what they leave unexplained."""

    corrections: tuple[Correction, ...]
    cost: float
    """[nats]: of the corrections, of lags however small, and of leaning over."""
    misfit: float
    """[nats]: of what is left unexplained."""
    reading: AttitudeReading
    """Which attitude the following turn."""
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
    def key(self) -> tuple[object, ...]:
        """What it corrects: two of one key are one."""
        return tuple((c.stream, c.kind, c.axes, c.keys, c.lag) for c in self.corrections)

    @property
    def of_whole_log(self) -> bool:
        """Whether no stream is corrected by itself: the log as read, or in another frame."""
        return all(c.kind == "frame" for c in self.corrections)

    @property
    def framed(self) -> bool:
        """Whether the whole log is in another frame than as read."""
        return any(c.kind == "frame" for c in self.corrections)

    @property
    def out_of_step(self) -> bool:
        """Whether gyro and attitude are on clocks further apart than a latency."""
        return abs(self.gyro_lag - self.attitude_lag) > SMALL_LAG + 1e-9

    @property
    def score(self) -> float:
        """[nats], the less the better; good enough to rank, not to decide."""
        return self.misfit + self.cost
