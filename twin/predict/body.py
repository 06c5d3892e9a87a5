"""The body predictor: one log, cut into segments that are predicted side by side in batches.

Each segment starts from a state of its own. What the prediction depends on (those states, the base,
the sensors' biases) is linearised along the path. That a segment ends where the next one starts is
kept as an equation (multiple shooting), so the segments lose nothing against one long prediction,
which an unstable machine would not allow. A sensor scatters more while something moves, as its
platform states it.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.effects import ScatterEffect
from twin.errors import UsageError
from twin.model import Machine
from twin.platform import field_world, floor_log
from twin.predict.base import BaseParameters, base_forces
from twin.predict.inputs import Inputs, felt, pressure, pushed
from twin.predict.kalman import Linearised, Local
from twin.predict.logs import Motion, check_within_stop
from twin.predict.profiles import random_walk, wander
from twin.predict.response import command_step, grid_of
from twin.predict.rollouts import Rollouts
from twin.predict.sensors import Cells, Sense, StepGrid, digits_of, outputs_of, senses_of
from twin.predict.states import STEP, PathForces, States, carried_forces
from twin.recording import Recording, Series
from twin.signals import DERIVED

Array = NDArray[np.float64]
SHOWN = {
    "hinge": ("joint_angle", "joint_rate"),
    "planar": ("position", "heading", "velocity", "heading_rate"),
}
"""Streams that are a part of the state; of any other base an attitude and a gyro."""
POSITIONS = ("attitude", "joint_angle", "position", "heading")
"""Those that show where the base stands."""
CHANGED = 0.005
"""Share by which a noise must differ from what it was taken to be, for a fit to be done again."""
EXACT = 0.1
"""By how many of its standard deviations a longer step may move an estimate at the very most."""


def _shares(machine: Machine) -> Array:
    """(k,) of a disturbance's torque that acts on each degree of freedom of the base.

    A force on a machine on a floor, which comes with a torque, is that over its radius of gyration.
    """
    platform = machine.platform
    if platform.base.kind != "planar":
        return np.ones(machine.base_dof.stop - machine.base_dof.start)
    return np.array([np.sqrt(platform.mass / platform.inertia[2, 2])] * 2 + [1.0])


def added_variance(effect: ScatterEffect, inputs: Inputs, time: Array) -> Array:
    """(m, 1) or (m, k) of its sensor at some instants (m,) [s]."""
    _, velocity, _ = inputs.joint_states(time)
    cause = velocity[:, inputs.machine.stage_dof]
    return np.square(effect.sigma(cause[None], inputs.machine.platform))[0]


def shaking(inputs: Inputs, senses: Mapping[str, Sense], stream: str, time: Array) -> Array | None:
    """(m, 1) or (m, k) variance of it all; None where nothing shakes a stream."""
    every = [effect for effect in inputs.machine.effects if isinstance(effect, ScatterEffect)]
    parts = [added_variance(effect, inputs, time) for effect in every if effect.acts_on == stream]
    sense, doubt = senses.get(stream), inputs.stage_doubt
    if sense is not None and sense.feels_turning and doubt is not None:
        pull = felt(inputs.machine, doubt, sense.site, time)
        tilted = pull[:, 1::-1] / sense.gravity**2
        parts.append(pull if stream == "accelerometer" else tilted)
    return np.asarray(sum(parts)) if parts else None


@dataclass(frozen=True)
class Exact:
    """A prediction linearised as if the motion were exact, and how noise in it would travel."""

    linear: Linearised
    local: Local
    path: States
    """(1, S, steps + 1, .)."""
    answer: Array
    """(S, steps or 1, x, nv) change of a state by a unit impulse on each degree of freedom, a unit
    turn of each gimbal."""


class Body:
    """Predicts one log of a machine on a given grid; see `body_of`.

    Raises:
        UsageError: the log has no stream that this machine's model predicts.
    """

    def __init__(
        self, machine: Machine, recording: Recording, motion: Motion, grid: StepGrid
    ) -> None:
        if machine.platform.base.kind == "planar":
            recording = floor_log(recording)
        field = field_world(recording, machine.platform)
        here = replace(machine.platform, step=grid.step, magnetic_field=field)
        self.machine = replace(machine, platform=here)
        self.recording = recording
        self.motion = motion
        self.predicted: States | None = None
        self.pushes: Mapping[str, Array] | None = None
        self.inputs = Inputs(self.machine, recording)
        self.grid = grid
        senses = senses_of(machine, grid.step, self.inputs.field_world)
        told = self._command_streams()
        streams = tuple(dict.fromkeys((*self._predicted(), *senses, *told)))
        self.outputs, width = outputs_of(
            recording,
            self.machine,
            self.grid,
            streams,
            senses,
            self.inputs.stage_course,
            told,
            partial(shaking, self.inputs, senses),
        )
        if not self.outputs:
            raise UsageError(
                f"the log has none of the streams that {machine.platform.name} predicts: "
                + ", ".join(streams)
            )
        self.cells = Cells.of(self.outputs, self.grid, width)
        self._wanderers = np.concatenate([machine.wheel_dof, machine.gimbal_dof])
        self.rollouts = Rollouts(self.machine, self.inputs, motion, grid)
        self.start = self.rollouts.start
        # Of the machine as stated: if its answer to noise were fitted too, a base ten times as
        # heavy, pushed ten times as hard, would explain what a model lacks just as well.
        stated = copy.copy(machine.model)
        self._pushed = self.rollouts.answer(stated)[:, 0][..., machine.base_dof] * _shares(machine)
        self._wander = np.concatenate(self._walks())

    def following(self, path: States, pushes: Mapping[str, Array] | None = None) -> "Body":
        """The same log; what acts along its motion does so along a prediction (1, S, steps + 1, .).

        A prediction that a fit has settled is free of the sensors' noise and constant errors, which
        a smoothed reading has, and keeps what smoothing takes out.

        Args:
            path: the prediction.
            pushes: (S, steps, nv) what perturbations have pushed it with, by name, where nothing
                else makes it differ from the model's; None where the logs have drawn it to them.
        """
        following = copy.copy(self)
        following.predicted = path
        following.pushes = pushes
        return following

    def with_noise_of(self, residuals: Sequence[Array]) -> "Body":
        """The same log, its noise found again in what a prediction leaves; itself where it is as
        large as it was taken to be.

        Args:
            residuals: (m, k) of each output.
        """
        outputs = tuple(
            o.with_noise_of(part) for o, part in zip(self.outputs, residuals, strict=True)
        )
        pairs = zip(outputs, self.outputs, strict=True)
        if all(np.allclose(new.noise, old.noise, rtol=CHANGED, atol=0.0) for new, old in pairs):
            return self
        known = copy.copy(self)
        known.outputs = outputs
        known._wander = np.concatenate(known._walks())
        return known

    @property
    def samples(self) -> int:
        """Numbers predicted whose residuals are noise of a known size."""
        return sum(output.slot.size for output in self.outputs if output.scatters)

    @property
    def bias_scale(self) -> Array:
        """(b,) 1 sigma of the sensors' constant errors, those that have one, output by output."""
        return np.concatenate([o.bias[o.bias > 0.0] for o in self.outputs])

    @property
    def bias_names(self) -> tuple[str, ...]:
        """Of the same."""
        return tuple(
            f"{o.stream} {column}"
            for o in self.outputs
            for column, size in zip(o.columns, o.bias, strict=True)
            if size > 0.0
        )

    @property
    def not_predicted(self) -> tuple[str, ...]:
        """Measured streams of the recording that have no part in the prediction."""
        taken = {output.stream for output in self.outputs} | set(self.inputs.used)
        return tuple(
            name for name in self.recording if name not in taken and not name.startswith(DERIVED)
        )

    @property
    def begins(self) -> Array:
        """(S, steps) at which the steps begin [s]."""
        return self.grid.begins

    def commanded(self, late: float = 0.0) -> Array:
        """(S, steps, nv) torques of the commands, as if they acted so much later [s]."""
        force = self.inputs.commanded(self.grid.edges - late, self.motion)
        return force.reshape(self.grid.segments, self.grid.steps, -1)

    def along(
        self, base: BaseParameters, theta: Array, start: States, push: PathForces | None = None
    ) -> Exact:
        """Predict from `start` (S, .) under a base and an added force; only the states are columns.

        Raises:
            TwinError: no rigid body has such a base.
        """
        x = start.width
        model = base.model(theta)
        path, carried = self.rollouts.around(model, start, push)
        rows, ends = self.rows(path), self._ends(path, start)
        linear = Linearised(
            rows[0],
            np.moveaxis(rows[1:] - rows[0], 0, -1) / STEP,
            np.zeros((*rows[0].shape, 0)),
            ends[0],
            np.moveaxis(ends[1:] - ends[0], 0, -1) / STEP,
            np.zeros((*ends[0].shape, 0)),
            np.zeros((len(ends[0]), x, x)),
            np.zeros(x),
        )
        answer = self.rollouts.answer(model)
        return Exact(linear, self._local(path[:1], carried, answer), path[:1], answer)

    def linearise(
        self,
        base: BaseParameters,
        theta: Array,
        biases: Array,
        start: States,
        push: PathForces | None = None,
    ) -> Exact:
        """Predict from `start` (S, .) under a base and an added force, and linearise.

        The shared unknowns are changes of theta and of the biases.

        Raises:
            TwinError: no rigid body has such a base.
        """
        exact = self.along(base, theta, start, push)
        linear = exact.linear
        linear = replace(
            linear,
            residual=linear.residual + self.bias_columns() @ biases,
        )
        forces = base_forces(base, exact.path, self.grid.step)
        linear = linear.with_columns(*self.force_columns(exact, forces))
        return replace(exact, linear=linear.with_columns(self.bias_columns()))

    def without(self, base: BaseParameters, exact: Exact, push: PathForces) -> Exact:
        """With the base's columns as they are where a push turns the body as it does whatever its
        J: a heavier body under more of it moves the same."""
        k = exact.path.rate.shape[-1]
        force = push.along(self.machine, exact.path, self.begins)
        turned = np.einsum("snkf,snf->snk", exact.answer[:, :, k : 2 * k], force)
        forces = base_forces(base, exact.path, self.grid.step, turned)
        columns, jumps = self.force_columns(exact, forces)
        return replace(exact, linear=exact.linear.with_first(columns, jumps))

    def force_columns(self, exact: Exact, forces: Array) -> tuple[Array, Array]:
        """What forces (S, steps, nv, a) do: d residual (S, N, a), d segment's end (S - 1, x, a).

        On a gimbal's joint stands its rate beside the one that it was driven with [rad/s].
        """
        change = carried_forces(exact.local.carried, exact.answer, forces, self.grid.step)
        return self.columns_of(exact, change)

    def columns_of(self, exact: Exact, change: Array) -> tuple[Array, Array]:
        """What changes (S, steps + 1, x, a) of the state do, as `force_columns`."""
        parts = [
            np.moveaxis(o.moved_by(change, self._first(o.stream), exact.path), -1, 0)
            for o in self.outputs
        ]
        return np.moveaxis(self.cells.scatter(parts), 0, -1), change[:-1, -1]

    def nominal(self, model: mujoco.MjModel) -> list[Array]:
        """Residuals (m, k) of each output under a model, from the smoothed starts."""
        path = self.rollouts.paths(model, self.start.batched())
        return [output.residual(path, self.grid.step)[0] for output in self.outputs]

    def rows(self, path: States) -> Array:
        """Residuals of v paths, (v, S, N)."""
        parts = [output.residual(path, self.grid.step) for output in self.outputs]
        return self.cells.scatter(parts)

    def bias_columns(self) -> Array:
        """(S, N, b) d residual / d bias."""
        columns: list[Array] = []
        for index, output in enumerate(self.outputs):
            for column in np.flatnonzero(output.bias > 0.0):
                parts = [np.zeros((1, *o.slot.shape)) for o in self.outputs]
                parts[index][0, :, column] = -1.0 / output.sigma[:, column]
                columns.append(self.cells.scatter(parts)[0])
        if not columns:
            return np.zeros((self.grid.segments, self.cells.count, 0))
        return np.stack(columns, axis=-1)

    def _local(self, path: States, carried: Array, answer: Array) -> Local:
        grid, x = self.grid, path.width
        measured = np.zeros((grid.segments, self.cells.count, x))
        for output, (segment, row) in zip(self.outputs, self.cells.places, strict=True):
            late = (output.place - output.instant) * grid.step
            if output.told is not None:
                continue
            if output.sense is not None:
                slope = output.sense.slope(path)
                seen = slope[output.segment, output.instant] / output.sigma[..., None]
                measured[segment, row, : seen.shape[-1]] = seen
                continue
            for column, sigma in enumerate(output.sigma.T):
                at = (output.segment, row[:, column])
                measured[(*at, self._first(output.stream) + column)] = 1.0 / sigma
                if output.stream in POSITIONS:
                    k = path.rate.shape[-1]
                    measured[(*at, k + self._first(output.stream) + column)] = late / sigma
        noise, drift = wander(
            answer[..., self._wanderers], self.rollouts.unexplained, self._wander, grid.step
        )
        doubt = self.inputs.stage_doubt
        if doubt is not None and self.machine.platform.base.kind == "ball":
            push = pushed(self.machine, doubt, self.begins, path.position[0, :, :-1])
            turned = answer[..., self.machine.base_dof]
            noise = noise + turned @ (grid.step * push) @ turned.swapaxes(-1, -2)
        row = self.cells.row
        driven = grid.step * self._pushed[:, None]
        errors = self._errors()
        return Local(measured, row, carried, self._pushed, grid.step, noise, drift, driven, errors)

    def _errors(self) -> dict[str, Array]:
        """(S, N, k) d(measured / noise) / d error of each column of a sensor of the motion."""
        result: dict[str, Array] = {}
        for output, (segment, row) in zip(self.outputs, self.cells.places, strict=True):
            if output.told is not None or output.stream in ("wheel_speed", "gimbal_angle"):
                continue
            columns = output.sigma.shape[1]
            seen = np.zeros((self.grid.segments, self.cells.count, columns))
            for column, sigma in enumerate(output.sigma.T):
                seen[segment, row[:, [column]], column] = 1.0 / sigma[:, None]
            result[output.stream] = seen
        return result

    def _walks(self) -> tuple[Array, Array]:
        """Intensities of what nobody recorded: (wheels,) of torques on them [(N m)^2 s], (gimbals,)
        of rates beside the commanded ones [rad^2/s]."""
        machine = self.machine
        wheels, gimbals = np.zeros(len(machine.wheel_dof)), np.zeros(len(machine.gimbal_dof))
        for output in self.outputs:
            if output.stream == "wheel_speed" and self.inputs.wheels_undriven:
                rotor = np.array([wheel.inertia for wheel in machine.platform.wheels])
                series = self.recording[output.stream]
                digits = digits_of(series, machine.platform, output.stream)
                walk = random_walk(series, output.noise, digits)
                wheels = np.square(rotor) * walk
            if output.stream == "gimbal_angle" and self.inputs.gimbal_error is not None:
                seen = self.recording[output.stream]
                digits = digits_of(seen, machine.platform, output.stream)
                gimbals = random_walk(self.inputs.gimbal_error, output.noise, digits)
        return wheels, gimbals

    def _first(self, stream: str) -> int:
        """Where the numbers that a stream measures stand in a state."""
        k = self.start.rate.shape[-1]
        gimbals = 2 * k + self.start.wheel_speed.shape[-1]
        places = {"wheel_speed": 2 * k, "gimbal_angle": gimbals, "heading_rate": k + 2}
        places |= dict.fromkeys(POSITIONS, 0) | {"heading": 2}
        return places.get(stream, k)

    def _ends(self, path: States, start: States) -> Array:
        """(v, S - 1, x) where segments end, seen from the starts of the next."""
        return path[:, :-1, -1].less(start[1:])

    def _predicted(self) -> tuple[str, ...]:
        wheels = ("wheel_speed",) if self.inputs.wheels_predicted else ()
        base = SHOWN.get(self.machine.platform.base.kind, ("attitude", "gyro"))
        return (*base, *wheels, "gimbal_angle")

    def _command_streams(self) -> dict[str, Series]:
        """Streams that follow from the commands alone, and how they should be."""
        platform, inputs, edges = self.machine.platform, self.inputs, self.grid.edges
        result: dict[str, Series] = {}
        if inputs.stage_course is not None and "stage_position" in platform.sensors:
            result["stage_position"] = inputs.stage_course.place
        left = pressure(platform, edges, inputs.thrust(edges))
        if left is not None and "command_thruster" in inputs.used:
            result["gas_pressure"] = left
        return result


