"""Friction in the bearings of a wheel."""

from dataclasses import dataclass

import mujoco

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect
from twin.platform import Platform


@dataclass(frozen=True)
class WheelFriction(BodyEffect):
    """A viscous and a dry torque brake the rotor against the body.

    MuJoCo's joint damping and friction loss, which its solver holds at every stage of RK4.
    """

    name = "wheel_friction"
    domain = Domain.exchange
    observable = "a wheel that no command drives slows down and takes the body with it"
    streams = ("wheel_speed", "command_wheel_torque")
    takes = "wheel"

    viscous: float = parameter(
        "torque per wheel speed",
        "N m s",
        1e-5,
        source="ASSUMED: 0.028 kg m^2 slow down to 1/e in 47 min",
        low=0.0,
        high=1.0,
    )
    dry: float = parameter(
        "torque at every speed",
        "N m",
        1e-3,
        source="ASSUMED: two small ball bearings",
        low=0.0,
        high=10.0,
    )

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        for name in self.of_parts([wheel.name for wheel in platform.wheels]):
            joint = spec.joint(name)
            joint.damping[0] += self.viscous
            joint.frictionloss += self.dry
