"""A stepper motor that shakes the gyro while it runs."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ScatterEffect, columns_of
from twin.platform import Platform


@dataclass(frozen=True)
class StageVibration(ScatterEffect):
    """White noise on the gyro, as strong as the stages are fast (root of the sum of squares)."""

    name = "stage_vibration"
    domain = Domain.sensor
    observable = "the gyro scatters more while a mass moves"
    streams = ("gyro", "stage_position")
    takes = "stage"
    acts_on = "gyro"
    cause = "stage_speed"

    gain: float = parameter(
        "1 sigma a sample, per stage speed",
        "(rad/s)/(m/s)",
        1.0,
        source="003: 0.006 to 0.019 rad/s would account for Table 1; at some 10 mm/s",
        low=0.0,
        high=1e4,
    )

    def sigma(self, cause: Array, platform: Platform) -> Array:
        own = cause[..., columns_of(self, platform, "stage_position")]
        return self.gain * np.sqrt(np.sum(np.square(own), axis=-1, keepdims=True))
