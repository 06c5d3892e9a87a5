"""A star camera or motion capture whose own vertical is not the room's."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.rotation import conjugate, from_rotation_vector, multiply
from twin.signals import Samples


@dataclass(frozen=True)
class AttitudeReferenceTilt(SeriesEffect):
    """Its reference is the world turned by delta about level axes: it shows exp(-delta / 2) q.

    Gravity alone gives it away, which pulls along another line than the one that is shown as
    vertical; a turn about that line is a heading, and shows nowhere.
    """

    name = "attitude_reference_tilt"
    domain = Domain.sensor
    observable = "gravity pulls along a line that is fixed in the room and not the vertical shown"
    streams = ("attitude",)
    order = Order.geometry
    acts_on = "attitude"

    about_x: float = parameter(
        "from the world's axes to the reference's, about x",
        "rad",
        0.005,
        source="ASSUMED: 0.3 deg, a calibration square on a floor that is not level",
        low=-1.0,
        high=1.0,
    )
    about_y: float = parameter(
        "and about y",
        "rad",
        -0.003,
        source="ASSUMED: likewise",
        low=-1.0,
        high=1.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, multiply(conjugate(self._turn), samples.value))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, multiply(self._turn, samples.value))

    @property
    def _turn(self) -> Array:
        # numbers, or arrays with the runs of a batch in front
        x, y = np.atleast_1d(self.about_x, self.about_y)
        return from_rotation_vector(np.concatenate([x, y, np.zeros_like(x)], axis=-1))
