"""Inputs of a prediction: held commands and measured joints, as forces on the physics grid.

There is no command before the first one; each holds until the next, the last one to the end. A
stage that follows its command is where its drive's profile says. A stage that is only seen at its
readings, a few in a move, is interpolated, and the gravity torque of its error is white noise. The
reading of a tank's gauge follows from the commands of the thrusters.
"""

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import exprel

from twin import rotation
from twin.drives import apply_field
from twin.effects import Effect
from twin.errors import UsageError
from twin.model import Machine
from twin.noise import noise_of
from twin.plant.forces import STANDARD_GRAVITY, thruster_arms, thruster_pushes
from twin.plant.limits import Limits
from twin.platform import Platform, Sensor, begins_late, field_world
from twin.predict.logs import Motion, smoothed_series
from twin.predict.profiles import Course, less_drive_faults, profile
from twin.predict.response import Segment
from twin.recording import Recording, Series

Array = NDArray[np.float64]
RESTED = 0.5
"""A mass whose drive has not moved it for so long has come to rest, and been read there [s]."""
STILL = 1e-9
"""To which it has not [m]."""
FREE = 1.3
"""Scatter of a wheel's speed against inertial space, of the noise of its reading, up to which no
motor turned it."""


def as_commanded(recording: Recording, stream: str) -> Series:
    """A command from the motion's start to the log's end, where it has few rows or late ones."""
    series = recording[stream]
    late = begins_late(recording, stream)
    if late:
        none = np.zeros((1, series.value.shape[1]))
        time = np.r_[series.time[0] - late, series.time]
        series = replace(series, time=time, value=np.concatenate([none, series.value]))
    if len(series) and series.time[-1] < recording.stop and (late or len(series) == 1):
        time = np.r_[series.time, recording.stop]
        value = np.concatenate([series.value, series.value[-1:]])
        series = replace(series, time=time, value=value)
    return series


def _turn_freely(recording: Recording, platform: Platform) -> bool:
    """Whether no motor turned the wheels of a log that has no command of them: with the body's turn
    their speeds against inertial space are constant."""
    fixed = all(wheel.gimbal is None for wheel in platform.wheels)
    if platform.base.kind != "ball" or not fixed or "gyro" not in recording:
        return False
    speed, gyro = recording["wheel_speed"], recording["gyro"]
    inside = (speed.time >= gyro.time[0]) & (speed.time <= gyro.time[-1])
    if np.count_nonzero(inside) < 10 or gyro.value.shape[1] != 3:
        return False
    axes = np.array([wheel.axis for wheel in platform.wheels])
    spin = speed.value[inside] + gyro.interpolated_at(speed.time[inside]) @ axes.T
    return bool(np.all(np.std(spin, axis=0) < FREE * noise_of(speed)))


def pressure(platform: Platform, edges: Array, thrust: Array) -> Series | None:
    """Pressure [Pa] from full tanks at constant temperature; None of a machine without any.

    How full they were is an error of the gauge, as large as their pressure may be.

    Args:
        platform: whose tanks they are.
        edges: (m + 1,) of the steps [s].
        thrust: (m, thrusters) mean force between them [N].
    """
    gas = platform.gas
    if gas is None:
        return None
    taken = np.sum(thrust, axis=1) * np.diff(edges) / (gas.specific_impulse * STANDARD_GRAVITY)
    left = 1.0 - np.concatenate([[0.0], np.cumsum(taken)]) / gas.mass
    return Series(edges, gas.pressure * left[:, None], ("value",), "Pa")


def travelled(series: Series, sensor: Sensor | None, time: Array) -> tuple[Series, Series]:
    """A position, smoothed where that takes no more than noise away, and its rate.

    A mass that stays 1 um off after a move turns a table, so the rate's trapezoids add up to the
    position: both are had from a spline half a step before and half a step after, of which the sums
    leave no more than the ends.

    Args:
        series: readings, their stamps as they come.
        sensor: that took them.
        time: (m,) at which both are given, a physics step apart [s].
    """
    smooth = smoothed_series(series)[0]
    lost = np.sqrt(np.mean(np.square(series.value - smooth.interpolated_at(series.time)), axis=0))
    # A counter's noise cannot be told from its moves: that of a command is none.
    noise = 0.0 if sensor is None else np.hypot(sensor.noise, sensor.resolution / np.sqrt(12.0))
    place = smooth if np.all(lost <= 3.0 * noise) else series
    spline = CubicSpline(place.time, place.value, bc_type="natural")
    step = float(time[1] - time[0])
    edges = np.append(time - 0.5 * step, time[-1] + 0.5 * step)
    there = spline(np.clip(edges, place.time[0], place.time[-1]))
    value, rate = 0.5 * (there[1:] + there[:-1]), np.diff(there, axis=0) / step
    return (
        Series(time, value, place.columns, place.unit),
        Series(time, rate, place.columns, f"{place.unit}/s"),
    )


