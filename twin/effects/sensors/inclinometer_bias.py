"""An inclinometer that is not level with the platform."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, BiasEffect


@dataclass(frozen=True)
class InclinometerBias(BiasEffect):
    """It shows a constant too much: x + b."""

    name = "inclinometer_bias"
    domain = Domain.sensor
    observable = "it and the attitude differ by a constant"
    streams = ("inclinometer", "attitude")
    acts_on = "inclinometer"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "rad",
        (2e-3, -1e-3),
        source="ASSUMED: 0.1 deg of mounting",
        low=-1.0,
        high=1.0,
    )

    def error(self) -> Array:
        return np.array(self.bias)
