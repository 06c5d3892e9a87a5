"""A star camera or motion capture whose body frame is not ours."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.rotation import conjugate, from_rotation_vector, multiply
from twin.signals import Samples


@dataclass(frozen=True)
class AttitudeMisalignment(SeriesEffect):
    """Its axes are the body's turned by phi: it shows q exp(phi / 2)."""

    name = "attitude_misalignment"
    domain = Domain.sensor
    observable = "the attitude turns about other axes than the gyro"
    streams = ("attitude", "gyro")
    order = Order.geometry
    acts_on = "attitude"

    rotation: tuple[float, ...] = parameter(
        "from the body's axes to the sensor's",
        "rad",
        (0.01, -0.02, 0.015),
        source="ASSUMED: 1 deg, markers placed by eye",
        low=-3.2,
        high=3.2,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, multiply(samples.value, self._turn))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(
            samples,
            multiply(samples.value, conjugate(self._turn)),
        )

    @property
    def _turn(self) -> Array:
        return from_rotation_vector(np.array(self.rotation))
