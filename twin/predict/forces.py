"""Perturbations of a prediction, and the generalised forces of effects along a log's motion.

A perturbation is a number by which a machine departs from its model: a generalised force along the
measured motion, an error of what a sensor shows, or of when. `added.py` forms columns of the
whitened innovations from it.

The force of an effect is the difference of two inverse dynamics, of the machine with it and without
it, plus pushes that no model holds. A torque law depends on the predicted path instead. Parts that
the effect adds, a panel or a liquid, are simulated along the motion first, from rest at the log's
first instant. A resonance needs a motion that contains what excites it (`retraced`). Along a motion
that a fit predicts, the body responds to the part, which then rings faster by 1 / sqrt(1 - I / J);
what the part has done to the body already is subtracted from that motion first. A liquid rings as
on a body that does not respond: true to first order.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from twin import rotation
from twin.effects import BodyEffect, CoupleEffect, Effect, able, effects_of, with_effects
from twin.effects.on_body import CARRIER_MASS, TorqueLaw
from twin.model import (
    Machine,
    MassProperties,
    compile_model,
    mass_properties,
    set_mass_properties,
)
from twin.plant.forces import thruster_pushes
from twin.platform import Platform
from twin.predict.base import hinge_axis
from twin.predict.body import Body
from twin.predict.inputs import Inputs
from twin.predict.response import mass_matrix
from twin.predict.sensors import Output
from twin.predict.states import States

Array = NDArray[np.float64]
Index = NDArray[np.intp]
_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED.value)
SHARE_OF_GAS = 1e-2
"""Of full tanks, by which the machine is made lighter to see what gas does."""
_CARRIED = 1e13
"""Armature of a joint that moves as measured, while hidden parts swing on it [kg m^2 or kg]."""


@dataclass(frozen=True)
class Perturbation:
    """A strength and what it does, in proportion; a strength of 0 does nothing."""

    name: str
    unit: str
    """SI, of the strength."""
    spread: float = np.inf
    """1 sigma of what is known of the strength beforehand, about 0."""
    force: Callable[[Body], Array] | None = None
    """(S, steps, nv) generalised force at strength 1, along a log's measured motion."""
    rest: Callable[[Body], Array] | None = None
    """(S, steps, nv) what it pushes besides, whatever its strength: of what is not proportional,
    `force` is the slope where it was formed. For a fit; a column is of `force` alone."""
    laws: tuple[tuple[float, TorqueLaw], ...] = ()
    """Torques on the base at strength 1, each so many times, that answer to the path that is
    predicted."""
    size: float = 0.0
    """Strength at which they are asked what they do, where there is none yet; 0: a small one. Near
    rest, twice the dry friction does far less than twice as much."""
    stream: str = ""
    """Whose sensor has the fault, if one has."""
    late: Callable[[Output], Array] | None = None
    """(m,) by how much each of its samples was true before its stamp [s], at strength 1."""
    shown: Callable[[Output, Array], Array] | None = None
    """What it shows beyond the truth (1, m, k) or (1, m, 4), at strength 1: (1, m, k)."""
    misread: Callable[[Output, States, float], Array] | None = None
    """What any stream shows beyond the truth along a path (1, S, ...) of a step [s], at strength 1:
    (1, m, k)."""

    @property
    def of_sensors(self) -> bool:
        """Whether a sensor has the fault."""
        return bool(self.stream) or self.misread is not None


def predicted_machine(platform: Platform) -> Machine:
    """The machine that a log is predicted with.

    A part that hangs on it moves by itself, and a spring may be at rest where the log began:
    neither is a state of the prediction, which begins anew with each segment. Such an effect is
    left out of the model, and pushes it as `stated.py` says.

    Raises:
        PlatformError, EffectError: as `compile_model`.
    """
    machine = compile_model(modelled(platform))
    return replace(machine, platform=platform, effects=effects_of(platform))


def modelled(platform: Platform) -> Platform:
    """The platform without such effects."""
    pairs = zip(platform.effects, effects_of(platform), strict=True)
    stays = tuple(stated for stated, effect in pairs if not depends_on_start(effect))
    return replace(platform, effects=stays)


def depends_on_start(effect: Effect) -> bool:
    """Whether what it does depends on how a run began."""
    return isinstance(effect, BodyEffect) and (effect.hangs_on or effect.follows_start)


