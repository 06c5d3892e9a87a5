"""A wheel that is not balanced."""

from dataclasses import dataclass

import mujoco
import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import Array, BodyEffect, body_of_joint
from twin.platform import Platform

_STEPS = 20
"""Of a turn, that RK4 needs to follow it."""


@dataclass(frozen=True)
class WheelImbalance(BodyEffect):
    """The rotor's CM lies off its axis, and the axis is no principal one.

    Static U_s = m e, dynamic U_d the product of inertia of axis and radius, both along one radius
    of the rotor. The whole has the stated mass properties where the rotor stands at first.

    At a speed W the body is shaken across the axis by (U_d + h U_s) W^2, h being the rotor's height
    above the CR along the axis, so its rate swings by that over J W: a fast wheel shows more. About
    the axis it is shaken by a U_s W^2, a being how far the axis passes from the CR: a wheel whose
    axis passes through it shows the sum U_d + h U_s alone.
    """

    name = "wheel_imbalance"
    domain = Domain.exchange
    observable = "a line in the rate's spectrum that moves with the wheel's speed"
    streams = ("gyro", "wheel_speed")
    takes = "wheel"

    static: float = parameter(
        "mass moment about the axis",
        "kg m",
        1e-5,
        source="ASSUMED: 1 g cm, a wheel balanced with care",
        low=0.0,
        high=1.0,
    )
    dynamic: float = parameter(
        "product of inertia",
        "kg m^2",
        1e-6,
        source="ASSUMED: 10 g cm^2, likewise",
        low=0.0,
        high=1.0,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        wheels = [wheel for wheel in platform.wheels if self.target in ("", wheel.name)]
        if missing or not wheels:
            return missing
        fastest = max(wheels, key=lambda wheel: wheel.speed_limit)
        longest = 2.0 * np.pi / (_STEPS * fastest.speed_limit)
        if platform.step <= longest:
            return ""
        return (
            f"at its top speed of {fastest.speed_limit:.0f} rad/s {fastest.name} turns "
            f"{fastest.speed_limit * platform.step:.2g} rad in a step of {platform.step:g} s; "
            f"set simulation.step to {longest:.2g} s or less"
        )

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        for name in self.of_parts([wheel.name for wheel in platform.wheels]):
            body = body_of_joint(model, name)
            axis: Array = model.jnt_axis[model.joint(name).id]
            radius = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
            radius /= np.linalg.norm(radius)
            model.body_ipos[body] += self.static / model.body_mass[body] * radius
            frame = np.empty(9)
            mujoco.mju_quat2Mat(frame, model.body_iquat[body])
            turn = frame.reshape(3, 3)
            tensor = turn @ np.diag(model.body_inertia[body]) @ turn.T
            tensor -= self.dynamic * (np.outer(axis, radius) + np.outer(radius, axis))
            moments, axes = np.linalg.eigh(tensor)
            axes[:, 2] *= np.linalg.det(axes)
            quat = np.empty(4)
            mujoco.mju_mat2Quat(quat, axes.ravel())
            model.body_inertia[body], model.body_iquat[body] = moments, quat
