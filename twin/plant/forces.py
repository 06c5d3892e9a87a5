"""Forces of effects and of thrusters in a simulation, in one run or a thousand.

What a machine's effects push with while it is simulated, in one run or a thousand.
Constant forces with the room's axes are set once. Those that change with time are held over each
physics step at its middle. A torque that depends on the state is evaluated once a step, in one
NumPy call for all runs, and carried on to the step's middle by a straight line through this value
and the last one (Adams-Bashforth): wrong by the square of the step, where what needs no law is
exact. Such a law costs a call of the batch a step instead of one a tick.
"""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from twin import rotation
from twin.effects import BodyEffect, Effect, EffectError, State
from twin.errors import PlatformError
from twin.model import Machine
from twin.platform import Gas, Thruster
from twin.units import STANDARD_GRAVITY

Array = NDArray[np.float64]


Index = NDArray[np.intp]

_STATE = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL)
_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
_PUSH = int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)


class Forces:
    """Of a machine's effects, on a batch of n runs or predictions."""

    def __init__(
        self,
        machine: Machine,
        n: int,
        each: Sequence[Sequence[Effect]] = (),
        shared: Sequence[Effect] | None = None,
    ) -> None:
        """Nothing pushes yet.

        Args:
            machine: of all runs.
            n: runs.
            each: (n,) effects of each run, where they differ in their values.
            shared: those effects for all runs at once; None: the machine's.
        """
        self._machine = machine
        self._n = n
        shared = machine.effects if shared is None else shared
        effects = [effect for effect in shared if isinstance(effect, BodyEffect)]
        platform, model = machine.platform, machine.model
        alike = each or (machine.effects,)
        self._constant = np.zeros((len(alike), model.nbody, 6))
        self._moving: list[list[tuple[int, Callable[[Array], Array]]]] = [[] for _ in alike]
        for constant, moving, own in zip(self._constant, self._moving, alike, strict=True):
            on_body = (effect for effect in own if isinstance(effect, BodyEffect))
            for push in (push for effect in on_body for push in effect.pushes(platform)):
                body = int(model.body(push.body).id)
                if callable(push.wrench):
                    moving.append((body, push.wrench))
                else:
                    constant[body] += push.wrench
        found = [(effect.on_floor, effect.torque(platform)) for effect in effects]
        self._laws = [(floor, law) for floor, law in found if law is not None]
        self._springs = any(effect.follows_start for effect in effects)
        self._last: Array | None = None

    @property
    def changing(self) -> bool:
        """Whether `rollout` is needed; else the batch's own does as well."""
        return bool(self._moving[0] or self._laws)

    def start(self, batch: Batch, qpos: Array) -> None:
        """Set what stays, for runs that start at qpos (n, nq)."""
        if self._constant.any():
            batch.bind("xfrc_applied")[:] = self._constant
        if self._springs:
            base = self._machine.base_qpos
            batch.expand("qpos_spring")[:, base] = qpos[:, base]
        self._last = None

    def rollout(
        self,
        batch: Batch,
        steps: int,
        force: Array | None,
        time: Array,
        states: Array,
        ids: Index | None = None,
    ) -> None:
        """Advance a batch.

        Args:
            batch: of n runs.
            steps: physics steps.
            force: (m, steps, nv) generalised forces; None: none.
            time: at the start, (m,) [s].
            states: those after each step go in here, (m, steps, nq + nv).
            ids: (m,) the runs; None: all.

        Raises:
            SimulationError: some runs failed; the others have run to the end.
        """
        runs = np.arange(self._n) if ids is None else ids
        if force is None:
            force = np.zeros((len(runs), steps, self._machine.model.nv))
        moves = bool(self._moving[0])
        push = self._pushes(runs, steps, time) if moves else np.zeros((len(runs), steps, 0))
        spec = _FORCE | _PUSH if moves else _FORCE
        control = np.concatenate([force, push], axis=2)
        if not self._laws:
            batch.rollout(steps, control, spec, record=[_STATE], ids=ids, out={_STATE: states})
            return
        self._step_by_step(batch, control, spec, time, states, runs)

    def _step_by_step(
        self, batch: Batch, control: Array, spec: int, time: Array, states: Array, runs: Index
    ) -> None:
        """With torques that answer to the state; `runs` (m,), the rest as in `rollout`."""
        failures: list[SimulationError] = []
        left: slice | Index = slice(None)  # the rows of those that have not failed
        for k in range(control.shape[1]):
            held = control[left, k : k + 1]
            held[:, 0, : self._machine.model.nv] += self._answer(
                batch, runs[left], time[left] + k * self._machine.platform.step
            )
            after = np.empty((len(held), 1, states.shape[2]))
            try:
                batch.rollout(1, held, spec, record=[_STATE], ids=runs[left], out={_STATE: after})
            except SimulationError as problem:
                failures.append(problem)
            states[left, k] = after[:, 0]
            if failures:
                # one that was taken up again would be a step behind
                left = np.flatnonzero(~np.isin(runs, _failed(failures)))
                if not len(left):
                    break
        if failures:
            raise SimulationError(_failed(failures), str(failures[0])) from failures[0]

    def _pushes(self, runs: Index, steps: int, time: Array) -> Array:
        """(m, steps, 6 nbody) forces and torques on all bodies."""
        step = self._machine.platform.step
        middles = time[:, None] + (np.arange(steps) + 0.5) * step
        if len(self._moving) == 1:
            return self._wrench(0, middles.ravel()).reshape(len(time), steps, -1)
        wrench = [self._wrench(run, middle) for run, middle in zip(runs, middles, strict=True)]
        return np.stack(wrench).reshape(len(time), steps, -1)

    def _wrench(self, run: int, times: Array) -> Array:
        """(times, nbody, 6)."""
        wrench = np.tile(self._constant[run], (len(times), 1, 1))
        for body, law in self._moving[run]:
            wrench[:, body] += law(times)
        return wrench

    def _answer(self, batch: Batch, runs: Index, time: Array) -> Array:
        """(m, nv) generalised force in the middle of the next step."""
        machine = self._machine
        times = np.zeros(self._n)
        times[runs] = time
        # of all runs: a law whose parameters differ from run to run has a row for each
        now = np.zeros((self._n, machine.model.nv))
        with np.errstate(all="ignore" if len(runs) < self._n else None):  # some have stopped
            for floor, law in self._laws:
                state, dof = _state(machine, batch, times, floor=floor)
                now[:, dof] += law(state)
        now = now[runs]
        if self._last is None:
            self._last = np.zeros((self._n, now.shape[1]))
            self._last[runs] = now
        middle = 1.5 * now - 0.5 * self._last[runs]
        self._last[runs] = now
        return middle


