"""Rollouts of a log's machine under its inputs: segments side by side, from given states."""

from copy import copy
from dataclasses import replace
from typing import Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from twin.effects import HingeSpring, State
from twin.errors import TwinError
from twin.model import Machine
from twin.plant.forces import thruster_pushes
from twin.predict.inputs import Inputs
from twin.predict.logs import Motion
from twin.predict.response import (
    Passage,
    Response,
    Segment,
    floor_transitions,
    is_gyrostat,
    is_planar,
    transitions,
)
from twin.predict.sensors import StepGrid
from twin.predict.states import STEP, PathForces, States, carried_states, reached, torque_of
from twin.predict.swing import Answer, Swing, Swinging
from twin.stop import check

Array = NDArray[np.float64]
_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL.value)
_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED.value)
STOP_GUARD = np.radians(2.0)
"""A log that stays so far from the tilt stop is predicted without contacts, at half the cost."""
TOUCH = np.radians(0.5)
"""And a path of any other that stays so far from it carries its neighbours by its own equations."""
STIFF = 0.1
"""Part of its rate that what answers to a path may take from it in a step, for the neighbours to
follow from the path's own equations."""


class BeyondBounds(TwinError):
    """A motion that grows without end."""


class Rollouts:
    """Of one log on a given grid. Models that are given are changed: their step is the grid's."""

    def __init__(self, machine: Machine, inputs: Inputs, motion: Motion, grid: StepGrid) -> None:
        self.machine, self.inputs, self.grid = machine, inputs, grid
        self._contacts = _leans(machine, motion.position, STOP_GUARD)
        drives = [
            inputs.drive(Segment(start, start + grid.length)) for start in grid.starts.tolist()
        ]
        self.force = np.stack([drive.force for drive in drives])
        """(S, steps, nv) that the log drove its joints with [N m, N]."""
        self._control = np.stack([drive.control for drive in drives])
        self._position = np.stack([drive.joint_position for drive in drives])
        self._velocity = np.stack([drive.joint_velocity for drive in drives])
        there = motion.at(grid.starts)
        wheels = machine.wheel_dof if inputs.wheels_predicted else slice(0, 0)
        self.start = States(
            there.position,
            there.rate,
            self._velocity[:, wheels],
            self._position[:, machine.gimbal_qpos],
        )
        """(S, .) as smoothed."""
        axes = np.array([coil.axis for coil in machine.platform.magnetorquers]).reshape(-1, 3)
        self._dipole = self._control[..., machine.magnetorquer_actuator] @ axes
        self._response = Response(machine, *self._along(motion), inputs.wheels_predicted)

    def paths(self, model: mujoco.MjModel, start: States, push: PathForces | None = None) -> States:
        """States along each prediction, (v, S, steps + 1, .), from starts (v, S, .).

        The model is changed: its step is the grid's.

        Args:
            model: the machine's, with the base parameters to try.
            start: of each segment.
            push: added to the drive.

        Raises:
            TwinError: the motion is unbounded.
            Stopped: a stop was requested.
        """
        check()
        return self._paths(model, start, push)[0]

    def around(
        self, model: mujoco.MjModel, start: States, push: PathForces | None = None
    ) -> tuple[States, Array]:
        """The path from starts (S, .), its neighbours, and how one step carries them on.

        Args:
            model: as for `paths`.
            start: of each segment.
            push: added to the drive.

        Returns:
            States (1 + x, S, steps + 1, .), each but the first with one number of its start moved
            by `STEP`, and changes (S, steps, x, x) of each by one of the state before it.

        Raises:
            TwinError: the motion is unbounded.
            Stopped: a stop was requested.
        """
        check()
        if is_gyrostat(self.machine, model):
            path, position, velocity = self._paths(model, start.batched(), push)
            if not self._contacts or not _leans(self.machine, path.position, TOUCH):
                beside = self._beside(model, path, position, velocity, push)
                if beside is not None:
                    return beside
        x = start.width
        if is_planar(self.machine, model) and not self._contacts:
            path, _, _ = self._paths(model, start.batched(), push)
            beside = self._beside_on_floor(model, path, push)
            if beside is not None:
                return beside
        shifts = np.concatenate([np.zeros((1, x)), STEP * np.eye(x)])[:, None, :]
        paths = self.paths(model, start.batched().moved(shifts), push)
        return paths, carried_states(np.moveaxis(paths[1:].less(paths[:1]), 0, -1) / STEP)

    def _beside(
        self,
        model: mujoco.MjModel,
        path: States,
        position: Array,
        velocity: Array,
        push: PathForces | None,
    ) -> tuple[States, Array] | None:
        """As `around`, of a path that touches nothing; None where what answers to it turns over
        within a step, as dry friction does near rest."""
        masses = self._response.masses(model, 0.5 * (path.rate[0, :, :-1] + path.rate[0, :, 1:]))
        field, answering = self.inputs.field_world, None
        if push is not None and push.laws:
            answering = push.slopes(path[0], self.grid.begins)
            k = path.rate.shape[-1]
            braking = answering[..., k : 2 * k] @ np.linalg.inv(masses.free)[..., :k, :k]
            if self.grid.step * np.abs(braking).max() > STIFF:
                return None
        passage = Passage(
            path[0], position, velocity, self._dipole, field, self.grid.step, answering
        )
        carried = transitions(self.machine, model, masses, passage)
        beside = path.moved(STEP * np.moveaxis(reached(carried), -1, 0))
        return States.joined([path, beside]), carried

    def _beside_on_floor(
        self, model: mujoco.MjModel, path: States, push: PathForces | None
    ) -> tuple[States, Array] | None:
        """As `_beside`, of x, y and heading."""
        machine = self.machine
        thrust = self._control[..., machine.thruster_actuator]
        count = thrust.shape[0] * thrust.shape[1]
        level = np.zeros((count, 3))
        pushed = thruster_pushes(machine, thrust.reshape(count, -1), level).reshape(
            *thrust.shape[:2], 3
        )
        answering = None
        if push is not None and push.laws:
            answering = push.slopes(path[0], self.grid.begins)
        carried, braking = floor_transitions(
            machine, model, path[0], pushed, self.grid.step, answering
        )
        if self.grid.step * braking > STIFF:
            return None
        beside = path.moved(STEP * np.moveaxis(reached(carried), -1, 0))
        return States.joined([path, beside]), carried

    def _paths(
        self, model: mujoco.MjModel, start: States, push: PathForces | None
    ) -> tuple[States, Array, Array]:
        """As `paths`; and of all joints positions and velocities (v S, steps + 1, .)."""
        machine, grid = self.machine, self.grid
        self.prepare(model)
        variants = start.rate.shape[0]
        rows = variants * grid.segments
        position = np.tile(self._position, (variants, 1))
        velocity = np.tile(self._velocity, (variants, 1))
        position[:, machine.base_qpos] = start.position.reshape(rows, -1)
        velocity[:, machine.base_dof] = start.rate.reshape(rows, -1)
        if self.inputs.wheels_predicted:
            velocity[:, machine.wheel_dof] = start.wheel_speed.reshape(rows, -1)
        position[:, machine.gimbal_qpos] = start.gimbal_angle.reshape(rows, -1)
        model, push = _sprung(model, push or PathForces(np.zeros_like(self.force)), machine)
        force, turning = self._driven(push.force)
        velocity += np.tile(turning, (variants, 1))
        driven = np.tile(np.concatenate([self._control, force], axis=-1), (variants, 1, 1))
        carrier = _carrier(machine, model, position, velocity)
        positions, velocities = self._carried(carrier, driven, push, np.tile(grid.starts, variants))
        if not (np.isfinite(positions).all() and np.isfinite(velocities).all()):
            raise BeyondBounds("a machine with such parameters moves beyond all bounds")

        def along(values: Array, columns: slice | NDArray[np.intp]) -> Array:
            return values[..., columns].reshape(variants, grid.segments, grid.steps + 1, -1)

        wheels = machine.wheel_dof if self.inputs.wheels_predicted else slice(0, 0)
        path = States(
            along(positions, machine.base_qpos),
            along(velocities, machine.base_dof),
            along(velocities, wheels),
            along(positions, machine.gimbal_qpos),
        )
        return path, positions, velocities

    def onward(
        self,
        model: mujoco.MjModel,
        segments: NDArray[np.intp],
        start: States,
        steps: int,
        push: PathForces,
    ) -> Array:
        """Positions (r, steps + 1, .) from starts (r, .) of segments, on beyond their ends.

        Args:
            model: as for `paths`.
            segments: (r,) that the starts belong to.
            start: of each.
            steps: how far; the last drive is held where the log ends.
            push: added to the drive.
        """
        check()
        machine, grid = self.machine, self.grid
        self.prepare(model)
        model, push = _sprung(model, push, machine)
        position, velocity = self._position[segments], self._velocity[segments]
        position[:, machine.base_qpos] = start.position
        velocity[:, machine.base_dof] = start.rate
        if self.inputs.wheels_predicted:
            velocity[:, machine.wheel_dof] = start.wheel_speed
        position[:, machine.gimbal_qpos] = start.gimbal_angle
        force, turning = self._driven(push.force)
        velocity += turning[segments]
        driven = np.concatenate([self._control, force], axis=-1)
        driven = driven.reshape(-1, model.nu + model.nv)
        place = segments[:, None] * grid.steps + np.arange(steps)
        driven = driven[np.minimum(place, len(driven) - 1)]
        carrier = _carrier(machine, model, position, velocity)
        positions, _ = self._carried(carrier, driven, push, grid.starts[segments])
        return positions[..., machine.base_qpos]

    def _carried(
        self, carrier: "Carrier", driven: Array, push: PathForces, start: Array
    ) -> tuple[Array, Array]:
        """Positions (r, steps + 1, nq) and velocities (r, steps + 1, nv) of machines, first as they
        stand at some times (r,), under controls and forces (r, steps, .) and what answers."""
        position, velocity = carrier.position[:, None].copy(), carrier.velocity[:, None].copy()
        answer = self._answer(push, start) if push.laws else None
        positions, velocities = carrier.carry(driven, answer)
        return (
            np.concatenate([position, positions], axis=1),
            np.concatenate([velocity, velocities], axis=1),
        )

    def _answer(self, push: PathForces, start: Array) -> Answer:
        """The torque of laws on the base over each step, held at its mean, as it would go on."""
        machine, step = self.machine, self.grid.step
        base_qpos, base_dof, wheels = machine.base_qpos, machine.base_dof, machine.wheel_dof
        last: Array | None = None

        def answer(k: int, position: Array, velocity: Array) -> Array:
            nonlocal last
            state = State(
                position[:, base_qpos], velocity[:, base_dof], velocity[:, wheels], start + k * step
            )
            torque = torque_of(push.laws, state)
            mean = torque if last is None else 1.5 * torque - 0.5 * last
            last = torque
            return mean

        return answer

    @property
    def unexplained(self) -> Array:
        """(S, steps, d) torques on wheels and rates of gimbals that no command says."""
        machine, inputs = self.machine, self.inputs
        edges = self.grid.step * np.arange(self.grid.steps + 1)
        rates = [inputs.gimbal_rate(start + edges) for start in self.grid.starts.tolist()]
        return np.concatenate(
            [
                self.force[..., machine.wheel_dof] * inputs.wheels_undriven,
                np.stack(rates) * inputs.gimbals_undriven,
            ],
            axis=-1,
        )

    def answer(self, model: mujoco.MjModel) -> Array:
        """(S, steps or 1, x, nv) change of the state by a unit impulse on each degree of freedom, a
        unit turn of each gimbal; where gimbals turn it differs from step to step."""
        return self._response.of(model)

    def _along(self, motion: Motion) -> tuple[Array, Array]:
        """(S, steps or 1, nq) and (S, steps or 1, nv) of the log's motion."""
        grid, machine = self.grid, self.machine
        if not machine.gimbal_dof.size and machine.platform.base.kind != "planar":
            position, velocity = self._position.copy(), self._velocity.copy()
            position[:, machine.base_qpos] = self.start.position
            return position[:, None], velocity[:, None]
        times = (grid.starts[:, None] + grid.step * (np.arange(grid.steps) + 0.5)).ravel()
        position, velocity, _ = self.inputs.joint_states(times)
        there = motion.at(times)
        position[:, machine.base_qpos], velocity[:, machine.base_dof] = there.position, there.rate
        shape = (grid.segments, grid.steps, -1)
        return position.reshape(shape), velocity.reshape(shape)

    def _driven(self, push: Array) -> tuple[Array, Array]:
        """Forces (S, steps, nv) with a push; and what it adds to the velocities (S, nv) at the
        starts, where it turns gimbals at a rate."""
        dof = self.machine.gimbal_dof
        force, turning = self.force + push, np.zeros_like(self._velocity)
        rate = push[..., dof]
        middle = 0.5 * (rate[:, 1:] + rate[:, :-1])
        edges = np.concatenate([rate[:, :1], middle, rate[:, -1:]], axis=1)
        pull = self.machine.gimbal_inertia * np.diff(edges, axis=1) / self.grid.step
        force[..., dof] = self.force[..., dof] + pull
        turning[:, dof] = edges[:, 0]
        return force, turning

    def prepare(self, model: mujoco.MjModel) -> None:
        """Put a model on the grid's step, prescribe its joints, spare it contacts out of reach."""
        self.inputs.prepare(model)
        model.opt.timestep = self.grid.step
        if not self._contacts:
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def _sprung(
    model: mujoco.MjModel, push: PathForces, machine: Machine
) -> tuple[mujoco.MjModel, PathForces]:
    """A model whose hinge has the springs among the laws of a push, and the push without them:
    exact at every stage of RK4, where a law is held over a step."""
    springs = [(size, law) for size, law in push.laws if isinstance(law, HingeSpring)]
    if not springs:
        return model, push
    joint = model.joint(machine.platform.base.joint)
    place = int(joint.qposadr[0])
    joint_stiffness = float(joint.stiffness[0])
    stiffness = joint_stiffness + sum(size * law.stiffness for size, law in springs)
    moment = joint_stiffness * float(model.qpos_spring[place])
    moment += sum(size * law.stiffness * law.reference for size, law in springs)
    changed = copy(model)
    changed.joint(machine.platform.base.joint).stiffness[0] = stiffness
    changed.qpos_spring[place] = moment / stiffness if stiffness else 0.0
    laws = tuple((size, law) for size, law in push.laws if not isinstance(law, HingeSpring))
    return changed, replace(push, laws=laws)