def between_readings(error: Series, rounding: float) -> Series:
    """How well positions are known after each reading: their variance times how long it lasts.

    What a straight line through its neighbours misses a reading by is twice what one through the
    readings misses at a bend; it is taken as it is, since the axes of a line are read one after the
    other, and are stamped together.

    Args:
        error: readings (m, stages) beside the course that the stages were told to take [m].
        rounding: of a reading [m]; what strays no farther than twice that is known.

    Returns:
        (m, stages) [m^2 s].
    """
    time, value = error.time, error.value
    missed = np.zeros_like(value)
    if len(time) > 2:
        share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
        missed[1:-1] = np.abs(value[1:-1] - (1.0 - share) * value[:-2] - share * value[2:])
    missed[missed <= 2.0 * rounding] = 0.0
    after = np.maximum(missed, np.concatenate([missed[1:], missed[-1:]]))
    lasting = np.diff(time, append=time[-1:])[:, None]
    return Series(time, np.square(after) * lasting, error.columns, "m^2 s")


def pushed(machine: Machine, doubt: Series, begins: Array, attitude: Array) -> Array:
    """Intensity (S, steps, 3, 3) of the torque on a base by what is not known [(N m)^2 s].

    Args:
        machine: compiled.
        doubt: as `between_readings` has it.
        begins: (S, steps) at which the steps begin [s].
        attitude: (S, steps, 4).
    """
    moved = np.einsum("b,bsi->si", machine.sliding.mass, machine.sliding.travel)
    gravity = machine.platform.gravity * rotation.vertical_body(attitude)
    torque = rotation.cross(moved, gravity[..., None, :])
    variance = doubt.held_at(begins.ravel()).reshape(*begins.shape, -1)
    return np.einsum("snki,snk,snkj->snij", torque, variance, torque)


def felt(machine: Machine, doubt: Series, site: Array, time: Array) -> Array:
    """Variance (m, 3) of what a sensor at a site feels of stages' unknown pulls [(m/s^2)^2].

    Their drives pull with all their acceleration, or do not, and the body turns against it.

    Args:
        machine: compiled.
        doubt: as `between_readings` has it.
        site: (3,) from the CR, body axes [m].
        time: (m,) of the sensor's samples [s].
    """
    sliding = machine.sliding
    momentum = rotation.cross(sliding.home[:, None], sliding.travel)
    pull = np.array([stage.acceleration for stage in machine.platform.stages])
    torque = pull[:, None] * np.einsum("b,bsi->si", sliding.mass, momentum)
    turning = np.linalg.solve(machine.platform.inertia, torque.T).T
    unknown = (doubt.held_at(time) > 0.0).astype(np.float64)
    return unknown @ np.square(rotation.cross(turning, site))


@dataclass(frozen=True)
class Drive:
    """Of one segment, on the physics grid that starts with it."""

    force: Array
    """(steps, nv) generalised forces, constant over each step [N m, N]."""
    control: Array
    """(steps, nu) of MuJoCo's actuators: the moments of coils [A m^2], and on a base that floats
    away the forces of thrusters [N]; the others' are 0."""
    joint_position: Array
    """(nq,) where the joints that are not the base start; the base's entries are 0."""
    joint_velocity: Array
    """(nv,) likewise."""


