"""A lead screw whose pitch is not the one that is stated."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, columns_of, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class StageScale(SeriesEffect):
    """The mass goes to (1 + e) of the position that is commanded."""

    name = "stage_scale"
    domain = Domain.actuator
    observable = "position and mass moment change by more or less than the command says"
    streams = ("stage_position", "command_stage_position")
    order = Order.scale
    acts_on = "command_stage_position"
    takes = "stage"

    error: float = parameter(
        "of the scale",
        "1",
        0.01,
        source="ASSUMED: a percent of pitch",
        low=-0.9,
        high=10.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value * self._gain(platform))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value / self._gain(platform))

    def _gain(self, platform: Platform) -> Array:
        return np.where(columns_of(self, platform, self.stream), 1.0 + self.error, 1.0)
