"""A lead screw whose pitch is not the one that is stated."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ScaleEffect, columns_of
from twin.platform import Platform


@dataclass(frozen=True)
class StageScale(ScaleEffect):
    """The mass goes to (1 + e) of the position that is commanded."""

    name = "stage_scale"
    domain = Domain.actuator
    observable = "position and mass moment change by more or less than the command says"
    streams = ("stage_position", "command_stage_position")
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

    def gain(self, platform: Platform) -> Array:
        return np.where(columns_of(self, platform, self.stream), 1.0 + self.error, 1.0)
