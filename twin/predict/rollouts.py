"""A log's machine carried along under its drives: segments side by side, from states of choice."""

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from twin.model import Machine
from twin.predict.drive import Inputs
from twin.predict.motion import Motion
from twin.predict.outputs import Grid
from twin.predict.segments import Segment
from twin.predict.states import States

Array = NDArray[np.float64]

_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL.value)
_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED.value)
STOP_GUARD = np.radians(2.0)
"""A log that stays so far from the tilt stop is predicted without contacts, at half the cost."""


class Rollouts:
    """Of one log on a given grid. Models that are given are changed: their step is the grid's."""

    def __init__(self, machine: Machine, inputs: Inputs, motion: Motion, grid: Grid) -> None:
        self.machine, self.inputs, self.grid = machine, inputs, grid
        self._contacts = _near_stop(machine, motion)
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
        self.start = States(there.position, there.rate, self._velocity[:, wheels])
        """(S, .) as smoothed."""

    def paths(self, model: mujoco.MjModel, start: States, push: Array | None = None) -> States:
        """States along each prediction, (v, S, steps + 1, .), from starts (v, S, .).

        The model is changed: its step is the grid's.

        Args:
            model: the machine's, with the base parameters to try.
            start: of each segment.
            push: (S, steps, nv) generalised force added to the drive.
        """
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
        force = self.force if push is None else self.force + push
        batch = Batch(model, rows)
        batch.bind("qpos")[:] = position
        batch.bind("qvel")[:] = velocity
        run = batch.rollout(
            grid.steps,
            np.tile(np.concatenate([self._control, force], axis=-1), (variants, 1, 1)),
            control_spec=_CONTROL | _FORCE,
            record=("qpos", "qvel"),
        )

        def along(first: Array, rest: Array, columns: slice | NDArray[np.intp]) -> Array:
            values = np.concatenate([first[:, None, columns], rest[:, :, columns]], axis=1)
            return values.reshape(variants, grid.segments, grid.steps + 1, -1)

        wheels = machine.wheel_dof if self.inputs.wheels_predicted else slice(0, 0)
        return States(
            along(position, run["qpos"], machine.base_qpos),
            along(velocity, run["qvel"], machine.base_dof),
            along(velocity, run["qvel"], wheels),
        )

    def onward(
        self,
        model: mujoco.MjModel,
        segments: NDArray[np.intp],
        start: States,
        steps: int,
        push: Array,
    ) -> Array:
        """Positions (r, steps + 1, .) from starts (r, .) of segments, on beyond their ends.

        Args:
            model: as for `paths`.
            segments: (r,) that the starts belong to.
            start: of each.
            steps: how far; the last drive is held where the log ends.
            push: (S, steps, nv) generalised force added to the drive.
        """
        machine, grid = self.machine, self.grid
        self.prepare(model)
        position, velocity = self._position[segments], self._velocity[segments]
        position[:, machine.base_qpos] = start.position
        velocity[:, machine.base_dof] = start.rate
        if self.inputs.wheels_predicted:
            velocity[:, machine.wheel_dof] = start.wheel_speed
        driven = np.concatenate([self._control, self.force + push], axis=-1)
        driven = driven.reshape(-1, model.nu + model.nv)
        place = segments[:, None] * grid.steps + np.arange(steps)
        batch = Batch(model, len(segments))
        batch.bind("qpos")[:] = position
        batch.bind("qvel")[:] = velocity
        run = batch.rollout(
            steps,
            driven[np.minimum(place, len(driven) - 1)],
            control_spec=_CONTROL | _FORCE,
            record=("qpos",),
        )
        first = position[:, None, machine.base_qpos]
        return np.concatenate([first, run["qpos"][:, :, machine.base_qpos]], axis=1)

    def answer(self, model: mujoco.MjModel) -> Array:
        """(S, x, nv) change of the state by a unit impulse on each degree of freedom."""
        machine, k = self.machine, self.start.rate.shape[-1]
        self.prepare(model)
        data = mujoco.MjData(model)
        answer = np.zeros((self.grid.segments, self.start.width, model.nv))
        change = np.zeros((model.nv, model.nv))
        for s in range(self.grid.segments):
            data.qpos[:] = self._position[s]
            data.qpos[machine.base_qpos] = self.start.position[s]
            mujoco.mj_forward(model, data)
            mujoco.mj_solveM(model, data, change, np.eye(model.nv))
            answer[s, k : 2 * k] = change.T[machine.base_dof]
            if self.inputs.wheels_predicted:
                answer[s, 2 * k :] = change.T[machine.wheel_dof]
        return answer

    def prepare(self, model: mujoco.MjModel) -> None:
        self.inputs.prepare(model)
        model.opt.timestep = self.grid.step
        if not self._contacts:
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def _near_stop(machine: Machine, motion: Motion) -> bool:
    """Whether the log comes near the stop."""
    platform = machine.platform
    if platform.base.kind != "ball":
        return True
    return float(platform.lean(motion.position).max()) > platform.stop_angle - STOP_GUARD
