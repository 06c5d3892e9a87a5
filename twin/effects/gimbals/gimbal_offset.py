"""A gimbal's encoder whose zero is not where the drawing has it."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, columns_of, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class GimbalOffset(SeriesEffect):
    """The angle that it shows is a constant too much: delta + b."""

    name = "gimbal_offset"
    domain = Domain.sensor
    observable = "the body feels the gyro's torque about an axis that the angle does not say"
    streams = ("gimbal_angle", "gyro")
    order = Order.bias
    acts_on = "gimbal_angle"
    takes = "gimbal"

    offset: float = parameter(
        "of the angle's zero",
        "rad",
        9e-3,
        source="ASSUMED: half a degree, set by eye",
        low=-3.2,
        high=3.2,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + self._offset(platform))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - self._offset(platform))

    def _offset(self, platform: Platform) -> Array:
        return np.where(columns_of(self, platform, self.stream), self.offset, 0.0)
