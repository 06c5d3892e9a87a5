"""Soft iron, along the magnetometer's axes."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class MagnetometerScale(SeriesEffect):
    """Each axis shows (1 + e) of what it should."""

    name = "magnetometer_scale"
    domain = Domain.sensor
    observable = "the measured field has another length on each axis"
    streams = ("magnetometer", "attitude")
    order = Order.scale
    acts_on = "magnetometer"

    error: tuple[float, ...] = parameter(
        "error of each axis's scale",
        "1",
        (0.02, -0.03, 0.01),
        source="ASSUMED: a few percent",
        low=-0.9,
        high=0.9,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value * (1.0 + np.array(self.error)))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value / (1.0 + np.array(self.error)))
