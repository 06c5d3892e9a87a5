"""What a filter takes for noise besides the white noise of the sensors.

No room is still and no attitude is right: torques wander (draughts, cables, an air film), an
attitude filter's error does so slowly, and a gyro's bias drifts. Each is a first-order Gauss-Markov
process (Ornstein-Uhlenbeck), an integral of white noise at worst; where its size is 0 it is not
there. Sizes are shared over the axes of a machine and over its logs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

SLOW = ("attitude", "joint_angle", "inclinometer")
"""Streams whose errors may wander slowly: a filter's or a camera's."""
WALKING = ("gyro", "joint_rate")
"""Streams whose constant error may walk."""


@dataclass(frozen=True)
class GaussMarkov:
    """A process whose correlation falls by 1/e in a time constant."""

    rms: float = 0.0
    """In the unit of what it adds to."""
    time_constant: float = 1.0
    """[s]."""

    def decay(self, step: float) -> float:
        """What is left of a value after a step [s]."""
        return float(np.exp(-step / self.time_constant))


@dataclass(frozen=True)
class NoiseModel:
    """Sizes and time constants; by default all is as the sensors' white noise has it."""

    white_torque: float = 0.0
    """Intensity about each base axis of the machine as stated [(N m)^2 s]."""
    torque: GaussMarkov = field(default_factory=GaussMarkov)
    """Likewise, one that wanders [N m]."""
    errors: Mapping[str, GaussMarkov] = field(default_factory=dict[str, GaussMarkov])
    """Slow errors of streams, each column's own [rad]."""
    walks: Mapping[str, float] = field(default_factory=dict[str, float])
    """Random walks of streams' constant errors, each column's own [rad/s per s^0.5]."""
    scales: Mapping[str, float] = field(default_factory=dict[str, float])
    """Of a stream's white noise, in units of what it was taken to be."""

    @property
    def pushes(self) -> bool:
        """Whether a torque draws the motion to the logs."""
        return self.white_torque > 0.0 or self.torque.rms > 0.0

    @property
    def wanders(self) -> bool:
        """Whether there is more than white noise of the sensors."""
        errors = any(error.rms > 0.0 for error in self.errors.values())
        return self.pushes or errors or any(walk > 0.0 for walk in self.walks.values())

    @property
    def disturbance(self) -> float:
        """Intensity of a white torque that turns a machine as far in the long run [(N m)^2 s]."""
        return self.white_torque + 2.0 * self.torque.rms**2 * self.torque.time_constant

    def with_error(self, stream: str, error: GaussMarkov) -> "NoiseModel":
        """With another slow error of a stream."""
        return replace(self, errors={**self.errors, stream: error})

    def with_walk(self, stream: str, walk: float) -> "NoiseModel":
        """With another random walk of a stream's constant error."""
        return replace(self, walks={**self.walks, stream: walk})

    def with_scale(self, stream: str, scale: float) -> "NoiseModel":
        """With another size of a stream's white noise."""
        return replace(self, scales={**self.scales, stream: scale})


QUIET = NoiseModel()
"""Nothing but the sensors' white noise, of the size that it was taken to have."""
