"""What a log says of the base's motion: smoothed, with derivatives; and how noisy its streams are.

Savitzky-Golay polynomials over a window as wide as the data allow: the widest over which a
cubic still follows them to within three times their noise, so that the chatter of backlash and
quantisation is not taken for motion. Good to start a fit and to shape a law, not to weigh it.
"""

from dataclasses import dataclass, replace
from typing import cast

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import detrend, savgol_filter

from twin import rotation
from twin.errors import UsageError
from twin.platform import Platform, check_columns
from twin.platform.mjcf import load_mjcf
from twin.predict.log.tilt import attitude_of_start, attitude_of_tilt
from twin.recording import Recording, Series

Array = NDArray[np.float64]

WINDOWS = (5, 7, 9, 13, 17, 25, 35, 49, 69, 99)
"""Widths tried [samples]."""

TILT = ("inclinometer", "accelerometer")
"""Streams that show where the vertical is, the better one first."""

SOON = 0.1
"""Share of the gyro's time after which an attitude that ends was that of the start alone."""


@dataclass(frozen=True)
class Motion:
    """The base joint's smoothed motion on a uniform grid; k = 1 (hinge) or 3 (ball)."""

    time: Array
    """(m,) [s]."""
    position: Array
    """(m, 1) angle [rad] of a hinge, or (m, 4) attitude of a ball."""
    rate: Array
    """(m, k) [rad/s], body axes."""
    acceleration: Array
    """(m, k) [rad/s^2], body axes."""
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
            `attitude`, or `gyro` and `inclinometer` or `accelerometer`). An attitude that is known
            at the start alone will do where a gyro goes on. Or one of them lacks an axis.
    """
    stream = "joint_angle" if platform.base.kind == "hinge" else "attitude"
    if stream == "joint_angle" and stream not in recording and "joint_rate" in recording:
        stream = "joint_rate"
    if stream == "attitude":
        check_columns(recording, platform, ("attitude", "gyro", *TILT))
        recording = _with_attitude(recording)
    if stream not in recording or len(recording[stream]) < 2 * WINDOWS[0]:
        raise UsageError(
            f"the log has no stream {stream!r} of at least {2 * WINDOWS[0]} samples"
            + (" (nor gyro and inclinometer or accelerometer)" if stream == "attitude" else "")
            + f", without which the motion of {platform.name} cannot be predicted"
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
