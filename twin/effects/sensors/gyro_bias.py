"""A gyro that does not read zero at rest."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, BiasEffect


@dataclass(frozen=True)
class GyroBias(BiasEffect):
    """It shows a constant too much: x + b."""

    name = "gyro_bias"
    domain = Domain.sensor
    observable = "the gyro and the turning of the attitude differ by a constant"
    streams = ("gyro", "attitude")
    acts_on = "gyro"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "rad/s",
        (1e-3, -5e-4, 8e-4),
        source="004: an AHRS within 0.25 deg/s, which is 4.4e-3 rad/s",
        low=-10.0,
        high=10.0,
    )

    def error(self) -> Array:
        return np.array(self.bias)
