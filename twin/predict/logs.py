"""Motion of a log, the samples that are used of it, and checks that it is of its machine.

The motion is smoothed, with derivatives, by Savitzky-Golay polynomials over the widest window in
which a cubic follows the data to within three times their noise: the chatter of backlash and
quantisation is not taken for motion. It starts a fit and shapes a law; it is not evidence.

Without an attitude, the motion starts from a gyro: its integral, with the tilt of an inclinometer
or of an accelerometer at rest. The heading then starts at 0, which no law of gravity depends on.

Samples at the end of a stated range, and those that are no measurements (`twin.noise.cleaning`),
are excluded, counted and reported.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, cast

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import detrend, savgol_filter

from twin import rotation
from twin.errors import UsageError
from twin.noise.cleaning import cleaned, dead_words, is_needed
from twin.noise.stuck import OF_AXES, dead_axes, with_neighbours
from twin.platform import Platform, check_columns, floor_log
from twin.platform.mjcf import load_mjcf
from twin.recording import Recording, Series
from twin.signals import OF_MOTION
from twin.units import printed

Array = NDArray[np.float64]
WINDOWS = (5, 7, 9, 13, 17, 25, 35, 49, 69, 99)
"""Widths tried [samples]."""
TILT = ("inclinometer", "accelerometer")
"""Streams that show where the vertical is, the better one first."""
SOON = 0.1
"""Share of the gyro's time after which an attitude that ends was that of the start alone."""
SWING = 0.5
"""Where nothing else shows how far a pendulum swings, it is first taken to swing so far [rad]."""
RATES = ("gyro", "joint_rate")
"""Streams whose scale can be fitted: an unknown scale of a rate."""
FEW = 100
"""An estimate of noise that is worth fewer samples is taken together with what platform.toml
states, as that many more: by chance it is half of the truth, or twice as much."""
AT_RANGE = 1e-3
"""Of the range: so near to it a reading is taken to be at its end."""
OF_PARTS = {
    "wheels": ("wheel_speed", "command_wheel_torque", "command_wheel_speed", "command_wheel_duty"),
    "stages": ("stage_position", "command_stage_position"),
    "gimbals": ("gimbal_angle", "gimbal_rate", "command_gimbal_rate"),
    "thrusters": ("command_thruster",),
    "magnetorquers": ("command_dipole",),
}
"""Streams that only a machine with such parts has."""
BEYOND = 10.0
"""Times what a part can do at which its unit is doubted."""
BEND = 5.0
"""Over which a path on a floor is held against what thrusters can do, either side [s]: long beside
the noise of a camera."""
EVEN = 0.1
"""Of that time, by which its two sides may differ."""
BEYOND_STOP = np.radians(1.0)
"""By how much a stop may give way, or a level be off, before a log cannot be true of it [rad]."""
LOOK = "`twin show` tells what is read wrongly"
"""What to do about a lean that was none."""


@dataclass(frozen=True)
class Motion:
    """The base joint's smoothed motion on a uniform grid; k = 1 (hinge) or 3 (ball, floor)."""

    time: Array
    """(m,) [s]."""
    position: Array
    """(m, 1) angle [rad] of a hinge, (m, 4) attitude of a ball, or (m, 3) x, y and heading on a
    floor [m, m, rad]."""
    rate: Array
    """(m, k) [rad/s], body axes; on a floor of x, y and heading."""
    acceleration: Array
    """(m, k) [rad/s^2], likewise."""
    width: int
    """Samples of the smoothing window."""

    def at(self, times: Array) -> "Motion":
        """Interpolated linearly, quaternions scaled to length 1."""
        position = _interpolated(times, self.time, self.position)
        if position.shape[1] == 4:
            position = rotation.normalized(position)
        return Motion(
            times,
            position,
            _interpolated(times, self.time, self.rate),
            _interpolated(times, self.time, self.acceleration),
            self.width,
        )


