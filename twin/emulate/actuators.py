"""What moves behind an emulated microcontroller: stages that ramp, wheels that spin and coast."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class EmulatedStages:
    """Masses on lead screws, driven by steps that are counted and never measured."""

    count: int
    speed: float
    """Highest [m/s]."""
    acceleration: float
    """[m/s^2]."""
    position: Array = field(default_factory=lambda: np.zeros(0))
    """(count,) where they are [m]."""
    lost: Array = field(default_factory=lambda: np.zeros(0))
    """(count,) what a counter that began anew does not know of [m]."""

    def __post_init__(self) -> None:
        if not self.position.size:
            self.position = np.zeros(self.count)
        self.lost = np.zeros(self.count)
        self.velocity = np.zeros(self.count)

    @property
    def counted(self) -> Array:
        """(count,) where the counter says that they are [m]."""
        return self.position - self.lost

    def step(self, target: Array | None, duration: float) -> None:
        """Go on towards `target` (count,), as counted [m]; without one, brake and hold."""
        gain = self.acceleration * duration
        if target is None:
            wanted = np.zeros(self.count)
        else:
            away = target - self.counted
            # braking by `gain` a step takes v^2 / (2 a) + v duration / 2, this step included
            reach = np.sqrt(0.25 * gain**2 + 2.0 * self.acceleration * np.abs(away)) - 0.5 * gain
            wanted = np.sign(away) * np.minimum(
                np.minimum(self.speed, reach), np.abs(away) / duration
            )
        self.velocity += np.clip(wanted - self.velocity, -gain, gain)
        self.position = self.position + self.velocity * duration

    def restart(self) -> None:
        """The counter begins at zero, wherever the masses are; they stop."""
        self.lost = self.position.copy()
        self.velocity[:] = 0.0


@dataclass
class EmulatedWheels:
    """Reaction wheels on a body that stands still."""

    inertia: Array
    """(count,) [kg m^2]."""
    torque_limit: float
    """[N m]."""
    drag: float = 0.0
    """Torque per speed [N m s]."""

    def __post_init__(self) -> None:
        self.speed = np.zeros(len(self.inertia))

    def step(self, torque: Array | None, duration: float) -> None:
        """Apply a torque (count,) [N m]; without one they coast, nothing brakes them."""
        motor = 0.0 if torque is None else np.clip(torque, -self.torque_limit, self.torque_limit)
        self.speed += (motor - self.drag * self.speed) / self.inertia * duration