def body_of(machine: Machine, recording: Recording, motion: Motion) -> Body:
    """The predictor of a log, on the longest step that predicts as well as half of it.

    Commands change between steps, not within them, and the step is at most 25 ms; where halving it
    could move an estimate by more than a tenth of its standard deviation, it is the platform's.

    Raises:
        UsageError: the log leans beyond the machine's stop.
    """
    check_within_stop(recording, machine.platform, motion)
    step = command_step(machine, recording)
    grid = grid_of(machine, recording, motion, step)
    coarse = Body(machine, recording, motion, grid)
    if step <= machine.platform.step:
        return coarse
    halved = replace(grid, step=0.5 * step, steps=2 * grid.steps)
    fine = Body(machine, recording, motion, halved)
    model = copy.copy(machine.model)
    both = zip(coarse.outputs, fine.outputs, strict=True)
    pairs = zip(coarse.nominal(model), fine.nominal(model), both, strict=True)
    for item, other, (at, too) in pairs:
        # a sample at the log's very edge may belong to one grid only
        change = item[np.isin(at.time, too.time)] - other[np.isin(too.time, at.time)]
        if float(np.sum(np.square(change))) > EXACT**2:
            return Body(
                machine,
                recording,
                motion,
                grid_of(machine, recording, motion, machine.platform.step),
            )
    return coarse