@dataclass(frozen=True)
class Along:
    """A machine in all joints, in the middle of each physics step."""

    position: Array
    """(m, nq)."""
    velocity: Array
    """(m, nv)."""
    acceleration: Array
    """(m, nv)."""


def force_of(effect: BodyEffect, body: Body, turn: Array | None = None) -> Array:
    """(S, steps, nv) force of an effect but its torque law, mean over each step, along the log's
    motion.

    Args:
        effect: on the machine.
        body: the log's predictor.
        turn: (k,) from where the log began to where a spring that follows it is at rest [rad].

    Raises:
        EffectError: the machine cannot have it, at whatever step.
    """
    if isinstance(effect, CoupleEffect):
        return on_grid(_couple(effect, body), body)
    plain = body.machine
    machine = _with(effect, body, turn)
    shared = _Shared.of(plain, machine)
    here, plainly = plain_forces(body)
    along = shared.along(here)
    if shared.hidden_dof.size:
        _carry(effect, shared, body, along)
    needed = np.zeros_like(plainly)
    if machine.model is not plain.model:
        needed += plainly - inverse(machine, along)[:, shared.dof]
    needed += _pushes(effect, machine, along, middles(body))[:, shared.dof]
    if thrust(body).any():
        position = here.position[:, plain.base_qpos]
        needed[:, plain.base_dof] += thruster_pushes(machine, thrust(body), position)
        needed[:, plain.base_dof] -= thruster_pushes(plain, thrust(body), position)
    return on_grid(needed, body)


def pushed_along(effect: BodyEffect, body: Body) -> Array:
    """(S, steps, nv) likewise, of an effect that the machine has: what pushes it beside its
    model."""
    if isinstance(effect, CoupleEffect):
        return on_grid(_couple(effect, body), body)
    here, _ = plain_forces(body)
    return on_grid(_pushes(effect, body.machine, here, middles(body)), body)


@lru_cache(maxsize=2)
def plain_forces(body: Body) -> tuple[Along, Array]:
    """A log's motion, and the forces that the machine without any effect needs for it."""
    here = as_measured(body, body.inputs)
    return here, inverse(body.machine, here)


def gas_force(body: Body, lost: Array) -> Array:
    """(S, steps, nv) what gas that has left its tanks no longer does, along the log's motion.

    Args:
        body: the log's predictor, of a machine whose tanks have places.
        lost: (S steps,) gas that has left by the middle of each step [kg].
    """
    return on_grid(lost[:, None] * _force_of_gas(body), body)


@lru_cache(maxsize=2)
def _force_of_gas(body: Body) -> Array:
    """(S steps, nv) per kilogram: inverse dynamics are linear in mass, m r and J."""
    machine, (here, plainly) = body.machine, plain_forces(body)
    gas = machine.platform.gas
    assert gas is not None
    whole = mass_properties(machine.model, machine.base_body)
    part = SHARE_OF_GAS * gas.mass
    lighter = MassProperties(
        whole.mass - part,
        whole.inertia - part * gas.inertia,
        whole.center_of_mass_offset - part * gas.moment,
    )
    model = copy.copy(machine.model)
    set_mass_properties(model, machine.base_body, lighter, rigid=False)
    return (plainly - inverse(replace(machine, model=model), here)) / part


def middles(body: Body) -> Array:
    """(S steps,) middle of each physics step [s]."""
    grid = body.grid
    return (grid.starts[:, None] + grid.step * (np.arange(grid.steps) + 0.5)).ravel()


@lru_cache(maxsize=2)
def thrust(body: Body) -> Array:
    """(S steps, thrusters) commanded in each physics step [N]."""
    return body.inputs.thrust(body.grid.edges)


def on_grid(force: Array, body: Body) -> Array:
    """(S, steps, nv) from (S steps, nv); the joints that are prescribed feel none."""
    machine = body.machine
    felt = np.zeros_like(force)
    for free in (machine.base_dof, machine.wheel_dof):
        felt[:, free] = force[:, free]
    return felt.reshape(body.grid.segments, body.grid.steps, -1)


