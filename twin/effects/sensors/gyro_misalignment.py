"""A gyro that is mounted askew."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.rotation import conjugate, from_rotation_vector, rotate
from twin.signals import Samples


@dataclass(frozen=True)
class GyroMisalignment(SeriesEffect):
    """Its axes are the body's turned by phi: it shows R(phi)^T w."""

    name = "gyro_misalignment"
    domain = Domain.sensor
    observable = "a turn about one axis shows on the others"
    streams = ("gyro", "attitude")
    order = Order.geometry
    acts_on = "gyro"

    rotation: tuple[float, ...] = parameter(
        "from the body's axes to the sensor's",
        "rad",
        (5e-3, -3e-3, 8e-3),
        source="ASSUMED: 0.3 deg of mounting",
        low=-3.2,
        high=3.2,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, rotate(conjugate(self._turn), samples.value))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, rotate(self._turn, samples.value))

    @property
    def _turn(self) -> Array:
        return from_rotation_vector(np.array(self.rotation))
