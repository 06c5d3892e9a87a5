"""Segments of a log, and the linear response of a machine's state along a path.

A machine on its bearing is a gyrostat. Its momentum about the CR in body axes, p = M v, obeys

    dp/dt = p x w + m r x g_body + other torques,

one on a hinge the same along its axis, and the momentum of a wheel dp/dt = its torque. A change of
the path, y = M dv + (dp / d angle) d angle of the gimbals, obeys the linearised equations, in which
M may change from step to step. One path therefore gives the response to every state, where finite
differences need a path for each.

An impulse does not move a prescribed joint. The column of a gimbal is that of a turn by 1 rad: the
free joints keep their momentum, so their velocity changes by -M^-1 (dp / d angle), the torque
h g x a of a gyro.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.drives import PRESCRIBED_ARMATURE
from twin.model import Machine, mass_properties
from twin.predict.base import hinge_axis
from twin.predict.logs import Motion
from twin.predict.sensors import StepGrid
from twin.predict.states import States
from twin.recording import Recording

Array = NDArray[np.float64]
LONGEST = 10.0
"""[s]."""
ON_FLOOR = 2.0
"""Of a machine on a floor, whose error of place grows with the square of the time: in 10 s a force
that is off by a twentieth leads it further off than its cameras' noise by a hundred times [s]."""
GROWTH = 3.0
"""An error of the initial state may grow by exp(3) = 20 within a stretch: then a fit is well posed
even where the machine stands on its head. Twice as long it would be 400, and Gauss-Newton, started
from a wrong base, loses its way."""
EDGE = 1e-3
"""Share of a step by which clocks that go together may seem to differ."""
COARSE = 0.025
"""The longest step of a prediction [s]."""
TURN = 1e-4
"""Of the central difference [rad]."""


@dataclass(frozen=True)
class Segment:
    """From `start` to `stop` [s]."""

    start: float
    stop: float

    def edges(self, step: float, steps: int) -> Array:
        """Beginnings and end of so many physics steps, (steps + 1,) [s]."""
        return np.asarray(self.start + step * np.arange(steps + 1), dtype=np.float64)


def growth_rate(machine: Machine) -> float:
    """Rate [1/s] at which the machine would fall from upright: sqrt(g abs(m r) / J)."""
    platform = machine.platform
    offset = platform.center_of_mass_offset
    if platform.base.kind == "planar":
        return 0.0
    if platform.base.kind == "ball":
        smallest = float(np.linalg.eigvalsh(platform.inertia)[0])
    else:
        axis = hinge_axis(machine)
        offset = offset - (axis @ offset) * axis
        smallest = float(axis @ platform.inertia @ axis)
    return float(np.sqrt(platform.gravity * np.linalg.norm(offset) / smallest))


def command_step(machine: Machine, recording: Recording) -> float:
    """The longest step up to COARSE of which a whole number fits between two commands [s].

    The platform's, where drives are told where to go: their moves are ramps of a few such steps.
    """
    told = "command_stage_position"
    moves = told in recording and bool(np.ptp(recording[told].value, axis=0).any())
    if machine.platform.gimbals or (machine.platform.stages and moves):
        return machine.platform.step
    periods = [
        float(np.median(np.diff(recording[name].time)))
        for name in machine.platform.commands
        if name in recording and len(recording[name]) > 1
    ]
    shortest = min(periods, default=COARSE)
    step = round(float(shortest / np.ceil(shortest / COARSE - 1e-6)), 9)
    return max(step, machine.platform.step)


def grid_of(machine: Machine, recording: Recording, motion: Motion, step: float) -> StepGrid:
    """Equal segments of at most 10 s, on a floor 2 s, and at most exp(3) of growth, their steps in
    time with the commands.

    A command that changed within a step would act a little before it was given. It answers to the
    noise of the sample that was read as it was given, and so would seem to foretell it.
    """
    begin, end = float(motion.time[0]), float(motion.time[-1])
    given = [recording[name].time for name in machine.platform.commands if name in recording]
    if given:
        oftenest = max(given, key=len)
        after = float(oftenest[np.searchsorted(oftenest, begin) % len(oftenest)]) - begin
        after %= step
        begin += 0.0 if step - after < EDGE * step else after
    longest = ON_FLOOR if machine.platform.base.kind == "planar" else LONGEST
    length = min(longest, GROWTH / max(growth_rate(machine), 1e-9), end - begin)
    steps = max(int(length / step + 1e-9), 1)
    segments = max(int(np.ceil((end - begin) / (steps * step) - 1e-6)), 1)
    return StepGrid(begin, step, steps, segments)