def as_measured(body: Body, inputs: Inputs) -> Along:
    """A log's machine, its joints as its inputs have them.

    A wheel that a command drives is accelerated by that: its speed, differenced, is mostly noise.
    """
    machine, times = body.machine, middles(body)
    position, velocity, acceleration = inputs.joint_states(times)
    if body.predicted is not None:
        return _along(body, body.predicted, Along(position, velocity, acceleration))
    moving = body.motion.at(times)
    position[:, machine.base_qpos] = moving.position
    velocity[:, machine.base_dof] = moving.rate
    acceleration[:, machine.base_dof] = moving.acceleration
    if inputs.wheels_predicted and not inputs.wheels_undriven:
        wheels = machine.platform.wheels
        rotor = np.array([wheel.inertia for wheel in wheels])
        axes = np.stack([wheel.axis for wheel in wheels])
        torque = body.commanded().reshape(len(times), -1)[:, machine.wheel_dof]
        torque = (
            torque - machine.model.dof_damping[machine.wheel_dof] * velocity[:, machine.wheel_dof]
        )
        hinge = machine.platform.base.kind == "hinge"
        turned = axes @ hinge_axis(machine)[:, None] if hinge else axes
        acceleration[:, machine.wheel_dof] = torque / rotor - moving.acceleration @ turned.T
    return Along(position, velocity, acceleration)


def _along(body: Body, path: States, joints: Along) -> Along:
    """Base, and wheels where they are states, as predicted (`_effective`), and the other joints."""
    machine, step = body.machine, body.grid.step
    wheels = machine.wheel_dof if body.inputs.wheels_predicted else slice(0, 0)
    begin, end = path.position[0, :, :-1], path.position[0, :, 1:]
    bend = -step / 6.0 * np.diff(path.rate[0], axis=1)
    if begin.shape[-1] != 4:
        held = 0.5 * (begin + end) + bend
    else:
        middle = rotation.normalized(begin + end)
        held = rotation.multiply(middle, rotation.from_rotation_vector(bend))
    count = len(joints.position)
    joints.position[:, machine.base_qpos] = held.reshape(count, held.shape[-1])
    for dof, rates in ((machine.base_dof, path.rate[0]), (wheels, path.wheel_speed[0])):
        size = rates.shape[-1]
        joints.velocity[:, dof] = _effective(rates).reshape(count, size)
        joints.acceleration[:, dof] = (np.diff(rates, axis=1) / step).reshape(count, size)
    return joints


def _effective(rates: Array) -> Array:
    """Rates (S, n, k) at which a torque is held over each step, from (S, n + 1, k) at its ends.

    A torque f(t), held over each step h at f - h^2/24 f'', moves the body along the path of f to
    the fourth order in h: its mean over the step, f + h^2/24 f'', less the h^2/12 f'' by which the
    change of f within a step shifts the position. The average of the step's ends is
    f + h^2/8 f''; a friction of a body that swings by w is wrong by (w h)^2/6 with it.
    """
    between = 0.5 * (rates[:, 1:] + rates[:, :-1])
    if rates.shape[1] < 3:
        return between
    bend = np.pad(np.diff(rates, 2, axis=1), ((0, 0), (1, 1), (0, 0)), mode="edge")
    return between - (bend[:, 1:] + bend[:, :-1]) / 12.0


