"""A hinge's motor that gives more or less than its torque reading says."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ScaleEffect
from twin.platform import Platform


@dataclass(frozen=True)
class JointTorqueGain(ScaleEffect):
    """Of the commanded torque of a hinge, (1 + e) arrives.

    Torque, J and m r have one common factor, which no motion shows: it is seen where platform.toml
    states the standard deviations of J and m r.
    """

    name = "joint_torque_gain"
    domain = Domain.actuator
    observable = "the hinge moves by more or less than the torque says, for the J and m r stated"
    streams = ("joint_angle", "command_joint_torque")
    acts_on = "command_joint_torque"
    exact = True

    error: float = parameter(
        "of the scale",
        "1",
        -0.1,
        source="ASSUMED: what gears lose, and the tolerance of a torque constant",
        low=-0.9,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return np.ones(1) + self.error

    def hidden_from(self, platform: Platform) -> str:
        if platform.inertia_sd is None or platform.center_of_mass_offset_sd is None:
            return "without inertia_sd and center_of_mass_offset_sd J and m r may take it"
        return ""
