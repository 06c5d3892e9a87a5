"""Viscous drag of the air film between cup and ball."""

from dataclasses import dataclass

import mujoco

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect
from twin.platform import Platform


@dataclass(frozen=True)
class BearingViscousFriction(BodyEffect):
    """The bearing brakes in proportion to the rate: torque -c w.

    MuJoCo's joint damping: exact at every stage of RK4.
    """

    name = "bearing_viscous_friction"
    domain = Domain.torque
    observable = "the rate decays exponentially, about every axis alike"
    streams = ("gyro",)

    damping: float = parameter(
        "torque per rate",
        "N m s",
        1e-3,
        source="ASSUMED: 12 kg m^2 slow down to 1/e in 3.3 h",
        low=0.0,
        high=10.0,
    )

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        spec.joint(platform.base.joint).damping[0] += self.damping
