"""The simulated machine: `mujoco.batch.Batch` behind the plant interface, one run or thousands.

Between two ticks every run advances by a whole number of RK4 steps under the held command, in one
call for the whole batch. A run that leaves physics (not finite, or spinning absurdly) is stopped
with a reason; the others go on to the same bits as if they were alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from twin.effects import ScatterEffect, series_effects
from twin.errors import UsageError
from twin.model import compile_model
from twin.plant.forces import Forces
from twin.plant.limits import Limits
from twin.plant.plant import Plant
from twin.plant.sensors import SimulatedSensor
from twin.plant.stages import plan
from twin.plant.truth import Truth
from twin.platform import Platform
from twin.signals import Command, Reading, Samples

Array = NDArray[np.float64]

_STATE = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL)
_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)

_ABSURD_RATE = 1e3
"""[rad/s]: a base that turns faster has diverged; no such machine survives a hundredth of it."""

_GUARD = np.radians(5.0)
"""Contacts are computed only within this of the tilt stop (and whenever a tick could cross it);
they cost as much as the rest of the step."""


@dataclass(frozen=True)
class InitialState:
    """How the runs start; each shape broadcasts against (n, width)."""

    attitude: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    """(4,) or (n, 4), world from body; ball joints."""
    rate_body: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) or (n, 3) [rad/s]; ball joints."""
    joint_angle: float | Array = 0.0
    """Or (n, 1) [rad]; hinges."""
    joint_rate: float | Array = 0.0
    """Or (n, 1) [rad/s]; hinges."""
    wheel_speed: float | Array = 0.0
    """Or (wheels,), (n, wheels) [rad/s]."""
    stage_position: float | Array = 0.0
    """Or (stages,), (n, stages) [m]."""


