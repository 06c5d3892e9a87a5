"""A wheel that is mounted askew."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect, body_of_joint
from twin.platform import Platform
from twin.rotation import from_rotation_vector, least_turn, multiply, rotate


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
