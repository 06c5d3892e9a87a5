"""An inclinometer that is mounted askew."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.rotation import conjugate, from_rotation_vector, rotate
from twin.signals import Samples


@dataclass(frozen=True)
class InclinometerMisalignment(SeriesEffect):
    """Its axes are the body's turned by phi: it shows the elevations of its own axes.

    From roll and pitch to the vertical in body axes, to that in the sensor's, and back; of a body
    that stands less than upright, the vertical's z is taken as positive.
    """

    name = "inclinometer_misalignment"
    domain = Domain.sensor
    observable = "roll shows in pitch, and level reads as tilted"
    streams = ("inclinometer", "attitude")
    order = Order.geometry
    acts_on = "inclinometer"

    rotation: tuple[float, ...] = parameter(
        "from the body's axes to the sensor's",
        "rad",
        (5e-3, -3e-3, 0.02),
        source="ASSUMED: 0.3 deg of mounting, 1 deg of heading",
        low=-1.5,
        high=1.5,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        turn = conjugate(from_rotation_vector(np.array(self.rotation)))
        return with_value(samples, _elevations(rotate(turn, _vertical(samples.value))))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        turn = from_rotation_vector(np.array(self.rotation))
        return with_value(samples, _elevations(rotate(turn, _vertical(samples.value))))


def _vertical(elevation: Array) -> Array:
    """The vertical in the sensor's axes, from roll = asin(R_zy), pitch = -asin(R_zx)."""
    y, x = np.sin(elevation[..., 0]), -np.sin(elevation[..., 1])
    return np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)


def _elevations(vertical: Array) -> Array:
    x, y = np.clip(vertical[..., 0], -1.0, 1.0), np.clip(vertical[..., 1], -1.0, 1.0)
    return np.stack([np.arcsin(y), -np.arcsin(x)], axis=-1)
