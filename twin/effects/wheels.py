"""Effects on reaction wheels."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect, body_of_joint
from twin.effects.on_series import Array, ScaleEffect, columns_of
from twin.platform import Platform
from twin.rotation import from_rotation_vector, least_turn, multiply, rotate


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


@dataclass(frozen=True)
class WheelInertiaError(BodyEffect):
    """The rotor has (1 + e) of the moments of inertia that are stated; the whole keeps its own.

    Without a target, all wheels have the same error: that cannot be told from a common scale of
    body and mass moment.
    """

    name = "wheel_inertia_error"
    domain = Domain.exchange
    observable = "the wheel's speed and the body's rate exchange in a wrong ratio"
    streams = ("gyro", "wheel_speed")
    takes = "wheel"

    error: float = parameter(
        "of the rotor's moments of inertia",
        "1",
        0.02,
        source="ASSUMED: a CAD value against the real one",
        low=-0.9,
        high=10.0,
    )

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        for name in self.of_parts([wheel.name for wheel in platform.wheels]):
            model.body_inertia[body_of_joint(model, name)] *= 1.0 + self.error


@dataclass(frozen=True)
class WheelMisalignment(BodyEffect):
    """The rotor and its axis are turned by phi about its CM; the whole keeps its inertia.

    A turn about the wheel's own axis does nothing.
    """

    name = "wheel_misalignment"
    domain = Domain.exchange
    observable = "a wheel's torque turns the body about other axes, too"
    streams = ("gyro", "wheel_speed")
    takes = "wheel"

    rotation: tuple[float, ...] = parameter(
        "of the wheel, body axes",
        "rad",
        (5e-3, -3e-3, 4e-3),
        source="ASSUMED: 0.3 deg of mounting",
        low=-1.5,
        high=1.5,
    )

    def least(self, platform: Platform) -> Self:
        axes = [wheel.axis for wheel in platform.wheels if wheel.name == self.target]
        if not axes:  # of all, which have no axis in common
            return self
        return self.if_possible(least_turn(np.array(self.rotation), axes[0]))

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        turn = from_rotation_vector(np.array(self.rotation))
        for name in self.of_parts([wheel.name for wheel in platform.wheels]):
            body = body_of_joint(model, name)
            center = model.body_ipos[body]
            quat = model.body_quat[body].copy()
            turned = multiply(turn, quat)
            model.body_pos[body] += rotate(quat, center) - rotate(turned, center)
            model.body_quat[body] = turned


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