@dataclass(frozen=True)
class MassMatrices:
    """Of the base and the wheels whose speeds are states, b numbers, at (S, K) states; what else
    moves freely goes along with them."""

    free: Array
    """(S, K, b, b)."""
    gyro: Array
    """(S, K, b, g) d momentum / d angle of each gimbal."""
    base: Array
    """(S, K, k, nv) momentum of the base by each joint's velocity."""


class Response:
    """Of a machine at given states of all its joints, (S, K, .)."""

    def __init__(self, machine: Machine, position: Array, velocity: Array, wheels: bool) -> None:
        """Measure M there.

        Args:
            machine: as stated.
            position: (S, K, nq).
            velocity: (S, K, nv).
            wheels: whether the wheels' speeds are states.
        """
        model = machine.model
        self._machine = machine
        self._wheels = machine.wheel_dof if wheels else machine.wheel_dof[:0]
        self._free = np.flatnonzero(model.dof_armature < 1e-3 * PRESCRIBED_ARMATURE)
        f, g = len(self._free), len(machine.gimbal_dof)
        bases = np.isin(self._free, np.arange(machine.base_dof.start, machine.base_dof.stop))
        self._bases = np.flatnonzero(bases)
        self._moved = np.concatenate([self._bases, np.searchsorted(self._free, self._wheels)])
        self._mass = np.empty((*position.shape[:2], f, f))
        self._base = np.empty((*position.shape[:2], len(self._bases), model.nv))
        self._across = np.empty((*position.shape[:2], f, g))
        """How a gimbal's own turning drags the rest."""
        self._gyro = np.empty_like(self._across)
        """d p / d angle."""
        self._turned = np.empty((*position.shape[:2], f, len(self._bases), g))
        """d M / d angle, the base's columns."""
        self._rate = velocity[..., machine.base_dof]
        planar = machine.platform.base.kind == "planar"
        self._heading = position[..., machine.base_qpos.start + 2] if planar else None
        data = mujoco.MjData(model)
        for at in np.ndindex(position.shape[:2]):
            whole = mass_matrix(model, data, position[at])
            self._mass[at] = whole[np.ix_(self._free, self._free)]
            self._base[at] = whole[machine.base_dof]
            self._across[at] = whole[np.ix_(self._free, machine.gimbal_dof)]
            for column, place in enumerate(machine.gimbal_qpos):
                turned = position[at].copy()
                turned[place] += TURN
                after = mass_matrix(model, data, turned)[self._free]
                turned[place] -= 2.0 * TURN
                change = (after - mass_matrix(model, data, turned)[self._free]) / (2.0 * TURN)
                self._gyro[at][:, column] = change @ velocity[at]
                self._turned[at][..., column] = change[:, machine.base_dof]
        self._home = self._at_home(model)

    def masses(self, model: mujoco.MjModel, rate: Array) -> MassMatrices:
        """Where the response was measured, but the base that of `model`, at its rates (S, K, k)."""
        change = self._at_home(model) - self._home
        base = self._base.copy()
        base[..., self._free] += change[self._bases]
        whole, gyro = self._mass + change, self._gyro
        if gyro.shape[-1]:
            gyro = gyro + np.einsum("snfkg,snk->snfg", self._turned, rate - self._rate)
        if len(self._moved) < len(self._free):
            answer = np.linalg.inv(whole)[:, :, self._moved]
            free = np.asarray(np.linalg.inv(answer[..., self._moved]), dtype=np.float64)
            return MassMatrices(free, free @ answer @ gyro, base)
        both = np.ix_(self._moved, self._moved)
        return MassMatrices(whole[..., both[0], both[1]], gyro[:, :, self._moved], base)

    def of(self, model: mujoco.MjModel) -> Array:
        """(S, K, x, nv) change of the state by a unit impulse on each degree of freedom, a unit
        turn of each gimbal, the base being that of `model`."""
        machine = self._machine
        inverse = np.linalg.inv(self._mass + self._turned_by(self._at_home(model) - self._home))
        gimbals = machine.gimbal_dof
        k, w, g = len(self._bases), len(self._wheels), len(gimbals)
        answer = np.zeros((*inverse.shape[:2], 2 * k + w + g, model.nv))
        answer[:, :, k : 2 * k + w, self._free] = inverse[:, :, self._moved]
        if g:
            answer[:, :, :k, gimbals] = -(inverse @ self._across)[:, :, self._bases]
            answer[:, :, k : 2 * k + w, gimbals] = -(inverse @ self._gyro)[:, :, self._moved]
            answer[:, :, 2 * k + w :, gimbals] = np.eye(g)
        return answer

    def _turned_by(self, change: Array) -> Array:
        """A change (f, f) of M at the heading 0, at the headings that there are."""
        if self._heading is None:
            return change
        turn = np.zeros((*self._heading.shape, len(change), len(change)))
        turn[...] = np.eye(len(change))
        x, y = self._bases[:2]
        turn[..., x, x] = turn[..., y, y] = np.cos(self._heading)
        turn[..., y, x] = np.sin(self._heading)
        turn[..., x, y] = -turn[..., y, x]
        return turn @ change @ turn.swapaxes(-1, -2)

    def _at_home(self, model: mujoco.MjModel) -> Array:
        whole = mass_matrix(model, mujoco.MjData(model), model.qpos0)
        return whole[np.ix_(self._free, self._free)]


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData, position: Array) -> Array:
    """(nv, nv) of a model in a position (nq,), armatures in it [kg m^2, kg m or kg]."""
    data.qpos[:] = position
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    whole = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    return whole


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