def motion_of(recording: Recording, platform: Platform) -> Motion:
    """Smooth the streams that show how the base moves.

    Raises:
        UsageError: the log lacks the stream that shows it (`joint_angle` or `joint_rate`, or
            `attitude`, or `gyro` and `inclinometer` or `accelerometer`, and on a floor `position`
            and `attitude`). An attitude that is known at the start alone will do where a gyro goes
            on. Or one of them lacks an axis.
    """
    if platform.base.kind == "planar":
        return _on_floor(floor_log(recording), platform)
    stream = "joint_angle" if platform.base.kind == "hinge" else "attitude"
    if stream == "joint_angle" and stream not in recording and "joint_rate" in recording:
        stream = "joint_rate"
    if stream == "attitude":
        check_columns(recording, platform, ("attitude", "gyro", *TILT))
        recording = _with_attitude(recording)
    if stream not in recording or len(recording[stream]) < 2 * WINDOWS[0]:
        either = {
            "joint_angle": " nor 'joint_rate'",
            "attitude": " (nor gyro and inclinometer or accelerometer)",
        }
        raise UsageError(
            f"the log has no stream {stream!r}{either.get(stream, '')} of at least "
            f"{2 * WINDOWS[0]} samples, without which the motion of {platform.name} cannot be "
            f"predicted{_of_gyro(recording) if platform.base.kind == 'hinge' else ''}"
        )
    series = recording[stream]
    if stream == "joint_angle":
        time, values, width = _smoothed(series, noise_of(series))
        return Motion(time, *values, width)
    if stream == "joint_rate":
        return _integrated(series, platform)
    # A quaternion's components are smooth too, and small windows keep its length near 1.
    time, (q, q_rate, q_acceleration), width = _smoothed(series, noise_of(series)[:1] / 2.0)
    attitude = rotation.normalized(q)
    back = rotation.conjugate(attitude)
    rate = 2.0 * rotation.multiply(back, q_rate)[:, 1:]
    acceleration = 2.0 * rotation.multiply(back, q_acceleration)[:, 1:]
    if "gyro" in recording:
        gyro = recording["gyro"]
        gyro_time, (smooth_rate, smooth_acceleration, _), width = _smoothed(gyro, noise_of(gyro))
        rate = _interpolated(time, gyro_time, smooth_rate)
        acceleration = _interpolated(time, gyro_time, smooth_acceleration)
    return Motion(time, attitude, rate, acceleration, width)


def _of_gyro(recording: Recording) -> str:
    """What to write where a gyro is the only stream that shows how a hinge turns."""
    if "gyro" not in recording or len(recording["gyro"]) < 2 * WINDOWS[0]:
        return ""
    gyro = recording["gyro"]
    axis = gyro.columns[int(np.argmax(np.std(gyro.value, axis=0)))]
    return (
        f"; its gyro turns most about {axis}: if that is the hinge's axis, take that column as "
        "[streams.joint_rate] in log.toml, with scale = -1 if it points the other way"
    )


def _on_floor(recording: Recording, platform: Platform) -> Motion:
    """Of x, y and heading, on the heading's clock."""
    for name in ("position", "heading"):
        if name not in recording or len(recording[name]) < 2 * WINDOWS[0]:
            measured = "attitude" if name == "heading" else name
            raise UsageError(
                f"the log has no stream {measured!r} of at least {2 * WINDOWS[0]} samples, without "
                f"which the motion of {platform.name} cannot be predicted"
            )
    check_columns(recording, platform, ("position",))
    heading, place = recording["heading"], recording["position"]
    time, turned, width = _smoothed(heading, noise_of(heading))
    there, moved, _ = _smoothed(place, noise_of(place))
    position, rate, acceleration = (
        np.concatenate([_interpolated(time, there, along), about], axis=1)
        for along, about in zip(moved, turned, strict=True)
    )
    return Motion(time, position, rate, acceleration, width)


def _with_attitude(recording: Recording) -> Recording:
    """As tilt and rate have it, if there are both; where it ends soon, as the gyro carries it on.

    An attitude that a lab integrated from its gyro tells nothing that the gyro does not, and is not
    white: of such a log the attitude is that of its start.
    """
    if "gyro" not in recording:
        return recording
    gyro = recording["gyro"]
    if "attitude" not in recording:
        tilt = next((name for name in TILT if name in recording), None)
        if tilt is None:
            return recording
        attitude = attitude_of_tilt(gyro, recording[tilt])
    else:
        shown = recording["attitude"]
        if len(shown) == 0 or len(gyro) == 0 or _share(shown, gyro) > SOON:
            return recording
        attitude = attitude_of_start(gyro, shown)
    return replace(recording, streams={**recording.streams, "attitude": attitude})


