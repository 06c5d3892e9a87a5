"""A gyro whose sensitivity is off."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ScaleEffect
from twin.platform import Platform


@dataclass(frozen=True)
class GyroScaleFactor(ScaleEffect):
    """Each axis shows (1 + e) of what it should."""

    name = "gyro_scale_factor"
    domain = Domain.sensor
    observable = "the gyro and the turning of the attitude differ in proportion to the rate"
    streams = ("gyro", "attitude")
    acts_on = "gyro"

    error: tuple[float, ...] = parameter(
        "error of each axis's scale",
        "1",
        (5e-3, -3e-3, 4e-3),
        source="ASSUMED: half a percent, usual for MEMS",
        low=-0.9,
        high=0.9,
    )

    def gain(self, platform: Platform) -> Array:
        return 1.0 + np.array(self.error)
