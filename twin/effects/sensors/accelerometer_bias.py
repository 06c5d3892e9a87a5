"""An accelerometer that does not read zero in free fall."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, BiasEffect


@dataclass(frozen=True)
class AccelerometerBias(BiasEffect):
    """It shows a constant too much: x + b."""

    name = "accelerometer_bias"
    domain = Domain.sensor
    observable = "the length of the measured gravity changes with attitude"
    streams = ("accelerometer", "attitude")
    acts_on = "accelerometer"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "m/s^2",
        (0.05, -0.03, 0.02),
        source="ASSUMED: 5 mg, usual for MEMS",
        low=-50.0,
        high=50.0,
    )

    def error(self) -> Array:
        return np.array(self.bias)