def _share(series: Series, of: Series) -> float:
    """Of the time of another stream after which a stream ends."""
    whole = float(of.time[-1] - of.time[0])
    return float(series.time[-1] - of.time[0]) / whole if whole > 0.0 else 1.0


def _integrated(series: Series, platform: Platform) -> Motion:
    """A hinge's motion from its rate alone.

    The angle is the integral of the rate. A body that gravity holds swings about where it hangs:
    the mean and the trend of the angle are then those of the gyro, and are taken out. Else it
    starts at 0.
    """
    time, (rate, change, _), width = _smoothed(series, noise_of(series))
    swings = swing_rate(platform) > 0.0
    if swings:
        rate = rate - rate.mean(axis=0)
    angle = cumulative_trapezoid(rate, time, axis=0, initial=0.0)
    if swings:
        angle = detrend(angle, axis=0) + _hanging(platform)
    return Motion(time, np.asarray(angle, dtype=np.float64), rate, change, width)


def swing_rate(platform: Platform) -> float:
    """Of small swings about a hinge, sqrt(g m r / J) [rad/s]; 0 where gravity does not hold it."""
    axis, _, pull = _plane(platform)
    return float(np.sqrt(pull * platform.gravity / (axis @ platform.inertia @ axis)))


def _hanging(platform: Platform) -> float:
    """The angle of a hinge at which m r points down."""
    axis, moment, _ = _plane(platform)
    down = np.array([0.0, 0.0, -1.0])
    return float(np.arctan2(axis @ np.cross(moment, down), moment @ down))


def _plane(platform: Platform) -> tuple[Array, Array, float]:
    """A hinge's axis, m r across it, and the most of m r that gravity gets hold of [kg m]."""
    model = load_mjcf(platform.model_path)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axis = data.xaxis[model.joint(platform.base.joint).id]
    offset = platform.center_of_mass_offset
    moment = offset - (axis @ offset) * axis
    level = np.sqrt(max(1.0 - axis[2] ** 2, 0.0))
    return axis, moment, float(level * np.linalg.norm(moment))


def noise_of(series: Series) -> Array:
    """White noise of a stream [1 sigma a sample], from its third differences.

    A motion sampled well leaves nothing in the third difference of its values; white noise leaves
    20 sigma^2. Never less than the quantisation shows: step / sqrt(12). Shape (k,), or (3,) for
    attitudes [rad].
    """
    if series.columns == ("w", "x", "y", "z"):
        steps = rotation.multiply(rotation.conjugate(series.value[:-1]), series.value[1:])
        thirds = np.diff(2.0 * steps[:, 1:], n=2, axis=0)
        resolution = np.zeros(3)
    else:
        thirds = np.diff(series.value, n=3, axis=0)
        resolution = np.array([_resolution(column) for column in series.value.T])
    if len(thirds) == 0:
        return np.maximum(resolution, 1e-12)
    white = np.sqrt(np.mean(np.square(thirds), axis=0) / 20.0)
    return np.maximum(np.maximum(white, resolution / np.sqrt(12.0)), 1e-12)


def smoothed_series(series: Series) -> tuple[Series, Series]:
    """A stream and its time derivative, smoothed, on a uniform grid."""
    time, (value, derivative, _), _ = _smoothed(series, noise_of(series))
    smooth = Series(time, value, series.columns, series.unit)
    return smooth, Series(time, derivative, series.columns, f"{series.unit}/s")


def _smoothed(series: Series, noise: Array) -> tuple[Array, tuple[Array, Array, Array], int]:
    """Uniform times; value, first and second derivative at them, each (m, k); the window."""
    period = float(np.median(np.diff(series.time)))
    count = max(round((series.time[-1] - series.time[0]) / period), 1) + 1
    time = np.linspace(series.time[0], series.time[-1], count)
    raw = _interpolated(time, series.time, series.value)
    widths = [width for width in WINDOWS if width <= count] or [WINDOWS[0]]
    best = widths[0]
    for width in widths:
        left = raw - _savgol(raw, width, 0, period)
        if np.all(np.sqrt(np.mean(np.square(left), axis=0)) <= 3.0 * noise):
            best = width
    return (
        time,
        (
            _savgol(raw, best, 0, period),
            _savgol(raw, best, 1, period),
            _savgol(raw, best, 2, period),
        ),
        best,
    )