def _state(
    machine: Machine, batch: Batch, times: Array, *, floor: bool
) -> tuple[State, Index | slice]:
    """Of all runs, as a law takes it, and the degrees of freedom that it pushes."""
    position, rate = batch.bind("qpos"), batch.bind("qvel")
    if not floor:
        base = machine.base_dof
        state = State(
            position[:, machine.base_qpos], rate[:, base], rate[:, machine.wheel_dof], times
        )
        return state, base
    dof = np.append(machine.place_dof, machine.base_dof.stop - 1)
    attitude = position[:, machine.base_qpos]
    heading = 2.0 * np.arctan2(attitude[:, 3], attitude[:, 0])
    place = np.column_stack([position[:, machine.place_qpos], heading])
    return State(place, rate[:, dof], rate[:, machine.wheel_dof], times), dof


def _failed(failures: Sequence[SimulationError]) -> Index:
    return np.unique(np.concatenate([failure.ids for failure in failures]))


def thruster_arms(machine: Machine) -> Array:
    """(thrusters, 3) torque about the CR per force of each [m], body axes, effects and all."""
    edited = _edited_thrusters(machine)
    return np.array([np.cross(item.point, item.direction) for item in edited]).reshape(-1, 3)


def thruster_pushes(machine: Machine, thrust: Array, position: Array) -> Array:
    """(m, k) generalised force of thrusters on the base, effects and all [N, N m].

    Args:
        machine: compiled.
        thrust: (m, thrusters) [N].
        position: (m, .) of the base; only a planar one turns its thrusters against its axes.
    """
    if machine.platform.base.kind != "planar":
        return thrust @ thruster_arms(machine)
    direction = np.array([item.direction for item in _edited_thrusters(machine)])
    force = thrust @ direction
    cosine, sine = np.cos(position[:, 2]), np.sin(position[:, 2])
    return np.stack(
        [
            cosine * force[:, 0] - sine * force[:, 1],
            sine * force[:, 0] + cosine * force[:, 1],
            thrust @ thruster_arms(machine)[:, 2],
        ],
        axis=-1,
    )


