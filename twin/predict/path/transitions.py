"""How small changes of a machine's state are carried along a path, from step to step.

A machine on its bearing is a gyrostat: its momentum about the CR in body axes, p = M v, obeys

    dp/dt = p x w + m r x g_body + what else turns it,

one on a hinge the same along its axis, and the momentum of a wheel dp/dt = its torque. A change of
the path, seen as y = M dv + (dp / d angle) d angle of the gimbals, obeys the same equations
linearised, in which M may change from step to step. So one path tells how all of its neighbours go,
where differences take a path for each number of the state.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.model import Machine, mass_properties
from twin.predict.parameters.base import hinge_axis
from twin.predict.path.response import Masses
from twin.predict.path.states import States

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Passage:
    """A path, and how all joints went along it."""

    path: States
    """(S, steps + 1, .)."""
    position: Array
    """(S, steps + 1, nq)."""
    velocity: Array
    """(S, steps + 1, nv)."""
    dipole: Array
    """(S, steps, 3) of the coils in each step, body axes [A m^2]."""
    field: Array
    """(3,) that they feel, room axes [T]."""
    step: float
    """[s]."""
    answering: Array | None = None
    """(S, steps, k, 2 k + w) d torque on the base of what answers to the path, by (turn, rate,
    wheel speeds)."""


def is_gyrostat(machine: Machine, model: mujoco.MjModel) -> bool:
    """Whether a machine turns on a ball or a hinge, and nothing but smooth torques acts, contacts
    apart."""
    rough = model.neq or model.ntendon or model.dof_frictionloss.any()
    if machine.platform.base.kind == "hinge":
        rough = rough or model.jnt_limited[model.dof_jntid[machine.base_dof]].any()
    return machine.platform.base.kind in ("ball", "hinge") and not rough


def transitions(machine: Machine, model: mujoco.MjModel, masses: Masses, passage: Passage) -> Array:
    """Changes (S, steps, x, x) of the state from one instant to the next by that at the first.

    Args:
        machine: as stated.
        model: with the base that went this passage.
        masses: along it.
        passage: at small steps.
    """
    path, velocity = passage.path, passage.velocity
    middle = path[:, :-1].moved(0.5 * path[:, 1:].less(path[:, :-1]))
    k, w = middle.rate.shape[-1], middle.wheel_speed.shape[-1]
    turn, base, moving = slice(0, k), slice(k, 2 * k), slice(k, 2 * k + w)
    gimbals = slice(2 * k + w, None)

    # d velocity of base and wheels by (turn, y, d angle)
    gains = np.zeros((*masses.free.shape[:2], k + w, path.width))
    gains[..., moving] = np.linalg.inv(masses.free)
    gains[..., gimbals] = -gains[..., moving] @ masses.gyro
    turning = gains[..., :k, :]

    slope = np.zeros((*middle.rate.shape[:2], path.width, path.width))
    slope[..., turn, :] = turning
    if k == 3:
        between = 0.5 * (velocity[:, :-1] + velocity[:, 1:])
        momentum = np.einsum("snki,sni->snk", masses.base, between)
        slope[..., turn, turn] -= rotation.skew(middle.rate)
        slope[..., base, :] = rotation.skew(momentum) @ turning
        slope[..., base, base] -= rotation.skew(middle.rate)
    slope[..., base, turn] += _restoring(machine, model, passage, middle.position)
    if passage.answering is not None:
        slope[..., base, turn] += passage.answering[..., turn]
        slope[..., base, :] += passage.answering[..., moving] @ gains
    dofs = [*range(model.nv)[machine.base_dof], *machine.wheel_dof[:w]]
    rates = np.concatenate([middle.rate, middle.wheel_speed], axis=-1)
    damping = model.dof_damping[dofs] + 2.0 * model.dof_dampingpoly[dofs, 0] * np.abs(rates)
    slope[..., moving, :] -= damping[..., None] * gains
    return _in_velocities(masses, _exponential(passage.step * slope), moving, gimbals)


def _restoring(machine: Machine, model: mujoco.MjModel, passage: Passage, position: Array) -> Array:
    """(S, steps, k, k) d torque on the base by its turn: of gravity, coils, the joint's spring."""
    axes, attitude = np.eye(3), position
    if machine.platform.base.kind == "hinge":
        axes = hinge_axis(machine)[:, None]
        attitude = rotation.from_rotation_vector(position * axes[:, 0])
    sliding, stages = machine.sliding, passage.position[..., machine.stage_qpos]
    moment = mass_properties(model, machine.base_body).center_of_mass_offset
    travel = np.einsum("b,bsi->si", sliding.mass, sliding.travel)
    moment = moment + 0.5 * (stages[:, :-1] + stages[:, 1:]) @ travel
    gravity = -machine.platform.gravity * rotation.vertical_body(attitude)
    torque = rotation.skew(moment) @ rotation.skew(gravity)
    if passage.dipole.any():
        field = rotation.rotate(rotation.conjugate(attitude), passage.field)
        torque += rotation.skew(passage.dipole) @ rotation.skew(field)
    stiffness = float(model.jnt_stiffness[model.dof_jntid[machine.base_dof.start]])
    return np.asarray(axes.T @ torque @ axes - stiffness * np.eye(axes.shape[1]))


def _in_velocities(masses: Masses, carried: Array, moving: slice, gimbals: slice) -> Array:
    """Transitions of (turn, y, d angle) as such of (turn, d velocity, d angle)."""
    to = np.zeros_like(carried[:, : masses.free.shape[1]])
    to[...] = np.eye(carried.shape[-1])
    to[..., moving, moving] = masses.free
    to[..., moving, gimbals] = masses.gyro
    if to.shape[1] == 1:
        return np.linalg.inv(to) @ carried @ to
    # of a step the masses are those of its middle; where one ends the next begins
    edge = 0.5 * (to[:, 1:] + to[:, :-1])
    before = np.concatenate([1.5 * to[:, :1] - 0.5 * to[:, 1:2], edge], axis=1)
    after = np.concatenate([edge, 1.5 * to[:, -1:] - 0.5 * to[:, -2:-1]], axis=1)
    return np.asarray(np.linalg.solve(after, carried @ before), dtype=np.float64)


def _exponential(slope: Array) -> Array:
    """exp(slope) to the fourth order, as far as the path itself is integrated."""
    one = np.eye(slope.shape[-1])
    series = one + slope / 4.0
    for order in (3.0, 2.0, 1.0):
        series = one + slope @ series / order
    return series
