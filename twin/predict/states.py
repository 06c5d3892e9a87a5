"""States of a machine at the starts of segments: how they are moved and told apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class States:
    """One state a row, any leading axes.

    A change of one is (turn about body axes or change of the angle, change of the rate, change of
    the wheels' speeds), `width` numbers.
    """

    position: Array
    """(..., 1) angle of a hinge [rad] or (..., 4) attitude of a ball."""
    rate: Array
    """(..., k) [rad/s], body axes."""
    wheel_speed: Array
    """(..., w) [rad/s]; width 0 where the wheels are not predicted."""

    @property
    def width(self) -> int:
        """Numbers of a change."""
        return 2 * self.rate.shape[-1] + self.wheel_speed.shape[-1]

    def __getitem__(self, rows: slice) -> "States":
        return States(self.position[rows], self.rate[rows], self.wheel_speed[rows])

    def one(self) -> "States":
        """With a leading axis of length 1."""
        return States(self.position[None], self.rate[None], self.wheel_speed[None])

    def moved(self, change: Array) -> "States":
        """After a change (..., width); leading axes broadcast."""
        k = self.rate.shape[-1]
        turn = change[..., :k]
        if self.position.shape[-1] == 4:
            position = rotation.multiply(self.position, rotation.from_rotation_vector(turn))
        else:
            position = self.position + turn
        return States(
            position,
            self.rate + change[..., k : 2 * k],
            self.wheel_speed + change[..., 2 * k :],
        )

    def less(self, other: "States") -> Array:
        """The change (..., width) that leads from another state to this one."""
        if self.position.shape[-1] == 4:
            between = rotation.multiply(rotation.conjugate(other.position), self.position)
            turn = rotation.to_rotation_vector(between)
        else:
            turn = self.position - other.position
        return np.concatenate(
            [turn, self.rate - other.rate, self.wheel_speed - other.wheel_speed], axis=-1
        )
