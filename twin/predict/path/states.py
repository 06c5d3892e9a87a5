"""States of a machine at the starts of segments: how they are moved and told apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.effects import State

Array = NDArray[np.float64]

STEP = 1e-6
"""Of finite differences of a state [SI]."""


@dataclass(frozen=True)
class States:
    """One state a row, any leading axes.

    A change of one is (turn about body axes or change of the angle, change of the rate, change of
    the wheels' speeds, change of the gimbals' angles), `width` numbers.
    """

    position: Array
    """(..., 1) angle of a hinge [rad] or (..., 4) attitude of a ball."""
    rate: Array
    """(..., k) [rad/s], body axes."""
    wheel_speed: Array
    """(..., w) [rad/s]; width 0 where the wheels are not predicted."""
    gimbal_angle: Array
    """(..., g) [rad]."""

    @property
    def width(self) -> int:
        """Numbers of a change."""
        return 2 * self.rate.shape[-1] + self.wheel_speed.shape[-1] + self.gimbal_angle.shape[-1]

    def __getitem__(self, rows: Any) -> "States":
        """Those at an index of leading axes."""
        return States(*(part[rows] for part in self._parts))

    @property
    def flat(self) -> "States":
        """With one leading axis."""
        rows = int(np.prod(self.rate.shape[:-1]))
        return States(*(part.reshape(rows, part.shape[-1]) for part in self._parts))

    def one(self) -> "States":
        """With a leading axis of length 1."""
        return self[None]

    def moved(self, change: Array) -> "States":
        """After a change (..., width); leading axes broadcast."""
        k, w = self.rate.shape[-1], self.wheel_speed.shape[-1]
        turn = change[..., :k]
        if self.position.shape[-1] == 4:
            position = rotation.multiply(self.position, rotation.from_rotation_vector(turn))
        else:
            position = self.position + turn
        return States(
            position,
            self.rate + change[..., k : 2 * k],
            self.wheel_speed + change[..., 2 * k : 2 * k + w],
            self.gimbal_angle + change[..., 2 * k + w :],
        )

    def less(self, other: "States") -> Array:
        """The change (..., width) that leads from another state to this one."""
        if self.position.shape[-1] == 4:
            between = rotation.multiply(rotation.conjugate(other.position), self.position)
            turn = rotation.to_rotation_vector(between)
        else:
            turn = self.position - other.position
        rest = zip(self._parts[1:], other._parts[1:], strict=True)
        return np.concatenate([turn, *(mine - others for mine, others in rest)], axis=-1)

    def with_time(self, time: Array) -> State:
        """(n, .) as a torque law is told them, at some times (n,) [s]."""
        return State(self.position, self.rate, self.wheel_speed, time)

    @staticmethod
    def joined(several: Sequence["States"]) -> "States":
        """Those of the first axis in a row."""
        return States(*map(np.concatenate, zip(*(one._parts for one in several), strict=True)))

    @property
    def _parts(self) -> tuple[Array, Array, Array, Array]:
        return self.position, self.rate, self.wheel_speed, self.gimbal_angle