def inverse(machine: Machine, along: Along) -> Array:
    """(m, nv) the forces that a machine needs to move so, without contacts."""
    model = copy.copy(machine.model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(model)
    force = np.empty_like(along.velocity)
    # fields of MjData are looked up once: each time costs as much as MuJoCo takes for a row
    qpos, qvel, qacc, needed = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    for row in range(len(force)):
        qpos[:] = along.position[row]
        qvel[:] = along.velocity[row]
        qacc[:] = along.acceleration[row]
        mujoco.mj_inverse(model, data)
        force[row] = needed
    return force


@dataclass(frozen=True)
class _Shared:
    """Where the joints of a plain machine stand in one that has more of them."""

    machine: Machine
    qpos: Index
    """(nq of the plain machine,)."""
    dof: Index
    """(nv of the plain machine,)."""
    hidden_qpos: Index
    hidden_dof: Index
    """Of the joints that the plain machine lacks."""

    @staticmethod
    def of(plain: Machine, machine: Machine) -> "_Shared":
        """By the joints' names."""
        model = machine.model
        joints = [model.joint(plain.model.joint(i).name) for i in range(plain.model.njnt)]
        dof = np.concatenate([np.flatnonzero(model.dof_jntid == joint.id) for joint in joints])
        qpos = np.concatenate([joint.qposadr[0] + np.arange(joint.qpos0.size) for joint in joints])
        hidden_qpos = np.setdiff1d(np.arange(model.nq), qpos)
        return _Shared(machine, qpos, dof, hidden_qpos, np.setdiff1d(np.arange(model.nv), dof))

    def along(self, plain: Along) -> Along:
        """The same motion; the hidden joints rest."""
        model = self.machine.model
        position = np.tile(model.qpos0, (len(plain.position), 1))
        velocity, acceleration = np.zeros((2, len(position), model.nv))
        position[:, self.qpos] = plain.position
        velocity[:, self.dof] = plain.velocity
        acceleration[:, self.dof] = plain.acceleration
        return Along(position, velocity, acceleration)


def _with(effect: BodyEffect, body: Body, turn: Array | None) -> Machine:
    """The machine with an effect, on a step that can follow it, springs at rest at the start."""
    platform = with_effects(able(modelled(body.machine.platform), effect), (effect,))
    if not effect.changes_machine:
        return replace(body.machine, platform=platform)
    machine = compile_model(platform)
    if _alike(machine.model, body.machine.model):
        return replace(machine, model=body.machine.model)
    if effect.follows_start:
        first = (
            body.motion.position[0] if body.predicted is None else body.predicted.position[0, 0, 0]
        )
        if turn is not None:
            hinge = platform.base.kind == "hinge"
            turned = rotation.from_rotation_vector(turn)
            first = first + turn if hinge else rotation.multiply(first, turned)
        machine.model.qpos_spring[machine.base_qpos] = first
    return machine


def _alike(first: mujoco.MjModel, other: mujoco.MjModel) -> bool:
    """Whether two models differ in their steps at most."""
    stored: list[bytes] = []
    for model in (first, other):
        model = copy.copy(model)
        model.opt.timestep = 1.0
        buffer = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
        mujoco.mj_saveModel(model, None, buffer)
        stored.append(buffer.tobytes())
    return stored[0] == stored[1]


def _couple(effect: CoupleEffect, body: Body) -> Array:
    """(m, nv) torque of a couple on the base."""
    machine, (here, plainly) = body.machine, plain_forces(body)
    pull, times = effect.pull(machine.platform), middles(body)
    force = pull(times) if callable(pull) else np.broadcast_to(pull, (len(times), 3))
    axis = hinge_axis(machine) if machine.platform.base.kind == "hinge" else None
    turned = here.position[:, machine.base_qpos]
    attitude = turned if axis is None else rotation.from_rotation_vector(turned * axis)
    torque = rotation.cross(effect.apart(), rotation.rotate(rotation.conjugate(attitude), force))
    needed = np.zeros_like(plainly)
    needed[:, machine.base_dof] = torque if axis is None else torque @ axis[:, None]
    return needed


def _pushes(effect: BodyEffect, machine: Machine, along: Along, times: Array) -> Array:
    """(m, nv) generalised force of what pushes with the room's axes."""
    model, data = machine.model, mujoco.MjData(machine.model)
    force = np.zeros_like(along.velocity)
    pushed: list[tuple[int, Array, Array]] = []
    for push in effect.pushes(machine.platform):
        body = int(model.body(push.body).id)
        wrench = push.wrench(times) if callable(push.wrench) else push.wrench
        pushed.append((body, data.xipos[body], np.broadcast_to(wrench, (len(times), 6))))
    qpos = data.qpos
    for row in range(len(times) if pushed else 0):
        qpos[:] = along.position[row]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for body, place, wrench in pushed:
            mujoco.mj_applyFT(
                model, data, wrench[row, :3], wrench[row, 3:], place, body, force[row]
            )
    return force


def _carry(effect: BodyEffect, shared: _Shared, body: Body, along: Along) -> None:
    """Let the hidden joints swing on the measured motion, segment by segment; write theirs.

    Their acceleration is the change of their rate over a step, so that the impulse on the rest is
    exact.
    """
    machine, grid = shared.machine, body.grid
    finer = round(grid.step / machine.platform.step)
    step = grid.step / finer
    model = copy.copy(machine.model)
    model.opt.timestep = step
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    given = np.zeros((grid.segments, 1, 1))
    if body.pushes is not None and _weightless(shared):
        held, between = _masses(shared)
        # the base moves by what keeps the whole's momentum, and is gone from the equations
        model.dof_armature[shared.hidden_dof] -= np.einsum(
            "bh,bh->h", between, np.linalg.solve(held, between)
        )
        given = _given(effect, body, held)
    model.dof_armature[shared.dof] = _CARRIED
    batch = Batch(model, 1)
    batch.bind("qpos")[:] = model.qpos0
    edges = step * np.arange(grid.steps * finer + 1)
    for segment, start in enumerate(grid.starts.tolist()):
        position, rate = _moving(body, segment, start + edges, given[segment])
        batch.bind("qpos")[:, machine.base_qpos] = position
        batch.bind("qvel")[:, machine.base_dof] = rate[0]
        before = np.concatenate([batch.bind("qpos"), batch.bind("qvel")], axis=1)
        force = np.zeros((1, len(edges) - 1, model.nv))
        force[0][:, machine.base_dof] = _CARRIED * np.diff(rate, axis=0) / step
        run = batch.rollout(len(edges) - 1, force, control_spec=_FORCE, record=("qpos", "qvel"))
        after = np.concatenate([run["qpos"], run["qvel"]], axis=2)[0]
        ends = np.concatenate([before, after])[::finer]
        rows = slice(segment * grid.steps, (segment + 1) * grid.steps)
        places, rates = shared.hidden_qpos, model.nq + shared.hidden_dof
        along.position[rows, places] = 0.5 * (ends[1:, places] + ends[:-1, places])
        along.velocity[rows, shared.hidden_dof] = 0.5 * (ends[1:, rates] + ends[:-1, rates])
        along.acceleration[rows, shared.hidden_dof] = np.diff(ends[:, rates], axis=0) / grid.step


def _weightless(shared: _Shared) -> bool:
    """Whether hidden parts push the base by turning against it alone: what has weight pulls at it
    from outside too, and so slowly that the base does not give way as a free one would."""
    model = shared.machine.model
    parts = model.jnt_bodyid[model.dof_jntid[shared.hidden_dof]]
    return bool(np.all(model.body_mass[parts] <= CARRIER_MASS))


def _masses(shared: _Shared) -> tuple[Array, Array]:
    """Inertia of the base (b, b), and between it and the hidden joints (b, h), as they rest
    [kg m^2]."""
    model = shared.machine.model
    whole = mass_matrix(model, mujoco.MjData(model), model.qpos0)
    base = np.arange(model.nv)[shared.machine.base_dof]
    return whole[np.ix_(base, base)], whole[np.ix_(base, shared.hidden_dof)]


def _given(effect: BodyEffect, body: Body, held: Array) -> Array:
    """(S, steps + 1, b) rate that an effect has already given the base of a predicted motion
    [rad/s]."""
    grid = body.grid
    none = np.zeros((grid.segments, grid.steps, body.machine.model.nv))
    pushes = (body.pushes or {}).items()
    own = sum((push for name, push in pushes if name.startswith(f"{effect.label} ")), start=none)
    push = own[..., body.machine.base_dof].reshape(-1, len(held))
    after = grid.step * np.cumsum(np.linalg.solve(held, push.T).T, axis=0)
    edges = np.zeros((1 + len(after), len(held)))
    edges[1:] = after
    return np.stack([edges[i * grid.steps :][: grid.steps + 1] for i in range(grid.segments)])


def _moving(body: Body, segment: int, times: Array, given: Array) -> tuple[Array, Array]:
    """Position (nq of the base,) at the first of some times in a segment; rates (m, k) at all."""
    if body.predicted is None:
        moving = body.motion.at(times)
        return moving.position[0], moving.rate
    rates = body.predicted.rate[0, segment] - given
    known = body.grid.starts[segment] + body.grid.step * np.arange(len(rates))
    rate = np.stack([np.interp(times, known, column) for column in rates.T], axis=-1)
    return body.predicted.position[0, segment, 0], rate