def _savgol(values: Array, width: int, order: int, period: float) -> Array:
    # of the few rows that a slow stream has in a short log
    width = min(width, len(values) - 1 + len(values) % 2)
    degree = min(3, width - 1)
    filtered = savgol_filter(values, width, degree, deriv=order, delta=period, axis=0)
    return cast(Array, filtered)


def _interpolated(times: Array, known: Array, values: Array) -> Array:
    return np.stack([np.interp(times, known, column) for column in values.T], axis=-1)


def _resolution(column: Array) -> float:
    """Smallest step between distinct values where steps are few; 0 for a continuous column."""
    steps = np.diff(np.unique(column))
    return float(steps.min()) if 0 < len(steps) < len(column) / 2 else 0.0


def attitude_of_tilt(gyro: Series, tilt: Series) -> Series:
    """(m, 4) at the gyro's stamps at which there is a tilt too.

    Args:
        gyro: (., 3) [rad/s].
        tilt: of an inclinometer (., 2) [rad], or of an accelerometer (., 3) [m/s^2].
    """
    inside = (gyro.time >= tilt.time[0]) & (gyro.time <= tilt.time[-1])
    time, rate = gyro.time[inside], gyro.value[inside]
    vertical = _vertical(tilt.interpolated_at(time))
    turns = rotation.from_rotation_vector(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None])
    attitude = np.empty((len(time), 4))
    before = np.array([1.0, 0.0, 0.0, 0.0])
    for i in range(len(time)):
        turned = before if i == 0 else rotation.multiply(before, turns[i - 1])
        attitude[i] = before = _levelled(turned, vertical[i])
    return Series(time, attitude, ("w", "x", "y", "z"), "1")


def attitude_of_start(gyro: Series, attitude: Series) -> Series:
    """(m, 4) at the gyro's stamps from the first attitude on, as the gyro carries it on."""
    inside = gyro.time >= attitude.time[0]
    time, rate = gyro.time[inside], gyro.value[inside]
    turns = rotation.from_rotation_vector(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None])
    carried = [attitude.value[0]]
    for turn in turns:
        carried.append(rotation.multiply(carried[-1], turn))
    return Series(time, np.array(carried), ("w", "x", "y", "z"), "1")


def _vertical(shown: Array) -> Array:
    """(m, 3) the world's z axis in body components, from elevations (m, 2) or a force (m, 3)."""
    if shown.shape[1] == 3:
        return shown / np.maximum(np.linalg.norm(shown, axis=1, keepdims=True), 1e-12)
    roll, pitch = np.sin(shown).T
    up = np.sqrt(np.maximum(1.0 - roll**2 - pitch**2, 0.0))
    return np.stack([-pitch, roll, up], axis=-1)


def _levelled(attitude: Array, vertical: Array) -> Array:
    """By the shortest turn to where the world's z axis has these body components."""
    across = rotation.cross(vertical, rotation.vertical_body(attitude))
    sine = float(np.linalg.norm(across))
    if sine == 0.0:
        return attitude
    angle = np.arctan2(sine, vertical @ rotation.vertical_body(attitude))
    return rotation.multiply(attitude, rotation.from_rotation_vector(across * (angle / sine)))


@dataclass(frozen=True)
class Scaled:
    """A log in SI, as far as its scales are known."""

    recording: Recording
    factor: Mapping[str, float]
    """To SI, of each stream whose scale is sought; its offset was taken out before."""

    def by(self, change: Mapping[str, float]) -> "Scaled":
        """With the factors multiplied by further ones."""
        recording = self.recording
        for name, factor in change.items():
            recording = _times(recording, name, factor, 0.0)
        return Scaled(recording, {n: f * change.get(n, 1.0) for n, f in self.factor.items()})


