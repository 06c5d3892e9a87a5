"""Iron on the platform adds to the field (hard iron)."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, BiasEffect


@dataclass(frozen=True)
class MagnetometerBias(BiasEffect):
    """It shows a constant too much: x + b."""

    name = "magnetometer_bias"
    domain = Domain.sensor
    observable = "the length of the measured field changes with attitude"
    streams = ("magnetometer", "attitude")
    acts_on = "magnetometer"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "T",
        (2e-6, -1e-6, 3e-6),
        source="ASSUMED: a twentieth of the field of the Earth",
        low=-1.0,
        high=1.0,
    )

    def error(self) -> Array:
        return np.array(self.bias)
