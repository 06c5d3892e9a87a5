"""Joints that follow a profile, whatever pushes back: sliding masses, gimbals, rotors.

MuJoCo is given the force that moves their armature as planned; after each tick they are put
exactly on their profile.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from twin.model import Machine
from twin.plant.gimbals import ramp
from twin.plant.stages import plan
from twin.platform import Platform

Array = NDArray[np.float64]

DRIVE = 0.01
"""Longest time for which a drive holds an acceleration [s]. A profile depends on it, so it must not
depend on how finely the physics is stepped."""


class PrescribedJoints:
    """Their profiles in n runs."""

    def __init__(self, machine: Machine, qpos: Array, qvel: Array) -> None:
        """Start where `qpos` (n, nq) and `qvel` (n, nv) are; both are written to by `pin`."""
        platform = machine.platform
        self._machine = machine
        self._qpos, self._qvel = qpos, qvel
        self._held = _held(platform)
        self._period = self._held * platform.step
        self._inertia = machine.stage_inertia, machine.gimbal_inertia
        stages, gimbals = platform.stages, platform.gimbals
        self._has_stages, self._has_gimbals = bool(stages), bool(gimbals)
        self.stage_position = qpos[:, machine.stage_qpos].copy()
        """(n, stages) [m]."""
        self._stage_speed = np.zeros_like(self.stage_position)
        self._stage_wish = self.stage_position.copy()
        self._late = [round(stage.response / platform.tick) for stage in stages]
        kept = 1 + max(self._late, default=0)
        self._sent = deque([self._stage_wish] * kept, maxlen=kept)
        self._max_speed = np.array([stage.speed for stage in stages])
        self._max_acceleration = np.array([stage.acceleration for stage in stages])
        self._driven: Array | None = None
        self._gimbal_angle = qpos[:, machine.gimbal_qpos].copy()
        self._gimbal_rate = np.zeros_like(self._gimbal_angle)
        self._gimbal_target = self._gimbal_rate
        self._gimbal_acceleration = np.array([gimbal.acceleration for gimbal in gimbals])
        self._qvel[:, machine.rotor_dof] = [rotor.speed for rotor in platform.rotors]

    def send_stages(self, position: Array) -> None:
        """Positions (n, stages) [m] to go for, once the drives respond."""
        self._stage_wish = position

    def drive_stages(self, position: Array) -> None:
        """Where drives that are none of ours bring them by the end of the next tick, (n, stages)
        [m]; from now on no profile is planned here."""
        self._driven = position

    def send_gimbals(self, rate: Array) -> None:
        """Rates (n, gimbals) [rad/s] to go for."""
        self._gimbal_target = rate

    def forces(self, steps: int) -> Array | None:
        """Forces (n, steps, nv) on the joints in the next tick; None while none accelerates."""
        target = self._responded()
        force: Array | None = None
        if self._driven is not None:
            force = self._follow(self._driven, steps)
        elif self._has_stages and (
            self._stage_speed.any() or (self.stage_position != target).any()
        ):
            acceleration, self.stage_position, self._stage_speed = plan(
                self.stage_position,
                self._stage_speed,
                target,
                steps=steps // self._held,
                step=self._period,
                max_speed=self._max_speed,
                max_acceleration=self._max_acceleration,
            )
            force = self.no_forces(steps)
            push = np.repeat(acceleration, self._held, axis=1) * self._inertia[0]
            force[:, :, self._machine.stage_dof] = push
        if self._has_gimbals:
            if (self._gimbal_rate == self._gimbal_target).all():
                self._gimbal_angle = self._gimbal_angle + (
                    self._gimbal_rate * (steps * self._machine.platform.step)
                )
                return force
            acceleration, self._gimbal_angle, self._gimbal_rate = ramp(
                self._gimbal_angle,
                self._gimbal_rate,
                self._gimbal_target,
                steps=steps // self._held,
                step=self._period,
                max_acceleration=self._gimbal_acceleration,
            )
            force = self.no_forces(steps) if force is None else force
            push = np.repeat(acceleration, self._held, axis=1) * self._inertia[1]
            force[:, :, self._machine.gimbal_dof] = push
        return force

    def _responded(self) -> Array:
        """Positions (n, stages) [m] that the drives go for in the next tick, each its response
        after they were sent."""
        self._sent.append(self._stage_wish)
        if not any(self._late):
            return self._stage_wish
        columns = [self._sent[-1 - late][:, i] for i, late in enumerate(self._late)]
        return np.stack(columns, axis=1)

    def _follow(self, position: Array, steps: int) -> Array | None:
        """The force that brings the stages to the mean speed of the way there; None: they rest."""
        duration = steps * self._machine.platform.step
        speed = (position - self.stage_position) / duration
        acceleration = (speed - self._stage_speed) / duration
        self.stage_position, self._stage_speed = position, speed
        if not acceleration.any():
            return None
        force = self.no_forces(steps)
        force[:, :, self._machine.stage_dof] = (acceleration * self._inertia[0])[:, None]
        return force

    def pin(self) -> None:
        """Put the joints on their profile: what pushed back in a tick is forgotten."""
        machine = self._machine
        if self._has_stages:
            self._qpos[:, machine.stage_qpos] = self.stage_position
            self._qvel[:, machine.stage_dof] = self._stage_speed
        if self._has_gimbals:
            self._qpos[:, machine.gimbal_qpos] = self._gimbal_angle
            self._qvel[:, machine.gimbal_dof] = self._gimbal_rate

    def no_forces(self, steps: int) -> Array:
        """Zeros of the shape of `forces`."""
        return np.zeros((len(self._qpos), steps, self._machine.model.nv))


def _held(platform: Platform) -> int:
    """Physics steps for which a drive holds an acceleration; a tick has a whole number of such."""
    steps = platform.steps_per_tick
    most = max(1, int(DRIVE / platform.step + 1e-6))
    return max(k for k in range(1, min(most, steps) + 1) if steps % k == 0)
