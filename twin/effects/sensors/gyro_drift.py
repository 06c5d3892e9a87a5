"""A gyro whose zero wanders, as while it warms."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class GyroDrift(SeriesEffect):
    """It shows ever more too much: x + d t."""

    name = "gyro_drift"
    domain = Domain.sensor
    observable = "the gyro and the turning of the attitude differ ever more"
    streams = ("gyro", "attitude")
    order = Order.bias
    acts_on = "gyro"

    drift: tuple[float, ...] = parameter(
        "change of the bias per second, its own axes",
        "rad/s^2",
        (1e-6, -5e-7, 8e-7),
        source="ASSUMED: 0.2 deg/s in an hour of warming",
        low=-1.0,
        high=1.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + samples.time[..., None] * np.array(self.drift))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - samples.time[..., None] * np.array(self.drift))