def first_scaled(recording: Recording, platform: Platform) -> Scaled:
    """Guess the scales: from the other streams of the motion, else from a swing of half a radian.

    The offset of such a stream is as unknown as its scale. It is taken for the mean of what the
    other streams do not show.
    """
    scaled = Scaled(recording, {})
    for name in sought(recording):
        series = recording[name]
        shown = _shown(recording, platform, name)
        if shown is None:
            offset = series.value.mean(axis=0)
            size = np.sqrt(2.0) * float((series.value - offset).std())
            hinge = platform.base.kind == "hinge"
            factor = SWING * swing_rate(platform) / size if hinge and size > 0.0 else 0.0
            if factor == 0.0:
                factor, offset = 1.0, np.zeros_like(offset)
        else:
            rate = shown.at(series.time).rate
            centred = series.value - series.value.mean(axis=0)
            slope = float(np.sum(centred * (rate - rate.mean(axis=0))) / np.sum(np.square(centred)))
            factor = slope if slope != 0.0 else 1.0
            offset = series.value.mean(axis=0) - rate.mean(axis=0) / factor
        recording = _times(recording, name, factor, offset)
        scaled = Scaled(recording, {**scaled.factor, name: factor})
    return replace(scaled, recording=recording)


def sought(recording: Recording) -> tuple[str, ...]:
    """The rates whose log.toml says `scale = "fit"`."""
    facts = _facts(recording)
    return tuple(n for n in RATES if n in recording and facts.get(n, {}).get("fit_scale"))


def unit_of(recording: Recording, name: str) -> str:
    """The unit that the file of a stream is in."""
    stated = _facts(recording).get(name, {}).get("unit")
    return stated if isinstance(stated, str) else recording[name].unit


def _shown(recording: Recording, platform: Platform, name: str) -> Motion | None:
    """The motion by the other streams."""
    needed = "joint_angle" if platform.base.kind == "hinge" else "attitude"
    if needed not in recording:
        return None
    kept = {key: series for key, series in recording.items() if key != name}
    return motion_of(replace(recording, streams=kept), platform)


def _times(recording: Recording, name: str, factor: float, offset: Array | float) -> Recording:
    series = recording[name]
    moved = Series(series.time, (series.value - offset) * factor, series.columns, series.unit)
    facts = dict(_facts(recording))
    noise = facts.get(name, {}).get("noise")
    if noise is not None:
        scaled = (np.asarray(noise, dtype=np.float64) * abs(factor)).tolist()
        facts[name] = {**facts[name], "noise": scaled}
    return replace(
        recording,
        streams={**recording.streams, name: moved},
        provenance={**recording.provenance, "streams": facts},
    )


def _facts(recording: Recording) -> Mapping[str, Mapping[str, Any]]:
    return cast(Mapping[str, Mapping[str, Any]], recording.provenance.get("streams") or {})


def claimed_noise(platform: Platform, name: str, k: int) -> Array:
    """(k,) noise that platform.toml states; 0: none."""
    sensor = platform.sensors.get(name)
    noise = np.zeros(1) if sensor is None else np.asarray(sensor.noise, dtype=np.float64)
    return np.broadcast_to(noise, (k,)).copy()


def with_claim(claimed: Array, noise: Array, worth: Array, count: int) -> tuple[Array, Array]:
    """An estimate from few samples, with what platform.toml states as so many more; its worth.

    Args:
        claimed: (k,) as platform.toml has it; 0: none.
        noise: (k,) as estimated, in the stream's unit.
        worth: (k,) share of the samples that would tell as much of it.
        count: of samples.
    """
    enough = worth * count
    few = (enough < FEW) & (claimed > 0.0)
    share = enough / (enough + FEW)
    both = share * np.square(noise) + (1.0 - share) * np.square(claimed)
    # the residual's variance beside it is 2 / count (1 / worth - 1), as that of an estimate
    worth_of_both = 1.0 / (2.0 - 2.0 * share + np.square(share) / worth)
    return np.where(few, np.sqrt(both), noise), np.where(few, worth_of_both, worth)