def transitions(
    machine: Machine, model: mujoco.MjModel, masses: MassMatrices, passage: Passage
) -> Array:
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


def is_planar(machine: Machine, model: mujoco.MjModel) -> bool:
    """Whether a machine glides on a floor, and carries nothing that moves."""
    rough = model.neq or model.ntendon or model.dof_frictionloss.any()
    return machine.platform.base.kind == "planar" and model.nv == 3 and not rough


def floor_transitions(
    machine: Machine,
    model: mujoco.MjModel,
    path: States,
    thrust: Array,
    step: float,
    answering: Array | None,
) -> tuple[Array, float]:
    """Changes of x, y, heading and their rates from one instant to the next, as `transitions`.

    With T the turn by the heading h, K its generator and M = T M_0 T^T:

        M dv/dt = T F + forces in the room + (h')^2 S - D v + gravity on a slope

    whose derivative by h has K T F - (K M + M K^T) dv/dt in it.

    Args:
        machine: on a floor.
        model: with the base that went this path.
        path: (S, steps + 1, .).
        thrust: (S, steps, 3) force and torque that turn with the body, as at the heading 0.
        step: [s].
        answering: as in `Passage`.

    Returns:
        (S, steps, 6, 6), and the largest rate at which what answers to the path brakes it [1/s].
    """
    middle = path[:, :-1].moved(0.5 * path[:, 1:].less(path[:, :-1]))
    acceleration = (path.rate[:, 1:] - path.rate[:, :-1]) / step
    heading, spin = middle.position[..., 2], middle.rate[..., 2]
    home = mass_matrix(model, mujoco.MjData(model), model.qpos0)
    generator = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    turn = np.zeros((*heading.shape, 3, 3))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(heading)
    turn[..., 1, 0] = np.sin(heading)
    turn[..., 0, 1] = -turn[..., 1, 0]
    turn[..., 2, 2] = 1.0
    masses = turn @ home @ turn.swapaxes(-1, -2)
    # S, m r in the room's axes, stands beside the heading: M = ((m, 0, -S_y), (0, m, S_x), ...)
    moment = np.stack([masses[..., 1, 2], -masses[..., 0, 2], np.zeros_like(heading)], axis=-1)
    gravity = model.opt.gravity
    by_heading = turn @ thrust[..., None] + np.square(spin)[..., None, None] * moment[..., None]
    by_heading = (generator @ by_heading)[..., 0]
    by_heading[..., 2] -= moment[..., 1] * gravity[1] + moment[..., 0] * gravity[0]
    bent = generator @ masses + masses @ generator.T
    by_heading = by_heading - (bent @ acceleration[..., None])[..., 0]
    by_rate = np.zeros_like(masses) - np.diag(model.dof_damping[machine.base_dof])
    by_rate[..., 2] += 2.0 * spin[..., None] * moment
    inverse = np.linalg.inv(masses)
    slope = np.zeros((*heading.shape, 6, 6))
    slope[..., :3, 3:] = np.eye(3)
    slope[..., 3:, 2] = (inverse @ by_heading[..., None])[..., 0]
    slope[..., 3:, 3:] = inverse @ by_rate
    braking = 0.0
    if answering is not None:
        answers = inverse @ answering
        braking = float(np.abs(answers[..., 3:]).max())
        slope[..., 3:, :] += answers
    return _exponential(step * slope), braking


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


def _in_velocities(masses: MassMatrices, carried: Array, moving: slice, gimbals: slice) -> Array:
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
    item = np.eye(slope.shape[-1])
    series = item + slope / 4.0
    for order in (3.0, 2.0, 1.0):
        series = item + slope @ series / order
    return series