class SimulatedPlant(Plant):
    """n runs of one platform, advanced together."""

    def __init__(
        self,
        platform: Platform,
        *,
        runs: Sequence[int] = (0,),
        seed: int = 0,
        initial: InitialState | None = None,
        threads: int = 0,
    ) -> None:
        """Compile the platform and put every run into its initial state.

        Args:
            platform: the machine.
            runs: the numbers of the runs; a run's random numbers depend on `seed` and its number
                only, so run 17 of 256 is replayed with runs=(17, 17).
            seed: of all random numbers.
            initial: initial state; at rest and level unless given.
            threads: threads of the batch; 0 means all cores. Results do not depend on it.

        Raises:
            PlatformError: the platform does not compile.
            UsageError: no runs.
        """
        if not runs:
            raise UsageError("a batch needs at least one run; runs is empty")
        self.platform = platform
        self.n = len(runs)
        self.stopped = {}
        self.machine = compile_model(platform)
        self._limits = Limits(platform)
        model = self.machine.model
        self._batch = Batch(model, self.n, 1 if self.n == 1 else threads)
        self._done = 0
        self._ids: NDArray[np.intp] | None = None
        self._alive = np.ones(self.n, dtype=np.bool_)
        self._qpos = self._batch.bind("qpos")
        self._qvel = self._batch.bind("qvel")
        self._ctrl = self._batch.bind("ctrl")
        self._force = self._batch.bind("qfrc_applied")
        self._flags = self._batch.expand("opt.disableflags")
        self._model_flags = int(model.opt.disableflags)
        self._guard = np.sin(0.5 * (min(platform.tilt_limit, np.pi) - _GUARD))

        self._stage_position, self._stage_speed = self._start(initial or InitialState())
        self._stage_target = self._stage_position.copy()
        self._max_speed = np.array([stage.speed for stage in platform.stages])
        self._max_acceleration = np.array([stage.acceleration for stage in platform.stages])
        self._applied = self._idle()
        self._wheel_wish = np.zeros((self.n, len(platform.wheels)))
        effects = self.machine.effects
        shaking = [effect for effect in effects if isinstance(effect, ScatterEffect)]
        self._sensors = [
            SimulatedSensor(
                sensor,
                runs,
                seed,
                platform,
                series_effects(effects, stream),
                [effect for effect in shaking if effect.acts_on == stream],
            )
            for stream, sensor in platform.sensors.items()
        ]
        self._acts = {
            command: [effect.live(platform) for effect in series_effects(effects, command)]
            for command in platform.commands
        }
        if self._acts.get("command_stage_position"):
            self._done_with("command_stage_position", self._stage_position)
        self._forces = Forces(self.machine, self.n)
        self._forces.start(self._batch, self._qpos)
        self._truth = Truth(self.machine)
        self._started = False

    @property
    def time(self) -> float:
        """Simulated seconds since the first tick."""
        return self._done * self.platform.step

    def read(self, until: float) -> Reading:
        steps = round((until - self.time) / self.platform.step)
        if steps < 0:
            raise UsageError(f"time runs forward: the plant is at {self.time:g} s, not {until:g} s")
        if not self._started:
            self._started = True
            self._sample(np.concatenate([self._qpos, self._qvel], axis=1)[:, None, :])
        if steps > 0:
            self._sample(self._advance(steps))
        streams: dict[str, Samples] = {}
        for sensor in self._sensors:
            samples = sensor.arrived(until)
            if samples is not None:
                streams[sensor.sensor.stream] = samples
        return Reading(until, streams)

    def write(self, command: Command) -> Command:
        self._limits.check(command, self.n)
        for name, value in command.items():
            if not np.isfinite(value).all():
                self._refuse_not_finite(name, value)
                value = np.where(np.isfinite(value), value, self._applied[name])
            if name == "command_wheel_torque":
                applied = self._wheel_torque(value)
            elif name == "command_stage_position":
                applied = self._limits.stage_position(value)
                self._stage_target = self._done_with(name, applied)
            else:
                applied = self._limits.joint_torque(value)
                self._ctrl[:, self.machine.joint_actuator] = applied[:, 0]
            self._applied[name] = applied
        if "command_wheel_torque" in self._applied and "command_wheel_torque" not in command:
            self._applied["command_wheel_torque"] = self._wheel_torque(self._wheel_wish)
        return dict(self._applied)

    def truth(self) -> dict[str, Samples]:
        return self._truth.at(self.time, self._qpos, self._qvel, self._alive)

    def _wheel_torque(self, wish: Array) -> Array:
        self._wheel_wish = wish
        applied = self._limits.wheel_torque(wish, self._qvel[:, self.machine.wheel_dof])
        done = self._done_with("command_wheel_torque", applied)
        self._ctrl[:, self.machine.wheel_actuator] = done
        return applied

    def _done_with(self, name: str, applied: Array) -> Array:
        """What the actuators' effects leave of a command, (n, k)."""
        if not self._acts[name]:
            return applied
        stamp = np.full((self.n, 1), self.time)
        samples = Samples(applied[:, None], stamp, self._alive[:, None])
        for act in self._acts[name]:
            samples = act(samples)
        return samples.value[:, 0]

    def _start(self, initial: InitialState) -> tuple[Array, Array]:
        machine = self.machine
        if self.platform.base.kind == "ball":
            quat = np.asarray(initial.attitude, dtype=np.float64)
            self._qpos[:, machine.base_qpos] = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
            self._qvel[:, machine.base_dof] = initial.rate_body
        else:
            self._qpos[:, machine.base_qpos] = initial.joint_angle
            self._qvel[:, machine.base_dof] = initial.joint_rate
        self._qvel[:, machine.wheel_dof] = initial.wheel_speed
        self._qpos[:, machine.stage_qpos] = initial.stage_position
        position = self._qpos[:, machine.stage_qpos].copy()
        return position, np.zeros_like(position)

    def _idle(self) -> Command:
        idle = {name: np.zeros((self.n, width)) for name, width in self.platform.commands.items()}
        if "command_stage_position" in idle:
            idle["command_stage_position"] = self._stage_position.copy()
        return idle

    def _advance(self, steps: int) -> Array:
        """Advance every living run; the states after each step, (n, steps, nq + nv)."""
        moving = bool((self._stage_position != self._stage_target).any()) or bool(
            self._stage_speed.any()
        )
        control = self._stage_forces(steps) if moving else None
        self._set_contacts(steps)
        living = self._living()
        states = np.empty((len(living), steps, self._qpos.shape[1] + self._qvel.shape[1]))
        try:
            if self._forces.changing:
                start = np.full(len(living), self.time)
                self._forces.rollout(self._batch, steps, control, start, states, self._ids)
            else:
                self._batch.rollout(
                    steps,
                    control,
                    _FORCE if moving else 0,
                    record=[_STATE],
                    ids=self._ids,
                    out={_STATE: states},
                )
        except SimulationError as problem:
            for run in problem.ids:
                self._stop(int(run), f"MuJoCo: {self._batch.error(int(run))}")
        self._done += steps
        if len(living) < self.n:
            # a stopped run stands still
            present = np.concatenate([self._qpos, self._qvel], axis=1)
            moved, states = states, present[:, None].repeat(steps, axis=1)
            states[living] = moved
        self._pin_stages(moving)
        self._stop_diverged(states[:, -1])
        return states

    def _stage_forces(self, steps: int) -> Array:
        """qfrc_applied of the prescribed joints, (living runs, steps, nv), and their end state."""
        acceleration, self._stage_position, self._stage_speed = plan(
            self._stage_position,
            self._stage_speed,
            self._stage_target,
            steps=steps,
            step=self.platform.step,
            max_speed=self._max_speed,
            max_acceleration=self._max_acceleration,
        )
        force = np.zeros((self.n, steps, self.machine.model.nv))
        force[:, :, self.machine.stage_dof] = acceleration * self.machine.stage_inertia
        return force[self._living()]

    def _pin_stages(self, moving: bool) -> None:
        """Put the prescribed joints on their profile: what pushed back in a tick is forgotten."""
        if not self.platform.stages:
            return
        self._qpos[:, self.machine.stage_qpos] = self._stage_position
        self._qvel[:, self.machine.stage_dof] = self._stage_speed
        if moving:
            self._force[:] = 0.0

    def _set_contacts(self, steps: int) -> None:
        if not np.isfinite(self.platform.tilt_limit) or self.platform.base.kind != "ball":
            return
        tilt = self._qpos[:, self.machine.base_qpos][:, 1:3]
        rate = self._qvel[:, self.machine.base_dof]
        reach = 0.5 * _GUARD / (steps * self.platform.step)
        lean = np.einsum("ni,ni->n", tilt, tilt)
        speed = np.einsum("ni,ni->n", rate, rate)
        near = (lean > self._guard**2) | (speed > reach**2)
        self._flags[:] = np.where(near, self._model_flags, self._model_flags | _NO_CONTACT)

    def _sample(self, states: Array) -> None:
        """Let every sensor see the states after the last steps, (n, steps, nq + nv)."""
        steps = states.shape[1]
        times = np.arange(self._done - steps + 1, self._done + 1) * self.platform.step
        valid = None if self._ids is None else self._alive
        for sensor in self._sensors:
            picks = sensor.picks(self._done - steps, steps)
            seen = self._truth.measured(sensor.sensor.stream, states)[:, picks]
            causes = [self._truth.measured(e.cause, states)[:, picks] for e in sensor.scatter]
            sensor.measure(seen, times[picks], valid, causes)

    def _stop_diverged(self, last: Array) -> None:
        rate = last[:, self.machine.model.nq :][:, self.machine.base_dof]
        # a sum is finite only if every term is: one pass over all runs at once
        if np.isfinite(last.sum()) and np.abs(rate).max() < _ABSURD_RATE:
            return
        sane = np.isfinite(last).all(axis=1) & (np.abs(rate).max(axis=1) < _ABSURD_RATE)
        for run in np.flatnonzero(~sane & self._alive):
            finite = np.isfinite(last[run]).all()
            self._stop(
                int(run),
                f"the body turns at {np.abs(rate[run]).max():.3g} rad/s: the run has diverged"
                if finite
                else "the state is not finite: the run has diverged",
            )

    def _refuse_not_finite(self, name: str, value: Array) -> None:
        columns = self.platform.columns(name)
        for run, column in np.argwhere(~np.isfinite(value)):
            if self._alive[run]:
                self._stop(int(run), f"{name} {columns[column]} is {value[run, column]}")

    def _stop(self, run: int, reason: str) -> None:
        self.stopped[run] = f"{reason} (at {self.time:.3f} s)"
        self._alive[run] = False
        self._ids = self._living()

    def _living(self) -> NDArray[np.intp]:
        return np.flatnonzero(self._alive)
