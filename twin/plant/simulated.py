"""The simulated machine: `mujoco.batch.Batch` behind the plant interface, one run or thousands.

Between two ticks every run advances by a whole number of RK4 steps under the held command, in one
call for the whole batch. A run that leaves physics (not finite, or spinning absurdly) is stopped
with a reason; the others go on to the same bits as if they were alone.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from twin.effects import Effect, ReadingEffect, ScatterEffect, series_effects
from twin.effects.actuators import GasConsumption, GimbalFriction
from twin.errors import UsageError
from twin.model import compile_model, untouched
from twin.plant.each import give_each, set_offsets
from twin.plant.forces import Forces, LateCommands, LighterBus, Tanks, thruster_arms
from twin.plant.initial import InitialState, check_velocity, check_within_stop
from twin.plant.limits import Limits
from twin.plant.plant import Plant
from twin.plant.prescribed import PrescribedJoints
from twin.plant.sensors import SimulatedSensor
from twin.plant.truth import Truth, window_steps
from twin.platform import Platform
from twin.rotation import vertical_body
from twin.signals import Command, Reading, Samples

Array = NDArray[np.float64]

_STATE = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL)
_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
_CONSTRAINT = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)

_ABSURD_RATE = 1e3
"""[rad/s]: a base that turns faster has diverged; no such machine survives a hundredth of it."""

_GUARD = np.radians(5.0)
"""Contacts are computed only within this of the tilt stop, or within half of a stop that is nearer
than twice this (and whenever a tick could cross it)."""


class SimulatedPlant(Plant):
    """n runs of one platform, advanced together."""

    def __init__(
        self,
        platform: Platform,
        *,
        runs: Sequence[int] = (0,),
        seed: int = 0,
        initial: InitialState | None = None,
        effects: Sequence[Sequence[Effect]] = (),
        threads: int = 0,
    ) -> None:
        """Compile the platform and put every run into its initial state.

        Args:
            platform: the machine.
            runs: the numbers of the runs; a run's random numbers depend on `seed` and its number
                only, so run 17 of 256 is replayed with runs=(17, 17).
            seed: of all random numbers.
            initial: initial state; at rest and level unless given.
            effects: (n,) of each run, in place of the platform's: the same ones with other values.
            threads: threads of the batch; 0 means all cores. Results do not depend on it.

        Raises:
            PlatformError: the platform does not compile.
            UsageError: no runs.
            EffectError: effects whose values cannot differ from run to run.
        """
        if not runs:
            raise UsageError("a batch needs at least one run; runs is empty")
        self.platform = platform
        self.n = len(runs)
        self.stopped = {}
        self.stopped_at: dict[int, float] = {}
        """When each of these was: row -> time [s]."""
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
        start = initial or InitialState()
        offsets, shared = start.center_of_mass_offset, self.machine.effects
        models: Sequence[mujoco.MjModel] = ()
        if effects:
            shared, models = give_each(self._batch, self.machine, effects, offsets)
        elif offsets is not None:
            set_offsets(self._batch, self.machine, np.broadcast_to(offsets, (self.n, 3)))
        self._flags = self._batch.expand("opt.disableflags")
        self._model_flags = int(model.opt.disableflags)
        self._untouched = self._model_flags | untouched(model)
        dry = self._batch.expanded("dof_frictionloss")
        if dry is not None and dry.any():  # of some runs, if not of the common model
            self._model_flags &= ~_CONSTRAINT
            self._untouched &= ~_CONSTRAINT
        stop = min(platform.stop_angle, np.pi)
        self._near = min(_GUARD, 0.5 * stop)
        within = stop - self._near
        self._guard = np.sin(within if platform.pitch_stop else 0.5 * within)

        self._start(start)
        self._joints = PrescribedJoints(self.machine, self._qpos, self._qvel)
        gas, leak = platform.gas, _leak(shared, self.n)
        self._tanks = None if gas is None else Tanks(gas, self.n, leak)
        self._lighter: LighterBus | None = None
        if gas is not None and gas.tanks:
            self._lighter = LighterBus(self._batch, self.machine, gas)
        self._thrust = self._thrust_wish = np.zeros((self.n, len(platform.thrusters)))
        valves = np.array([item.delay for item in platform.thrusters])
        self._valves = LateCommands(self.n, valves, "thrusters would push")
        self._motor = LateCommands(self.n, np.zeros(1), "the motor would act")
        self._thrust_torque = np.zeros((self.n, 3))
        self._thrust_arms = thruster_arms(self.machine)
        self._wheel_wish = np.zeros((self.n, len(platform.wheels)))
        self._apply: dict[str, Callable[[Array], Array]] = {
            "command_wheel_torque": self._wheel_torque,
            "command_stage_position": self._stage_drive,
            "command_joint_torque": self._joint_torque,
            "command_gimbal_rate": self._gimbal_drive,
            "command_dipole": self._dipole,
            "command_thruster": self._force_of_thrusters,
        }
        self._applied = self._idle()
        shaking = [effect for effect in shared if isinstance(effect, ScatterEffect)]
        self._sensors = [
            SimulatedSensor(
                sensor,
                runs,
                seed,
                platform,
                series_effects(shared, stream),
                [effect for effect in shaking if effect.acts_on == stream],
            )
            for stream, sensor in platform.sensors.items()
        ]
        self._misread = [effect for effect in shared if isinstance(effect, ReadingEffect)]
        self._acts = {
            command: [effect.live(platform) for effect in series_effects(shared, command)]
            for command in platform.commands
        }
        if self._joints.loops is not None:  # whose friction acts in the drive, not on the command
            stated = series_effects(shared, "command_gimbal_rate")
            dry = [effect for effect in stated if isinstance(effect, GimbalFriction)]
            kept = [e.live(platform) for e in stated if not isinstance(e, GimbalFriction)]
            self._acts["command_gimbal_rate"] = kept
            for effect in dry:
                self._joints.loops.add_friction(effect.on_gimbals(platform))
        if self._acts.get("command_stage_position"):
            self._done_with("command_stage_position", self._joints.stage_position)
        self._forces = Forces(self.machine, self.n, effects, shared)
        self._forces.start(self._batch, self._qpos)
        self._truth = Truth(self.machine, offsets, models, shared)
        first = np.concatenate([self._qpos, self._qvel], axis=1)[:, None, :]
        longest = [window_steps(item, platform.step) for item in platform.sensors.values()]
        self._before = first.repeat(max(longest, default=1), axis=1)
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
            self._sample(self._before[:, -1:])
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
            self._applied[name] = self._apply[name](value)
        if "command_wheel_torque" in self._applied and "command_wheel_torque" not in command:
            self._applied["command_wheel_torque"] = self._wheel_torque(self._wheel_wish)
        if "command_thruster" in self._applied and "command_thruster" not in command:
            self._applied["command_thruster"] = self._fed(self._thrust_wish)
        return dict(self._applied)

    def drive_stages(self, position: Array) -> None:
        """Stages follow drives of their own: (n, stages) where by the end of the next tick [m].

        From then on no stage is told by `write` where to go; the effects on that command act here.
        """
        self._joints.drive_stages(self._done_with("command_stage_position", position))

    @property
    def state(self) -> tuple[Array, Array]:
        """MuJoCo's qpos (n, nq) and qvel (n, nv), copied; `machine` says where the parts stand."""
        return self._qpos.copy(), self._qvel.copy()

    def truth(self) -> dict[str, Samples]:
        streams = self._truth.at(self.time, self._qpos, self._qvel, self._alive)
        if self._tanks is not None:
            mass, now = self._tanks.mass[:, None, None].copy(), streams["truth_inertia"]
            streams["truth_gas_mass"] = Samples(mass, now.time, now.valid)
            if self._lighter is not None:
                for name, per_mass in self._lighter.taken.items():
                    whole = streams[f"truth_{name}"]
                    value = whole.value - (self._tanks.taken[:, None] * per_mass)[:, None]
                    streams[f"truth_{name}"] = Samples(value, whole.time, whole.valid)
        return streams

    def _wheel_torque(self, wish: Array) -> Array:
        self._wheel_wish = wish
        applied = self._limits.wheel_torque(wish, self._qvel[:, self.machine.wheel_dof])
        done = self._done_with("command_wheel_torque", applied)
        self._ctrl[:, self.machine.wheel_actuator] = done
        return applied

    def _done_with(self, name: str, applied: Array) -> Array:
        """What the actuators' effects leave of a command, (n, k)."""
        return self._acted(name, applied)[0]

    def _acted(self, name: str, applied: Array) -> tuple[Array, float]:
        """Likewise, and how late it is done [s]."""
        if not self._acts[name]:
            return applied, 0.0
        stamp = np.full((self.n, 1), self.time)
        samples = Samples(applied[:, None], stamp, self._alive[:, None])
        for act in self._acts[name]:
            samples = act(samples)
        return samples.value[:, 0], float(samples.time[0, 0]) - self.time

    def _stage_drive(self, wish: Array) -> Array:
        applied = self._limits.stage_position(wish)
        self._joints.send_stages(self._done_with("command_stage_position", applied))
        return applied

    def _joint_torque(self, wish: Array) -> Array:
        applied = self._limits.joint_torque(wish)
        self._motor.command(self.time, *self._acted("command_joint_torque", applied))
        self._turn_with(self._motor.force)
        return applied

    def _turn_with(self, torque: Array) -> None:
        """Let the hinge's motor turn with (n, 1) [N m]."""
        self._ctrl[:, self.machine.joint_actuator] = torque[:, 0]

    def _gimbal_drive(self, wish: Array) -> Array:
        applied = self._limits.gimbal_rate(wish)
        self._joints.send_gimbals(self._done_with("command_gimbal_rate", applied))
        return applied

    def _dipole(self, wish: Array) -> Array:
        coils, applied = self._limits.dipole(wish)
        if self._acts["command_dipole"]:
            coils = self._limits.coils(self._done_with("command_dipole", applied))
        self._ctrl[:, self.machine.magnetorquer_actuator] = coils
        return applied

    def _force_of_thrusters(self, wish: Array) -> Array:
        self._thrust_wish = self._limits.force(wish)
        applied = self._fed(self._thrust_wish)
        self._valves.command(self.time, *self._acted("command_thruster", applied))
        if not self._valves.late:
            self._push_with(self._valves.force)
        return applied

    def _fed(self, force: Array) -> Array:
        """Forces of thrusters (n, thrusters) [N] as far as there is gas."""
        return force if self._tanks is None else self._tanks.fed(force)

    def _push_with(self, force: Array) -> None:
        """Let thrusters push with (n, thrusters) [N], as far as there is gas."""
        self._thrust = self._fed(force)
        if self.machine.thruster_actuator.size:
            self._ctrl[:, self.machine.thruster_actuator] = self._thrust
        else:
            self._thrust_torque = np.einsum("nt,ti->ni", self._thrust, self._thrust_arms)

    def _start(self, initial: InitialState) -> None:
        machine, base = self.machine, self.platform.base
        check_velocity(self.platform, np.asarray(initial.velocity))
        if base.kind != "hinge":
            quat = np.asarray(initial.attitude, dtype=np.float64)
            self._qpos[:, machine.base_qpos] = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
            check_within_stop(self.platform, self._qpos[:, machine.base_qpos])
            self._qvel[:, machine.base_dof] = initial.rate_body
            if base.joint in base.locked and np.any(self._qpos[:, machine.base_qpos][:, 1:3]):
                raise UsageError(f"{self.platform.name} is locked level; start it without a tilt")
        else:
            self._qpos[:, machine.base_qpos] = initial.joint_angle
            self._qvel[:, machine.base_dof] = initial.joint_rate
        self._qvel[:, machine.place_dof] = np.asarray(initial.velocity)[
            ..., : len(machine.place_dof)
        ]
        self._qvel[:, machine.wheel_dof] = initial.wheel_speeds(self.platform)
        self._qpos[:, machine.stage_qpos] = initial.stage_position
        home = np.array([gimbal.home for gimbal in self.platform.gimbals])
        angle = home if initial.gimbal_angle is None else initial.gimbal_angle
        self._qpos[:, machine.gimbal_qpos] = angle

    def _idle(self) -> Command:
        idle = {name: np.zeros((self.n, width)) for name, width in self.platform.commands.items()}
        if "command_stage_position" in idle:
            idle["command_stage_position"] = self._joints.stage_position.copy()
        return idle

    def _advance(self, steps: int) -> Array:
        """Advance every living run; the states after each step, (n, steps, nq + nv)."""
        late = [
            (commands.mean(self.time, self.platform.step, steps), act)
            for commands, act in (
                (self._valves, self._push_with),
                (self._motor, self._turn_with),
            )
            if commands.late
        ]
        if not late:
            return self._advance_held(steps)
        every = np.concatenate([force for force, _ in late], axis=2)
        changes = np.flatnonzero(np.any(np.diff(every, axis=1), axis=(0, 2))) + 1
        states: list[Array] = []
        for first, last in pairwise([0, *changes.tolist(), steps]):
            for force, act in late:
                act(force[:, first])
            states.append(self._advance_held(last - first))
        return np.concatenate(states, axis=1)

    def _advance_held(self, steps: int) -> Array:
        """As `_advance`, under forces of thrusters that stay as they are."""
        control = self._joints.forces(steps)
        if self._thrust_torque.any():
            control = self._joints.no_forces(steps) if control is None else control
            control[:, :, self.machine.base_dof] += self._thrust_torque[:, None]
        pushed = control is not None
        if self._tanks is not None and self._lighter is not None:
            self._lighten(self._tanks, self._lighter, steps * self.platform.step)
        self._set_contacts(steps)
        living = self._living()
        if control is not None and len(living) < self.n:
            control = control[living]
        states = np.empty((len(living), steps, self._qpos.shape[1] + self._qvel.shape[1]))
        try:
            if self._forces.changing:
                start = np.full(len(living), self.time)
                self._forces.rollout(self._batch, steps, control, start, states, self._ids)
            else:
                self._batch.rollout(
                    steps,
                    control,
                    _FORCE if pushed else 0,
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
        self._joints.pin()
        if pushed:
            self._force[:] = 0.0
        if self._tanks is not None:
            self._let_out(self._tanks, steps * self.platform.step)
        self._stop_diverged(states[:, -1])
        return states

    def _let_out(self, tanks: Tanks, duration: float) -> None:
        """Gas that thrusters have used or that has leaked, and its mass."""
        fired = self._thrust.any()
        if fired:
            tanks.draw(self._thrust, duration)
        if tanks.leaks:
            tanks.leak(duration)
        if fired:
            self._push_with(self._thrust)

    def _lighten(self, tanks: Tanks, lighter: LighterBus, duration: float) -> None:
        """Take off the bus what will have left in the middle of a time of that length."""
        taken = tanks.taken + 0.5 * tanks.flow(self._thrust, duration)
        if not np.array_equal(taken, lighter.used):
            lighter.take(taken)

    def _set_contacts(self, steps: int) -> None:
        platform = self.platform
        if not np.isfinite(platform.stop_angle) or platform.base.kind != "ball":
            return
        attitude = self._qpos[:, self.machine.base_qpos]
        rate = self._qvel[:, self.machine.base_dof]
        reach = 0.5 * self._near / (steps * platform.step)
        if platform.pitch_stop is None:
            lean = np.einsum("ni,ni->n", attitude[:, 1:3], attitude[:, 1:3])
        else:
            lean = np.einsum("ni,i->n", vertical_body(attitude), platform.pitch_stop.axis) ** 2
        speed = np.einsum("ni,ni->n", rate, rate)
        near = (lean > self._guard**2) | (speed > reach**2)
        self._flags[:] = np.where(near, self._model_flags, self._untouched)

    def _sample(self, states: Array) -> None:
        """Let every sensor see the states after the last steps, (n, steps, nq + nv)."""
        steps = states.shape[1]
        times = np.arange(self._done - steps + 1, self._done + 1) * self.platform.step
        valid = None if self._ids is None else self._alive
        for sensor in self._sensors:
            picks = sensor.picks(self._done - steps, steps)
            if sensor.sensor.stream == "gas_pressure" and self._tanks is not None:
                seen = np.repeat(self._tanks.pressure[:, None, None], steps, axis=1)
            else:
                seen = self._truth.measured(sensor.sensor, states, self._before)
            for effect in self._misread:
                if sensor.sensor.stream in effect.reads:
                    seen = seen + effect.error(
                        sensor.sensor.stream,
                        *self._truth.motion(states),
                    )
            if sensor.filtered:
                seen = sensor.low_passed(seen)
            causes = [self._truth.true(e.cause, states)[:, picks] for e in sensor.scatter]
            sensor.measure(seen[:, picks], times[picks], valid, causes)
        count = self._before.shape[1]
        if steps < count:
            states = np.concatenate([self._before[:, steps:], states], axis=1)
        self._before = states[:, -count:]

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
        self.stopped_at[run] = self.time
        self._alive[run] = False
        self._ids = self._living()

    def _living(self) -> NDArray[np.intp]:
        return np.flatnonzero(self._alive)


def _leak(effects: Sequence[Effect], n: int) -> Array:
    """(n,) gas lost beside what thrusters take, of effects for all runs at once [kg/s]."""
    leak = np.zeros(n)
    for effect in effects:
        if isinstance(effect, GasConsumption):
            leak = leak + np.ravel(effect.rate)
    return leak
