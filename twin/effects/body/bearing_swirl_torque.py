"""Torque of the air that leaves the film with a swirl, also called turbine torque."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect, Push
from twin.platform import Platform


@dataclass(frozen=True)
class BearingSwirlTorque(BodyEffect):
    """The bearing's air turns the body about the vertical: torque R^T (0, 0, k).

    A torque with the room's axes on the bus: exact at every stage of RK4.
    """

    name = "bearing_swirl_torque"
    domain = Domain.torque
    observable = "momentum about the vertical grows steadily, whatever the attitude"
    streams = ("gyro", "attitude")

    strength: float = parameter(
        "torque about the vertical",
        "N m",
        2e-5,
        source="ASSUMED: turns 12 kg m^2 by 1 deg in 2.4 min",
        low=-10.0,
        high=10.0,
    )

    def pushes(self, platform: Platform) -> tuple[Push, ...]:
        wrench = np.array([0.0, 0.0, 0.0, 0.0, 0.0, self.strength])
        return (Push(platform.base.body, wrench),)