class Inputs:
    """The drives of a recording.

    Commands hold from their stamp to the next; a step in which one changes gets the mean over the
    step, so that the impulse is exact. A wheel is driven by its commanded torque where that was
    recorded, or by its commanded duty: that share of its torque limit is what its motor gives at
    rest, and the damping of its joint is what its back EMF takes. Its speed is then a state,
    measured or not. Where only its speed was recorded, it is a state all the same, under a torque
    of which nothing is known but its size; the smoothed reading only says along which path to
    linearise. A stage follows its measured position, between its samples the drive's profile. Coils
    turn the body in the field as MuJoCo has its attitude, thrusters push at their arms; the gas
    that they take is a force along the path (`forces.py`). The angle of a gimbal is a state: it
    goes at the commanded rate, else at one of which nothing is known but its size. Rotors keep
    their speed.
    """

    def __init__(self, machine: Machine, recording: Recording) -> None:
        self.machine = machine
        self.model = machine.model
        self.used: tuple[str, ...] = ()
        platform = machine.platform
        _refuse_what_is_not_predicted(platform)
        self._joint = self._stream(recording, "command_joint_torque", 1)
        self._wheel_torque = self._stream(recording, "command_wheel_torque", len(platform.wheels))
        if self._wheel_torque is None:
            duty = self._stream(recording, "command_wheel_duty", len(platform.wheels))
            self._wheel_torque = None if duty is None else self._torque_at_rest(duty)
        self._wheel_speed: tuple[Series, Series] | None = None
        speed = self._stream(recording, "wheel_speed", len(platform.wheels))
        if speed is not None:
            self._wheel_speed = smoothed_series(speed)
        elif self._wheel_torque is not None:
            self._wheel_speed = self._unmeasured(self._wheel_torque, recording)
        if speed is not None and self._wheel_torque is None and _turn_freely(recording, platform):
            self._wheel_torque = replace(speed, value=np.zeros_like(speed.value), unit="N m")
        self._dipole = self._stream(recording, "command_dipole", 3 * bool(platform.magnetorquers))
        self._thrust = self._stream(recording, "command_thruster", len(platform.thrusters))
        self.field_world = field_world(recording, platform)
        """(3,) the field that the coils feel [T]."""
        self.stage_course: Course | None = None
        """Of stages that were told to move, and seen."""
        self.stage_doubt: Series | None = None
        """(m, stages) of where they were after each reading, if not on that course [m^2 s]."""
        self._stage = self._stages(recording)
        width = len(platform.gimbals)
        self._gimbal_told = self._stream(recording, "command_gimbal_rate", width)
        self._gimbal_seen = self._stream(recording, "gimbal_angle", width)
        self._gimbal = self._gimbals()

    @property
    def wheels_predicted(self) -> bool:
        """Whether the wheels' speed is a state, an output if measured."""
        return self._wheel_speed is not None

    @property
    def wheels_undriven(self) -> bool:
        """Whether nobody recorded what drove the wheels: their speed is measured, their torque is
        white noise of the intensity that the speed shows."""
        return self._wheel_torque is None and self._wheel_speed is not None

    @property
    def gimbals_undriven(self) -> bool:
        """Whether nobody recorded what drove the gimbals: their rate is white noise of the
        intensity that their angle shows."""
        return "command_gimbal_rate" not in self.used

    @cached_property
    def gimbal_error(self) -> Series | None:
        """The gimbals' measured angle beside the one that they were told to have, as far as no
        fault of their drives explains it."""
        told, seen = self._gimbal_told, self._gimbal_seen
        if told is None or seen is None:
            return seen
        there, _ = profile(self.machine, "command_gimbal_rate", told)
        return less_drive_faults(self.machine, told, there, seen)

    def prepare(self, model: mujoco.MjModel) -> None:
        """Leave all torque on undriven wheels to what their speed shows; let coils feel the log's
        field."""
        machine = self.machine
        if self.wheels_undriven:
            model.dof_damping[machine.wheel_dof] = 0.0
        if self._dipole is not None:
            platform = replace(machine.platform, magnetic_field=self.field_world)
            apply_field(platform, model, machine.magnetorquer_actuator.tolist())

    def drive(self, segment: Segment) -> Drive:
        """Forces and joint states of a segment."""
        machine, step = self.machine, self.machine.platform.step
        steps = max(int(np.ceil((segment.stop - segment.start) / step - 1e-6)), 1)
        edges = segment.edges(step, steps)
        force = np.zeros((steps, machine.model.nv))
        position = machine.model.qpos0.copy()
        position[machine.base_qpos] = 0.0
        velocity = np.zeros(machine.model.nv)
        if self._joint is not None:
            force[:, machine.base_dof] += held_mean(self._joint, edges)
        if self._wheel_speed is not None:
            velocity[machine.wheel_dof] = self._wheel_speed[0].interpolated_at(edges[:1])[0]
        if self._wheel_torque is not None:
            force[:, machine.wheel_dof] += held_mean(self._wheel_torque, edges)
        elif self._wheel_speed is not None:
            speed = self._wheel_speed[0].interpolated_at(edges)
            rotor = np.array([wheel.inertia for wheel in machine.platform.wheels])
            force[:, machine.wheel_dof] += rotor * (np.diff(speed, axis=0) / step)
        if self._stage is not None:
            place, rate = (series.interpolated_at(edges) for series in self._stage)
            position[machine.stage_qpos] = place[0]
            velocity[machine.stage_dof] = rate[0]
            force[:, machine.stage_dof] += machine.stage_inertia * np.diff(rate, axis=0) / step
        if self._gimbal is not None:
            angle, rate = (series.interpolated_at(edges) for series in self._gimbal)
            position[machine.gimbal_qpos] = angle[0]
            velocity[machine.gimbal_dof] = rate[0]
            force[:, machine.gimbal_dof] += machine.gimbal_inertia * np.diff(rate, axis=0) / step
        velocity[machine.rotor_dof] = [rotor.speed for rotor in machine.platform.rotors]
        control = np.zeros((steps, machine.model.nu))
        if self._dipole is not None:
            moments = Limits(machine.platform).coils(held_mean(self._dipole, edges))
            control[:, machine.magnetorquer_actuator] = moments
        if self._thrust is not None:
            thrust = self.thrust(edges)
            if machine.thruster_actuator.size:
                control[:, machine.thruster_actuator] = thrust
            else:
                force[:, machine.base_dof] += thrust @ thruster_arms(machine)
        return Drive(force, control, position, velocity)

    def commanded(self, edges: Array, motion: Motion) -> Array:
        """(m, nv) mean of the commanded torques between m + 1 edges in time [N m], along a motion:
        it says where coils stand in the field. Of gimbals, the commanded rates [rad/s]."""
        machine = self.machine
        force = np.zeros((len(edges) - 1, machine.model.nv))
        if self._joint is not None:
            force[:, machine.base_dof] = held_mean(self._joint, edges)
        if self._wheel_torque is not None:
            force[:, machine.wheel_dof] = held_mean(self._wheel_torque, edges)
        force[:, machine.gimbal_dof] = self.gimbal_rate(edges) * (not self.gimbals_undriven)
        if self._dipole is not None:
            attitude = motion.at(0.5 * (edges[:-1] + edges[1:])).position
            field_body = rotation.rotate(rotation.conjugate(attitude), self.field_world)
            force[:, machine.base_dof] += rotation.cross(held_mean(self._dipole, edges), field_body)
        if self._thrust is not None:
            thrust = self.thrust(edges)
            position = motion.at(0.5 * (edges[:-1] + edges[1:])).position
            force[:, machine.base_dof] += thruster_pushes(machine, thrust, position)
        return force

    def gimbal_rate(self, edges: Array) -> Array:
        """(m, gimbals) mean between m + 1 edges in time [rad/s]."""
        if self._gimbal is None:
            return np.zeros((len(edges) - 1, 0))
        rate = self._gimbal[1].interpolated_at(edges)
        return 0.5 * (rate[1:] + rate[:-1])

    def thrust(self, edges: Array) -> Array:
        """(m, thrusters) mean commanded force between m + 1 edges in time, after the delays that
        platform.toml states [N]."""
        thrusters = self.machine.platform.thrusters
        if self._thrust is None:
            return np.zeros((len(edges) - 1, len(thrusters)))
        delay = np.array([thruster.delay for thruster in thrusters])
        if not np.ptp(delay):
            return held_mean(self._thrust, edges - delay[0])
        means = {late: held_mean(self._thrust, edges - late) for late in set(delay.tolist())}
        return np.stack([means[late][:, i] for i, late in enumerate(delay.tolist())], axis=1)

    def gas_taken(self, times: Array) -> Array:
        """(m,) by the thrusters since the log's first command, up to full tanks [kg]."""
        gas = self.machine.platform.gas
        if gas is None or self._thrust is None:
            return np.zeros(len(times))
        first = float(self._thrust.time[0])
        edges = np.unique([first, *times[times > first].tolist()])
        impulse = np.sum(self.thrust(edges), axis=1) * np.diff(edges)
        taken = np.cumsum([0.0, *impulse.tolist()]) / (gas.specific_impulse * STANDARD_GRAVITY)
        return np.minimum(np.interp(times, edges, taken), gas.mass)

    def joint_states(self, times: Array) -> tuple[Array, Array, Array]:
        """qpos (m, nq), qvel and qacc (m, nv) of the joints that are not the base, as measured.

        Of a stage the acceleration is its mean over a physics step about each time: a drive
        holds one in each.
        """
        machine = self.machine
        position = np.tile(machine.model.qpos0, (len(times), 1))
        velocity, acceleration = np.zeros((2, len(times), machine.model.nv))
        if self._wheel_speed is not None:
            speed, change = self._wheel_speed
            velocity[:, machine.wheel_dof] = speed.interpolated_at(times)
            acceleration[:, machine.wheel_dof] = change.interpolated_at(times)
        if self._stage is not None:
            place, rate = self._stage
            position[:, machine.stage_qpos] = place.interpolated_at(times)
            velocity[:, machine.stage_dof] = rate.interpolated_at(times)
            step = machine.platform.step
            begin, end = (rate.interpolated_at(times + part * step) for part in (-0.5, 0.5))
            acceleration[:, machine.stage_dof] = (end - begin) / step
        if self._gimbal is not None:
            angle, turning = self._gimbal
            position[:, machine.gimbal_qpos] = angle.interpolated_at(times)
            velocity[:, machine.gimbal_dof] = turning.interpolated_at(times)
        velocity[:, machine.rotor_dof] = [rotor.speed for rotor in machine.platform.rotors]
        return position, velocity, acceleration

    def _stages(self, recording: Recording) -> tuple[Series, Series] | None:
        """Position and rate: as told, moved to where they were measured; else as measured."""
        width = len(self.machine.platform.stages)
        seen = self._stream(recording, "stage_position", width)
        told = self._stream(recording, "command_stage_position", width)
        self.stage_seen = seen
        if seen is not None and (told is None or not np.ptp(told.value, axis=0).any()):
            step = self.machine.platform.step
            time = np.arange(seen.time[0], seen.time[-1] + step, step)
            return travelled(seen, self._counter, time)
        if told is None:
            return None
        first = None if seen is None else seen.interpolated_at(told.time[:1])[0]
        place, rate = profile(self.machine, "command_stage_position", told, first)
        if seen is None:
            return place, rate
        self.stage_course = Course(self.machine, told, place)
        return self._followed(place, rate, seen)

    def with_stages(self, effect: Effect, *, counted: bool = True) -> "Inputs":
        """The same, had an effect been at work on the command of stages that are seen: between what
        a counter tells of a micrometre they then went otherwise.

        Args:
            effect: on the command.
            counted: whether they went where they were counted, besides.
        """
        assert self.stage_course is not None
        assert self.stage_seen is not None
        same, there = copy(self), self.stage_course.otherwise(effect)
        same.stage_doubt = None
        same._stage = same._followed(*there, self.stage_seen) if counted else there
        return same

    def counted_with(self, effect: Effect) -> bool:
        """Whether counters show no more than rounding of where stages are with such an effect."""
        assert self.stage_course is not None
        assert self.stage_seen is not None
        place, _ = self.stage_course.otherwise(effect)
        return bool(self._rounded(self._error(place, self.stage_seen)).all())

    def _followed(self, place: Series, rate: Series, measured: Series) -> tuple[Series, Series]:
        """Position and rate, moved to where the stages were measured."""
        error = self._error(place, measured)
        rounded = self._rounded(error)
        if rounded.all():
            return place, rate
        # where it rests as told that is known better than it is counted
        moved = place.interpolated_at(measured.time) - place.interpolated_at(measured.time - RESTED)
        rested = np.abs(moved) < STILL
        error = replace(error, value=np.where(rested & rounded, 0.0, error.value))
        digit = 0.0 if self._counter is None else self._counter.resolution
        self.stage_doubt = between_readings(error, digit)
        left, left_rate = travelled(error, self._counter, place.time)
        return (
            replace(place, value=place.value + left.value),
            replace(rate, value=rate.value + left_rate.value),
        )

    def _error(self, place: Series, measured: Series) -> Series:
        return replace(measured, value=measured.value - place.interpolated_at(measured.time))

    def _rounded(self, error: Series) -> NDArray[np.bool_]:
        """(m, stages) which readings may be rounded from where they should be."""
        if self._counter is None:
            return np.zeros(error.value.shape, bool)
        return np.abs(error.value) <= self._counter.resolution

    @property
    def _counter(self) -> Sensor | None:
        return self.machine.platform.sensors.get("stage_position")

    def _gimbals(self) -> tuple[Series, Series] | None:
        """Angle and rate: as told, moved to where they were measured; else as measured.

        Raises:
            UsageError: the log says neither.
        """
        told, seen = self._gimbal_told, self._gimbal_seen
        if told is None:
            if self.machine.platform.gimbals and seen is None:
                raise UsageError(
                    "the log has neither gimbal_angle nor command_gimbal_rate, without which the "
                    f"motion of {self.machine.platform.name} cannot be predicted"
                )
            return None if seen is None else smoothed_series(seen)
        angle, rate = profile(self.machine, "command_gimbal_rate", told)
        if seen is not None:
            error = replace(seen, value=seen.value - angle.interpolated_at(seen.time))
            left = smoothed_series(error)[0].interpolated_at(angle.time)
            angle = replace(angle, value=angle.value + left)
        return angle, rate

    def _torque_at_rest(self, duty: Series) -> Series:
        """Of the wheels' motors [N m], from their duty."""
        limit = np.array([wheel.torque_limit for wheel in self.machine.platform.wheels])
        return Series(duty.time, duty.value * limit, duty.columns, "N m")

    def _unmeasured(self, torque: Series, recording: Recording) -> tuple[Series, Series]:
        """Speed and acceleration of wheels that start at rest on a body that stands still: where
        the prediction of wheels begins that nobody measured."""
        platform = self.machine.platform
        rotor = np.array([wheel.inertia for wheel in platform.wheels])
        damping = self.model.dof_damping[self.machine.wheel_dof]
        time = np.arange(recording.start, recording.stop + platform.tick, platform.tick)
        pull = held_mean(torque, time) / rotor
        decay = np.exp(-damping / rotor * platform.tick)
        reach = platform.tick * exprel(-damping / rotor * platform.tick)
        speed = np.zeros((len(time), len(rotor)))
        for i, rise in enumerate(pull):
            speed[i + 1] = decay * speed[i] + reach * rise
        change = np.asarray(np.gradient(speed, platform.tick, axis=0), dtype=np.float64)
        return (
            Series(time, speed, torque.columns, "rad/s"),
            Series(time, change, torque.columns, "rad/s/s"),
        )

    def _stream(self, recording: Recording, name: str, width: int) -> Series | None:
        if width == 0 or name not in recording:
            return None
        told = name.startswith("command_")
        series = as_commanded(recording, name) if told else recording[name]
        if len(series) < 2:
            return None
        if len(series.columns) != width:
            raise UsageError(
                f"the log's {name} has {len(series.columns)} columns, but "
                f"{self.machine.platform.name} has {width} such parts; is it of another machine?"
            )
        self.used = (*self.used, name)
        return series


def _refuse_what_is_not_predicted(platform: Platform) -> None:
    """
    Raises:
        UsageError: the machine moves by means that a prediction does not know.
    """
    base = platform.base
    if base.joint in base.locked:
        raise UsageError(
            f"{platform.name} has its joint {base.joint!r} locked, which cannot be predicted from "
            "a log yet; use a log (or a variant) of a body that turns in its bearing"
        )


def held_mean(series: Series, edges: Array) -> Array:
    """Mean of the held value over each interval between edges, shape (len(edges) - 1, k)."""
    stamps = series.time
    held = np.concatenate([series.value[:1], series.value])
    bounds = np.concatenate([[min(edges[0], stamps[0]) - 1.0], stamps, [edges[-1] + 1.0]])
    keep = np.concatenate([[True], np.diff(bounds) > 0.0])
    lengths = np.diff(bounds)
    impulse = np.concatenate(
        [np.zeros((1, held.shape[1])), np.cumsum(held * np.maximum(lengths, 0.0)[:, None], axis=0)]
    )
    at_edges = np.stack(
        [np.interp(edges, bounds[keep], column[keep]) for column in impulse.T], axis=-1
    )
    return np.diff(at_edges, axis=0) / np.diff(edges)[:, None]
