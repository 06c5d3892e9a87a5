"""A wheel's motor that gives more or less than it is asked for."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ScaleEffect, columns_of
from twin.platform import Platform


@dataclass(frozen=True)
class WheelTorqueGain(ScaleEffect):
    """Of a commanded torque, (1 + e) arrives."""

    name = "wheel_torque_gain"
    domain = Domain.actuator
    observable = "the wheel's speed changes by more or less than the command says"
    streams = ("wheel_speed", "command_wheel_torque")
    acts_on = "command_wheel_torque"
    takes = "wheel"

    error: float = parameter(
        "of the scale",
        "1",
        0.05,
        source="ASSUMED: the tolerance of a torque constant",
        low=-0.9,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return np.where(columns_of(self, platform, self.stream), 1.0 + self.error, 1.0)