def counted_noise(platform: Platform, count: int) -> tuple[Array, bool, Array] | None:
    """Of stages' counters, whose noise cannot be told from their moves: as platform.toml states it.

    Rounding is off by half a step at most, and where a drive's own steps are rounded it is off by
    the same at every stop: so many readings say no more of it than one.
    """
    sensor = platform.sensors["stage_position"]
    noise = np.hypot(sensor.noise, 0.5 * sensor.resolution * np.sqrt(count))
    return (noise, True, np.full(len(noise), inf)) if np.all(noise > 0.0) else None


def claimed_delay(platform: Platform, name: str) -> float:
    """The group delay at rest of a Butterworth filter."""
    sensor = platform.sensors.get(name)
    if sensor is None or not np.isfinite(sensor.cutoff):
        return 0.0
    return float(1.0 / (2.0 * np.pi * sensor.cutoff * np.sin(0.5 * np.pi / sensor.order)))


def claimed_bias(platform: Platform, name: str, k: int) -> Array:
    """(k,) 1 sigma of a sensor's constant error; 0: none."""
    if name == "gas_pressure" and platform.gas is not None:
        return np.full(k, platform.gas.pressure)  # nobody states how full the tanks were
    sensor = platform.sensors.get(name)
    return np.zeros(k) if sensor is None else np.broadcast_to(sensor.bias, (k,)).copy()


def usable(recording: Recording, platform: Platform) -> Recording:
    """A log without samples that say nothing of the motion; `repairs` says so."""
    held, said = within_range(recording, platform)
    return cleaned(
        replace(held, repairs=(*held.repairs, *said)),
        all_axes=turns_about_all_axes(platform),
        wheel_axes=[wheel.axis for wheel in platform.wheels if wheel.gimbal is None],
    )


def turns_about_all_axes(platform: Platform) -> bool:
    """Whether the base turns about three axes, so that a sensor must measure all of them."""
    base = platform.base
    return base.kind not in ("hinge", "planar") and not base.planar and not base.locked


def within_range(recording: Recording, platform: Platform) -> tuple[Recording, tuple[str, ...]]:
    """A log without the samples at the range that platform.toml states, and a sentence a stream."""
    streams = dict(recording.streams)
    said: list[str] = []
    for name, sensor in platform.sensors.items():
        if name not in streams or not np.isfinite(sensor.range):
            continue
        series = streams[name]
        good = np.all(np.abs(series.value) < sensor.range * (1.0 - AT_RANGE), axis=1)
        lost = int(np.count_nonzero(~good))
        if lost:
            streams[name] = series.only(~with_neighbours(~good))
            said.append(
                f"{lost} of {len(series)} samples of {name} are at the end of its range, "
                f"{printed(sensor.range, series.unit)}, and are not used, nor are those next "
                "to them"
            )
    return replace(recording, streams=streams), tuple(said)


class ImpossibleLog(UsageError):
    """A log that cannot be of its machine, both as they stand."""


def check_possible(recording: Recording, platform: Platform) -> None:
    """Whether a log can be of a machine, before anything is made of it.

    Raises:
        ImpossibleLog: parts did ten times what they can, streams share no time, or a sensor of the
            motion was off.
    """
    _check_sizes(recording, platform)
    _check_place(recording, platform)
    _check_clocks(recording, platform)
    _check_alive(recording)
    if turns_about_all_axes(platform):
        _check_axes(recording)


def _check_sizes(recording: Recording, platform: Platform) -> None:
    """No part gives ten times what it can: then it is the unit."""
    torque = [wheel.torque_limit for wheel in platform.wheels]
    travel = [max(np.abs(stage.travel)) for stage in platform.stages]
    limits = {
        "command_wheel_torque": torque,
        "stage_position": travel,
        "command_stage_position": travel,
    }
    for name, most in limits.items():
        if name not in recording or not len(recording[name]):
            continue
        series = recording[name]
        reached, able = float(np.abs(series.value).max()), float(max(most, default=np.inf))
        if reached > BEYOND * able:
            raise ImpossibleLog(
                f"{recording.source}: {name} reaches {reached:.3g} {series.unit}, where "
                f"{platform.name} can at most {able:.3g} {series.unit}: it looks like "
                f"m{series.unit}, read as {series.unit}; state its unit in log.toml"
            )


