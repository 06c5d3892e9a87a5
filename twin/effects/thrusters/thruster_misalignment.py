"""Thrusters that do not point where the drawing has them."""

from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import Array, BodyEffect
from twin.platform import Platform, Thruster
from twin.rotation import conjugate, from_rotation_vector, least_turn, multiply, rotate


@dataclass(frozen=True)
class ThrusterMisalignment(BodyEffect):
    """The force of a thruster is turned by phi, about the point where it acts.

    A turn about its own direction does nothing.
    """

    name = "thruster_misalignment"
    domain = Domain.actuator
    observable = "a thruster turns the body about other axes, too"
    streams = ("gyro", "command_thruster")
    takes = "thruster"

    rotation: tuple[float, ...] = parameter(
        "of the force, body axes",
        "rad",
        (0.02, -0.01, 0.03),
        source="ASSUMED: 1 to 2 deg of mounting",
        low=-1.5,
        high=1.5,
    )

    def least(self, platform: Platform) -> Self:
        axes = [
            thruster.direction for thruster in platform.thrusters if thruster.name == self.target
        ]
        if not axes:  # of all, which have no axis in common
            return self
        return self.if_possible(least_turn(np.array(self.rotation), axes[0]))

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for name in self.of_parts([thruster.name for thruster in platform.thrusters]):
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
            if site < 0:  # on a bearing that stands it is a torque, which `edit_thruster` turns
                continue
            carrier = data.xquat[model.site_bodyid[site]]
            local = multiply(conjugate(carrier), multiply(self._turn, carrier))
            model.site_quat[site] = multiply(local, model.site_quat[site])
            model.site_sameframe[site] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE

    def edit_thruster(self, thruster: Thruster) -> Thruster:
        if not self.of_parts([thruster.name]):
            return thruster
        return replace(thruster, direction=rotate(self._turn, thruster.direction))

    @property
    def _turn(self) -> Array:
        return from_rotation_vector(np.array(self.rotation))
