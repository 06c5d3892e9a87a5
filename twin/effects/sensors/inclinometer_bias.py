"""An inclinometer that is not level with the platform."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class InclinometerBias(SeriesEffect):
    """It shows a constant too much: x + b."""

    name = "inclinometer_bias"
    domain = Domain.sensor
    observable = "it and the attitude differ by a constant"
    streams = ("inclinometer", "attitude")
    order = Order.bias
    acts_on = "inclinometer"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "rad",
        (2e-3, -1e-3),
        source="ASSUMED: 0.1 deg of mounting",
        low=-1.0,
        high=1.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + np.array(self.bias))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - np.array(self.bias))