def _check_place(recording: Recording, platform: Platform) -> None:
    """On a floor, no path bends ten times more than all thrusters together can bend it."""
    if "position" not in recording or not platform.thrusters or not platform.base.planar:
        return
    series = recording["position"]
    lag = max(int(np.searchsorted(series.time - series.time[0], BEND)), 1)
    if len(series) <= 2 * lag:
        return
    time, value = series.time, series.value
    bend = np.linalg.norm(value[2 * lag :] - 2.0 * value[lag:-lag] + value[: -2 * lag], axis=1)
    even = np.abs(time[2 * lag :] - 2.0 * time[lag:-lag] + time[: -2 * lag]) < EVEN * BEND
    reached = float(bend[even].max(initial=0.0)) / BEND**2
    able = sum(thruster.force_limit for thruster in platform.thrusters) / platform.mass
    if reached > BEYOND * able:
        raise ImpossibleLog(
            f"{recording.source}: position shows {reached:.3g} m/s^2 over {2.0 * BEND:g} s, where "
            f"the thrusters of {platform.name} give at most {able:.3g} m/s^2: it looks like mm or "
            "cm, read as m; state its unit in log.toml"
        )


def _check_clocks(recording: Recording, platform: Platform) -> None:
    """All that the prediction uses must share time with what shows the motion."""
    hinge = platform.base.kind == "hinge"
    shown = [s for s in (OF_MOTION[3:] if hinge else OF_MOTION[:3]) if s in recording]
    shown = [s for s in shown if len(recording[s])]
    if not shown:
        return
    shows = max(shown, key=lambda s: recording[s].time[-1] - recording[s].time[0])
    for name in (*OF_MOTION, *platform.commands, *(s for two in OF_PARTS.values() for s in two)):
        if name == shows or name not in recording or len(recording[name]) == 0:
            continue
        if said := no_shared_time(recording, name, shows):
            raise ImpossibleLog(f"{recording.source}: {said}")


def no_shared_time(recording: Recording, name: str, other: str) -> str:
    """That two streams share no time, as a sentence; empty where they do."""
    time, main = recording[name].time, recording[other].time
    # what was commanded before still holds
    if time[0] <= main[-1] and (time[-1] >= main[0] or name.startswith("command_")):
        return ""
    return (
        f"{name} runs from {time[0]:.6g} to {time[-1]:.6g} s, {other} from {main[0]:.6g} to "
        f"{main[-1]:.6g} s; they share no time: bring them to one clock"
    )


def check_within_stop(
    recording: Recording, platform: Platform, motion: Motion, look: str = LOOK
) -> None:
    """A motion that goes on beyond the stop is not that of a body which the stop holds.

    Args:
        recording: for its name.
        platform: with its stop.
        motion: of the log.
        look: where to look if the body never leaned so far.

    Raises:
        ImpossibleLog: it leans further than that, and where.
    """
    if platform.base.kind != "ball" or not np.isfinite(platform.stop_angle):
        return
    lean = platform.lean(motion.position)
    most = int(np.argmax(lean))
    if lean[most] > platform.stop_angle + BEYOND_STOP:
        raise ImpossibleLog(
            f"{recording.source}: {platform.name} leans {np.degrees(lean[most]):.3g} deg at "
            f"{motion.time[most]:.4g} s, and platform.toml has a stop at "
            f"{np.degrees(platform.stop_angle):.3g} deg: set the angle of [tilt_stop] to where it "
            f"touches, or leave the stop out; if it never leaned so far, {look}"
        )


def _check_alive(recording: Recording) -> None:
    for name in OF_MOTION:
        if name in recording and recording[name].stands_still:
            raise ImpossibleLog(
                f"{recording.source}: {name} is the same in all {len(recording[name])} rows, "
                "which tells nothing of a machine that moves; if the sensor was off, leave the "
                "stream out"
            )


def _check_axes(recording: Recording) -> None:
    """No sensor that alone shows the motion has a dead axis."""
    for name in OF_AXES:
        if name not in recording or not is_needed(name, recording):
            continue
        if dead := dead_axes(recording[name]):
            raise ImpossibleLog(
                f"{recording.source}: {dead_words(name, dead)}; that axis was off, and no "
                "attitude shows the motion instead: record it again, or add the attitude"
            )
