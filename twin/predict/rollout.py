"""Predict a log: from initial states, under its commands, in batches of segments.

One `mujoco.batch.Batch` a model predicts all segments with any number of disturbed initial states
and added torques; that is what a fit differentiates and a diagnosis screens with.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from twin import rotation
from twin.errors import UsageError
from twin.model import Machine
from twin.predict.drive import Inputs
from twin.predict.motion import Motion, noise_of
from twin.predict.segments import Segment
from twin.recording import Recording, Series

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_FORCE = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED.value)


@dataclass(frozen=True)
class Output:
    """A measured stream that the prediction is held against."""

    stream: str
    series: Series
    noise: Array
    """(k,) 1 sigma a sample; of attitudes [rad]."""
    stated: bool
    """Whether the noise is the log's own statement or estimated from its data."""
    biased: bool
    """Whether platform.toml says that this sensor has a constant error."""

    @property
    def width(self) -> int:
        """Columns of its residual."""
        return len(self.noise)


@dataclass(frozen=True)
class _Samples:
    """Rows of one output within one segment, and where they lie on the physics grid."""

    time: Array
    value: Array
    step: Index
    fraction: Array


class Predictor:
    """Predicts the measured streams of one recording, segment by segment.

    A row of a prediction is a segment, a change of its initial state and an added torque. The
    initial state's change is (angle or rotation vector, rate, wheel speeds where these are
    predicted), `state_width` numbers.

    Raises:
        UsageError: the recording has no stream that this machine's model predicts.
    """

    def __init__(
        self,
        machine: Machine,
        recording: Recording,
        motion: Motion,
        segments: tuple[Segment, ...],
    ) -> None:
        self.machine = machine
        self.recording = recording
        self.motion = motion
        self.segments = segments
        self.inputs = Inputs(machine, recording)
        self.outputs = self._outputs()
        if not self.outputs:
            raise UsageError(
                f"the log has none of the streams that {machine.platform.name} predicts: "
                + ", ".join(self._predicted())
            )
        self._drives = [self.inputs.drive(segment) for segment in segments]
        self.steps = max(len(drive.force) for drive in self._drives)
        begin = motion.at(np.array([segment.start for segment in segments]))
        self._position, self._rate = begin.position, begin.rate
        self._samples = [
            [self._locate(output, segment) for output in self.outputs] for segment in segments
        ]

    @property
    def base_width(self) -> int:
        """Degrees of freedom of the base joint."""
        return self._rate.shape[1]

    @property
    def state_width(self) -> int:
        """Numbers that change an initial state."""
        wheels = len(self.machine.wheel_dof) if self.inputs.wheels_predicted else 0
        return 2 * self.base_width + wheels

    @property
    def not_predicted(self) -> tuple[str, ...]:
        """Measured streams of the recording that have no part in the prediction."""
        taken = {output.stream for output in self.outputs} | set(self.inputs.used)
        ours = ("truth_", "estimate_", "reference_", "wanted_", "command_")
        return tuple(
            name for name in self.recording if name not in taken and not name.startswith(ours)
        )

    def edges(self, segment: int) -> Array:
        """Beginnings and end of the physics steps of a segment, (steps + 1,) [s]."""
        return self.segments[segment].edges(self.machine.platform.step, self.steps)

    def predict(
        self,
        model: mujoco.MjModel,
        rows: Index,
        change: Array,
        torque: Array | None = None,
    ) -> list[Array]:
        """Residuals (measured - predicted) / noise of each row, flat: stream by stream.

        Args:
            model: the machine's model with the base parameters to try.
            rows: (r,) the segment of each row.
            change: (r, state_width) of the initial state.
            torque: (r, steps, base_width) added to the base joint [N m].
        """
        qpos, qvel = self.rollout(model, rows, change, torque)
        return [
            self._residual(int(segment), qpos[row], qvel[row]) for row, segment in enumerate(rows)
        ]

    def rollout(
        self,
        model: mujoco.MjModel,
        rows: Index,
        change: Array,
        torque: Array | None = None,
    ) -> tuple[Array, Array]:
        """qpos (r, steps + 1, nq) and qvel (r, steps + 1, nv) of each row, arguments as above."""
        machine = self.machine
        self.inputs.prepare(model)
        start_position, start_velocity = self._start(rows, change)
        force = np.zeros((len(rows), self.steps, model.nv))
        for row, segment in enumerate(rows):
            drive = self._drives[segment].force
            force[row, : len(drive)] = drive
        if torque is not None:
            force[:, :, machine.base_dof] += torque
        batch = Batch(model, len(rows))
        batch.bind("qpos")[:] = start_position
        batch.bind("qvel")[:] = start_velocity
        run = batch.rollout(self.steps, force, control_spec=_FORCE, record=("qpos", "qvel"))
        return (
            np.concatenate([start_position[:, None], run["qpos"]], axis=1),
            np.concatenate([start_velocity[:, None], run["qvel"]], axis=1),
        )

    def _start(self, rows: Index, change: Array) -> tuple[Array, Array]:
        base, machine = self.base_width, self.machine
        position = np.stack([self._drives[row].joint_position for row in rows])
        velocity = np.stack([self._drives[row].joint_velocity for row in rows])
        if base == 1:
            position[:, machine.base_qpos] = self._position[rows] + change[:, :1]
        else:
            turn = rotation.from_rotation_vector(change[:, :3])
            position[:, machine.base_qpos] = rotation.multiply(self._position[rows], turn)
        velocity[:, machine.base_dof] = self._rate[rows] + change[:, base : 2 * base]
        if self.inputs.wheels_predicted:
            velocity[:, machine.wheel_dof] += change[:, 2 * base :]
        return position, velocity

    def bias_columns(self, segment: int) -> Array:
        """d residual / d(bias) of a segment, one column for each column of a biased sensor."""
        biased = [output for output in self.outputs if output.biased]
        blocks: list[Array] = []
        first = 0
        for output, samples in zip(self.outputs, self._samples[segment], strict=True):
            count = len(samples.time)
            block = np.zeros((count * output.width, sum(o.width for o in biased)))
            if output.biased:
                columns = slice(first, first + output.width)
                block[:, columns] = np.tile(-np.diag(1.0 / output.noise), (count, 1))
                first += output.width
            blocks.append(block)
        return np.concatenate(blocks)

    def split(self, segment: int, residual: Array) -> dict[str, tuple[Array, Array]]:
        """Times (m,) and residuals (m, k) [SI] of each stream from a flat residual."""
        parts: dict[str, tuple[Array, Array]] = {}
        first = 0
        for output, samples in zip(self.outputs, self._samples[segment], strict=True):
            count = len(samples.time) * output.width
            values = residual[first : first + count].reshape(-1, output.width) * output.noise
            parts[output.stream] = (samples.time, values)
            first += count
        return parts

    def _residual(self, segment: int, qpos: Array, qvel: Array) -> Array:
        parts: list[Array] = []
        for output, samples in zip(self.outputs, self._samples[segment], strict=True):
            predicted = self._output(output.stream, samples, qpos, qvel)
            if output.stream == "attitude":
                error = rotation.multiply(rotation.conjugate(predicted), samples.value)
                difference = rotation.to_rotation_vector(error)
            else:
                difference = samples.value - predicted
            parts.append((difference / output.noise).ravel())
        return np.concatenate(parts)

    def _output(self, stream: str, samples: _Samples, qpos: Array, qvel: Array) -> Array:
        machine, step, part = self.machine, samples.step, samples.fraction[:, None]
        if stream == "wheel_speed":
            rates = qvel[:, machine.wheel_dof]
            return rates[step] + part * (rates[step + 1] - rates[step])
        rate = qvel[:, machine.base_dof]
        if stream in ("gyro", "joint_rate"):
            return rate[step] + part * (rate[step + 1] - rate[step])
        position = qpos[:, machine.base_qpos]
        before, after = position[step], position[step + 1]
        if stream == "attitude":
            return rotation.normalized(before + part * (after - before))
        period = machine.platform.step
        # cubic through both angles and both rates
        rise = after - before
        bend = rate[step] * period - rise
        twist = rise - rate[step + 1] * period
        return before + part * rise + part * (1.0 - part) * (bend * (1.0 - part) + twist * part)

    def _locate(self, output: Output, segment: Segment) -> _Samples:
        series, last = output.series, segment == self.segments[-1]
        stop = np.nextafter(segment.stop, np.inf) if last else segment.stop
        cut = series.between(segment.start, stop)
        place = (cut.time - segment.start) / self.machine.platform.step
        step = np.clip(place.astype(np.intp), 0, self.steps - 1)
        return _Samples(cut.time, cut.value, step, place - step)

    def _predicted(self) -> tuple[str, ...]:
        if self.machine.platform.base.kind == "hinge":
            return ("joint_angle", "joint_rate")
        wheels = ("wheel_speed",) if self.inputs.wheels_predicted else ()
        return ("attitude", "gyro", *wheels)

    def _outputs(self) -> tuple[Output, ...]:
        facts = self.recording.provenance.get("streams", {})
        outputs: list[Output] = []
        for name in self._predicted():
            if name not in self.recording or len(self.recording[name]) < 4:
                continue
            series = self.recording[name]
            stated = facts.get(name, {}).get("noise")
            estimated = noise_of(series)
            noise = estimated if stated is None else np.broadcast_to(stated, estimated.shape)
            sensor = self.machine.platform.sensors.get(name)
            biased = sensor is not None and bool(np.any(sensor.bias > 0.0))
            outputs.append(
                Output(
                    name,
                    series,
                    np.asarray(noise, dtype=np.float64),
                    stated=stated is not None,
                    biased=biased,
                )
            )
        return tuple(outputs)
