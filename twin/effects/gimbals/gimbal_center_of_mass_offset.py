"""A gimbal that is not balanced about its axis."""

from dataclasses import dataclass

import mujoco
import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect, body_of_joint
from twin.platform import Platform


@dataclass(frozen=True)
class GimbalCenterOfMassOffset(BodyEffect):
    """The mass moment of what a gimbal turns has parts across its axis, and so m r turns with it.

    Along the rotor's axis at angle 0, and along the gimbal's axis crossed with it. The whole has
    the stated mass properties at angle 0.
    """

    name = "gimbal_center_of_mass_offset"
    domain = Domain.torque
    observable = "a gravity torque that turns with the gimbal's angle"
    streams = ("gyro", "attitude", "gimbal_angle")
    takes = "gimbal"

    moment: tuple[float, ...] = parameter(
        "mass moment along the rotor's axis at 0, and across it",
        "kg m",
        (1e-3, -5e-4),
        source="ASSUMED: 10 kg whose CM lies 0.1 mm off",
        low=-10.0,
        high=10.0,
    )

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for name in self.of_parts([gimbal.name for gimbal in platform.gimbals]):
            body = body_of_joint(model, name)
            spin = next(p for p in (*platform.wheels, *platform.rotors) if p.gimbal == name)
            along = data.xaxis[model.joint(spin.name).id]
            across = np.cross(data.xaxis[model.joint(name).id], along)
            off = self.moment[0] * along + self.moment[1] * across
            model.body_ipos[body] += data.xmat[body].reshape(3, 3).T @ off / model.body_mass[body]