def _edited_thrusters(machine: Machine) -> list[Thruster]:
    """As a machine's effects have them."""
    edited: list[Thruster] = []
    for thruster in machine.platform.thrusters:
        for effect in machine.effects:
            if isinstance(effect, BodyEffect):
                thruster = effect.edit_thruster(thruster)
        edited.append(thruster)
    return edited


class LateCommands:
    """Forces of k actuators in n runs, each a delay after its command."""

    def __init__(self, n: int, delay: Array, acts: str) -> None:
        """All zero.

        Args:
            n: runs.
            delay: (k,) of the actuators [s].
            acts: the subject and verb of a message, as "thrusters would push".
        """
        self._delay, self._acts = delay, acts
        self._commands = [(-np.inf, np.zeros((n, len(delay))), delay)]
        self.late = bool(delay.any())
        """Whether a force may come after its command."""

    @property
    def force(self) -> Array:
        """(n, k) as last commanded."""
        return self._commands[-1][1]

    def command(self, time: float, force: Array, late: float = 0.0) -> None:
        """Hold another force.

        Args:
            time: of the command, not before that of the last one [s].
            force: (n, k).
            late: delay beyond the actuators' own [s].

        Raises:
            EffectError: a force would come before its command.
        """
        delay = self._delay + late
        if np.any(delay < 0.0):
            raise EffectError(
                f"{self._acts} {-delay.min():g} s before their commands; give an effect whose "
                "delay with that of platform.toml is 0 or more"
            )
        self._commands.append((time, force, delay))
        # the one before last still acts until the delay of the last one has passed
        over = [at for at, _, _ in self._commands if at + float(np.max(delay, initial=0.0)) < time]
        del self._commands[: max(len(over) - 1, 0)]
        self.late = any(bool(item.any()) for _, _, item in self._commands)

    def mean(self, start: float, step: float, steps: int) -> Array:
        """Mean force in each of some steps from a time on, (n, steps, k)."""
        edges = start + step * np.arange(steps + 1)
        ends = [at + delay for at, _, delay in self._commands]
        total = np.zeros((len(self.force), steps, len(self._delay)))
        for (_, force, _), begin, end in zip(
            self._commands, ends, [*ends[1:], np.full(len(self._delay), np.inf)], strict=True
        ):
            first = np.maximum(edges[:-1, None], begin)
            held = np.maximum(np.minimum(edges[1:, None], end) - first, 0.0) / step
            # rounding of the times must not make one force of many
            held = np.where(np.abs(held - np.round(held)) < 1e-9, np.round(held), held)
            total += held * force[:, None]
        return total


class Tanks:
    """Gas left in n runs. A thruster's force F takes F / (I_sp g_0) kilograms a second."""

    def __init__(self, gas: Gas, n: int, leak: Array | float = 0.0) -> None:
        """Full.

        Args:
            gas: as stated.
            n: runs.
            leak: lost besides, (n,) or of all [kg/s].
        """
        self.mass = np.full(n, gas.mass)
        """(n,) [kg]."""
        self.leaks = bool(np.any(leak))
        """Whether gas is lost without a command."""
        self._leak = np.broadcast_to(leak, (n,))
        self._leaked = np.zeros(n)
        self._gas = gas
        self._exhaust_speed = gas.specific_impulse * STANDARD_GRAVITY

    @property
    def pressure(self) -> Array:
        """(n,) at constant temperature [Pa], without what leaks: an effect takes that off."""
        mass = self.mass + self._leaked if self.leaks else self.mass
        return self._gas.pressure * mass / self._gas.mass

    def fed(self, force: Array) -> Array:
        """The force (n, thrusters) [N] that there is gas for: none once the tanks are empty."""
        return np.where(self.mass[:, None] > 0.0, force, 0.0)

    @property
    def taken(self) -> Array:
        """(n,) that has left [kg]."""
        return self._gas.mass - self.mass

    def draw(self, force: Array, duration: float) -> None:
        """Take out what the force (n, thrusters) [N], held for `duration` [s], needs."""
        self.mass = np.maximum(self.mass - self._needed(force, duration), 0.0)

    def flow(self, force: Array, duration: float) -> Array:
        """(n,) what will leave by that force and by leaks within `duration` [s], in kg."""
        return np.minimum(self._needed(force, duration) + self._leak * duration, self.mass)

    def _needed(self, force: Array, duration: float) -> Array:
        return force.sum(axis=1) * (duration / self._exhaust_speed)

    def leak(self, duration: float) -> None:
        """Lose what leaks within `duration` [s]."""
        lost = np.minimum(self._leak * duration, self.mass)
        self._leaked = self._leaked + lost
        self.mass = self.mass - lost