def _leans(machine: Machine, position: Array, guard: float) -> bool:
    """Whether a base (..., 4) on a ball comes so near to its stop; another one, whether it has
    contacts at all."""
    platform = machine.platform
    if platform.base.kind != "ball":
        return not machine.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return float(platform.lean(position).max()) > platform.stop_angle - guard


class Carrier(Protocol):
    """Machines side by side, to be carried on."""

    position: Array
    """(r, nq) as they stand."""
    velocity: Array
    """(r, nv)."""

    def carry(self, driven: Array, answer: Answer | None = None) -> tuple[Array, Array]:
        """Positions (r, steps, nq) and velocities (r, steps, nv) after each step.

        Args:
            driven: (r, steps, .) controls and forces, constant over a step.
            answer: a torque on the base beside them, which depends on the state.
        """
        ...


class _Simulated:
    """By MuJoCo."""

    def __init__(
        self, model: mujoco.MjModel, base: slice, position: Array, velocity: Array
    ) -> None:
        self._base = model.nu + np.arange(model.nv)[base]
        self._batch = Batch(model, len(position))
        self.position, self.velocity = self._batch.bind("qpos"), self._batch.bind("qvel")
        self.position[:], self.velocity[:] = position, velocity

    def carry(self, driven: Array, answer: Answer | None = None) -> tuple[Array, Array]:
        if answer is None:
            return self._rollout(driven)
        pieces: list[tuple[Array, Array]] = []
        for k in range(driven.shape[1]):
            held = driven[:, k : k + 1].copy()
            held[:, 0, self._base] += answer(k, self.position, self.velocity)
            pieces.append(self._rollout(held))
        positions, velocities = zip(*pieces, strict=True)
        return np.concatenate(positions, axis=1), np.concatenate(velocities, axis=1)

    def _rollout(self, driven: Array) -> tuple[Array, Array]:
        run = self._batch.rollout(
            driven.shape[1], driven, control_spec=_CONTROL | _FORCE, record=("qpos", "qvel")
        )
        return run["qpos"], run["qvel"]


def _carrier(machine: Machine, model: mujoco.MjModel, position: Array, velocity: Array) -> Carrier:
    swing = Swing.of(model)
    if swing is None:
        return _Simulated(model, machine.base_dof, position, velocity)
    return Swinging(swing, position, velocity)
