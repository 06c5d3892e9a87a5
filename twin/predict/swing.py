"""Rollouts of a machine that is one hinge, by its own equation of motion.

    M a = f + gear u + p(q) - d w,   p(q) = s sin q + c cos q - k (q - q0)

with s sin q + c cos q = r sin(q + phase): one sine, for the time of a step of a few paths is that
of its calls.

Classical Runge-Kutta as in MuJoCo, many paths side by side: the same path to rounding, in a tenth
of the time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Answer = Callable[[int, Array, Array], Array]
"""A torque on the base, by the number of a step, and positions and velocities where it begins."""
ALIKE = 1e-9
"""Share of the acceleration to which the equation must agree with MuJoCo to stand in for it."""
PROBES = ((0.3, -0.7), (2.9, 1.9), (-4.1, 0.2))
"""Angle [rad] and rate [rad/s] where that is seen."""


@dataclass(frozen=True)
class Swing:
    """A hinge's equation of motion, as a model has it."""

    step: float
    """[s]."""
    inertia: float
    """M [kg m^2]."""
    sine: float
    cosine: float
    """s, c [N m]."""
    stiffness: float
    """k [N m/rad]."""
    spring_reference: float
    """q0 [rad]."""
    damping: float
    """d [N m s]."""
    gear: Array
    """(nu,) [N m] a unit of each control."""
    low: Array
    high: Array
    """(nu,) of the controls."""

    @staticmethod
    def of(model: mujoco.MjModel) -> "Swing | None":
        """None of a model that is more than that: further joints, contacts, stops, friction loss,
        actuators with a state, a bias or a limited force."""
        if model.nv != 1 or model.nq != 1 or model.na or model.neq or model.ntendon:
            return None
        without_contacts = int(mujoco.mjtDisableBit.mjDSBL_CONTACT.value)
        plain = (
            model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
            and model.opt.disableflags & without_contacts
            and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_HINGE
            and not model.jnt_limited[0]
            and not model.dof_frictionloss[0]
            and not np.any(model.actuator_forcelimited)
            and not np.any(model.actuator_gaintype)
            and not np.any(model.actuator_biastype)
        )
        if not plain:
            return None
        data = mujoco.MjData(model)
        inertia = _torque(model, data, 0.0, 0.0, 1.0) - _torque(model, data, 0.0, 0.0, 0.0)
        stiffness, reference = float(model.jnt_stiffness[0]), float(model.qpos_spring[0])
        at_zero, aside = (-_torque(model, data, q, 0.0, 0.0) for q in (0.0, 0.5 * np.pi))
        swing = Swing(
            float(model.opt.timestep),
            inertia,
            aside + stiffness * (0.5 * np.pi - reference),
            at_zero - stiffness * reference,
            stiffness,
            reference,
            float(model.dof_damping[0]),
            np.array([_gear(model, data, i) for i in range(model.nu)]),
            np.where(model.actuator_ctrllimited, model.actuator_ctrlrange[:, 0], -np.inf),
            np.where(model.actuator_ctrllimited, model.actuator_ctrlrange[:, 1], np.inf),
        )
        return swing if swing._agrees(model, data) else None

    @cached_property
    def phase(self) -> float:
        """[rad]."""
        return float(np.arctan2(self.cosine, self.sine))

    @cached_property
    def _by_inertia(self) -> tuple[float, float, float]:
        """r, k and d over M."""
        weight = float(np.hypot(self.sine, self.cosine))
        return weight / self.inertia, self.stiffness / self.inertia, self.damping / self.inertia

    def acceleration(self, turned: Array, velocity: Array, drive: Array) -> Array:
        """(r,) [rad/s^2].

        Args:
            turned: (r,) angles and the phase [rad].
            velocity: (r,) [rad/s].
            drive: (r,) torques from outside over M [rad/s^2].
        """
        weight, spring, damping = self._by_inertia
        result = weight * np.sin(turned) + drive
        if spring:
            result -= spring * (turned - (self.spring_reference + self.phase))
        if damping:
            result -= damping * velocity
        return result

    def _agrees(self, model: mujoco.MjModel, data: mujoco.MjData) -> bool:
        for q, w in PROBES:
            needed = -_torque(model, data, q, w, 0.0)
            turned = np.array([q + self.phase])
            here = float(self.acceleration(turned, np.array([w]), np.zeros(1))[0])
            size = abs(self.sine) + abs(self.cosine) + abs(needed)
            if abs(self.inertia * here - needed) > ALIKE * size:
                return False
        return True


class Swinging:
    """Hinges side by side."""

    def __init__(self, swing: Swing, position: Array, velocity: Array) -> None:
        """All of one machine.

        Args:
            swing: its equation.
            position, velocity: (r, 1) where they begin.
        """
        self.position, self.velocity = position, velocity
        self._swing = swing

    def carry(self, driven: Array, answer: Answer | None = None) -> tuple[Array, Array]:
        """Positions (r, steps, 1) and velocities (r, steps, 1) after each step.

        Args:
            driven: (r, steps, nu + 1) controls and the force applied, constant over a step.
            answer: a torque (r, 1) on the hinge over step k, by its position and velocity (r, 1)
                where the step begins.
        """
        swing, h = self._swing, self._swing.step
        control = np.clip(driven[..., :-1], swing.low, swing.high)
        driving = np.ascontiguousarray((driven[..., -1] + control @ swing.gear).T) / swing.inertia
        phase, acceleration = swing.phase, swing.acceleration
        positions, velocities = np.empty_like(driving), np.empty_like(driving)
        q, w = self.position[:, 0] + phase, self.velocity[:, 0]
        for k, pull in enumerate(driving):
            if answer is not None:
                given = answer(k, (q - phase)[:, None], w[:, None])
                pull = pull + given[:, 0] / swing.inertia
            a1 = acceleration(q, w, pull)
            w2 = w + 0.5 * h * a1
            a2 = acceleration(q + 0.5 * h * w, w2, pull)
            w3 = w + 0.5 * h * a2
            a3 = acceleration(q + 0.5 * h * w2, w3, pull)
            w4 = w + h * a3
            a4 = acceleration(q + h * w3, w4, pull)
            q = q + h / 6.0 * (w + 2.0 * (w2 + w3) + w4)
            w = w + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
            positions[k], velocities[k] = q, w
        positions -= phase
        self.position, self.velocity = (q - phase)[:, None], w[:, None]
        return positions.T[..., None], velocities.T[..., None]


def _torque(model: mujoco.MjModel, data: mujoco.MjData, q: float, w: float, a: float) -> float:
    """That the hinge needs to move so [N m]."""
    data.qpos[0], data.qvel[0], data.qacc[0] = q, w, a
    mujoco.mj_inverse(model, data)
    return float(data.qfrc_inverse[0])


def _gear(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> float:
    """Torque by a unit of a control [N m]."""
    given = np.zeros(2)
    for place, unit in enumerate((0.0, 1e-3)):
        data.ctrl[:] = 0.0
        data.ctrl[index] = unit
        data.qpos[0] = data.qvel[0] = 0.0
        mujoco.mj_forward(model, data)
        given[place] = float(data.qfrc_actuator[0])
    data.ctrl[:] = 0.0
    return float(given[1] - given[0]) / 1e-3