class LighterBus:
    """The bus of n runs, less what has left the tanks on it.

    The mass m that has left took m r of its tanks and its inertia about the CR with it. What the
    gas carries away from a body that turns (jet damping, dm/dt r x (w x r)) is left out, and a stop
    is as soft as for the full tanks.
    """

    def __init__(self, batch: Batch, machine: Machine, gas: Gas) -> None:
        """Nothing has left.

        Args:
            batch: of n runs, whose models may differ.
            machine: of all runs.
            gas: in tanks with places.

        Raises:
            PlatformError: the bus does not hold so much gas.
        """
        model, bus = machine.model, machine.base_body
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        turn = data.xmat[bus].reshape(3, 3).T
        self.taken = {
            "center_of_mass_offset": gas.moment,
            "inertia": gas.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
        }
        """By stream of what is true, what a kilogram takes with it, as its columns."""
        self._bus = bus
        self._views = {name: batch.expand(name) for name in _INERTIAL}
        self.used = np.zeros(len(self._views["body_mass"]))
        """(n,) that is taken off [kg]."""
        self._anchor = model.jnt_pos[model.body_jntadr[bus]].copy()
        self._moment, self._spread = turn @ gas.moment, turn @ gas.inertia @ turn.T
        self._mass = self._views["body_mass"][:, bus].copy()
        center = self._views["body_ipos"][:, bus] - self._anchor
        axes = rotation.matrix(self._views["body_iquat"][:, bus])
        moments = self._views["body_inertia"][:, bus]
        tensor = np.einsum("nij,nj,nkj->nik", axes, moments, axes)
        self._first = self._mass[:, None] * center
        self._tensor = tensor + _about(self._mass, center)
        mass, _, empty = self._without(np.full(len(moments), gas.mass), slice(None))
        if np.any(mass <= 0.0) or np.any(np.linalg.eigvalsh(empty) <= 0.0):
            platform = machine.platform
            raise PlatformError(
                platform.folder / "platform.toml",
                f"{platform.name} could not lose its {gas.mass:g} kg of gas: without them the bus "
                "would have no positive mass or moment of inertia",
                "check [gas] mass and the places of its tanks",
            )

    def take(self, used: Array) -> None:
        """(n,) has left since the start [kg]; a run of which nothing has keeps its bits."""
        rows = np.flatnonzero(used > 0.0)
        self.used = used
        mass, center, tensor = self._without(used[rows], rows)
        moments, axes = np.linalg.eigh(tensor)
        axes = axes * np.sign(np.linalg.det(axes))[:, None, None]
        self._views["body_mass"][rows, self._bus] = mass
        self._views["body_ipos"][rows, self._bus] = self._anchor + center
        self._views["body_inertia"][rows, self._bus] = moments
        turned = Rotation.from_matrix(axes).as_quat(scalar_first=True)
        self._views["body_iquat"][rows, self._bus] = turned
        self._views["body_sameframe"][rows, self._bus] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE

    def _without(self, used: Array, rows: Index | slice) -> tuple[Array, Array, Array]:
        """Mass, centre from the CR and tensor about it, of some runs."""
        mass = self._mass[rows] - used
        center = (self._first[rows] - used[:, None] * self._moment) / mass[:, None]
        tensor = self._tensor[rows] - used[:, None, None] * self._spread
        return mass, center, tensor - _about(mass, center)


_INERTIAL = ("body_mass", "body_ipos", "body_iquat", "body_inertia", "body_sameframe")


def _about(mass: Array, center: Array) -> Array:
    """m (|c|^2 I - c c^T), (n, 3, 3)."""
    square = np.einsum("ni,ni->n", center, center)[:, None, None] * np.eye(3)
    return mass[:, None, None] * (square - center[:, :, None] * center[:, None, :])
