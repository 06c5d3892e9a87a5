"""Soft iron, along the magnetometer's axes."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ScaleEffect
from twin.platform import Platform


@dataclass(frozen=True)
class MagnetometerScale(ScaleEffect):
    """Each axis shows (1 + e) of what it should."""

    name = "magnetometer_scale"
    domain = Domain.sensor
    observable = "the measured field has another length on each axis"
    streams = ("magnetometer", "attitude")
    acts_on = "magnetometer"

    error: tuple[float, ...] = parameter(
        "error of each axis's scale",
        "1",
        (0.02, -0.03, 0.01),
        source="ASSUMED: a few percent",
        low=-0.9,
        high=0.9,
    )

    def gain(self, platform: Platform) -> Array:
        return 1.0 + np.array(self.error)
