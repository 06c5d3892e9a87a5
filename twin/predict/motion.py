"""What a log says of the base's motion: smoothed, with derivatives; and how noisy its streams are.

Savitzky-Golay polynomials over a window as wide as the data allow: the widest over which a
cubic still follows them to within three times their noise, so that the chatter of backlash and
quantisation is not taken for motion. Good to start a fit and to shape a law, not to weigh it.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from twin import rotation
from twin.errors import UsageError
from twin.platform import Platform
from twin.recording import Recording, Series

Array = NDArray[np.float64]

WINDOWS = (5, 7, 9, 13, 17, 25, 35, 49, 69, 99)
"""Widths tried [samples]."""


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

    def smooth(self, values: Array) -> Array:
        """(m, k) values on the same grid, smoothed as the position was."""
        period = float(self.time[1] - self.time[0])
        return _savgol(values, self.width, 0, period)

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
        UsageError: the log lacks the stream that shows it (`joint_angle`, or `attitude`).
    """
    stream = "joint_angle" if platform.base.kind == "hinge" else "attitude"
    if stream not in recording or len(recording[stream]) < 2 * WINDOWS[0]:
        raise UsageError(
            f"the log has no stream {stream!r} of at least {2 * WINDOWS[0]} samples, without which "
            f"the motion of {platform.name} cannot be predicted"
        )
    series = recording[stream]
    if stream == "joint_angle":
        time, values, width = _smoothed(series, noise_of(series))
        return Motion(time, *values, width)
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
    filtered = savgol_filter(values, width, 3, deriv=order, delta=period, axis=0)
    return cast(Array, filtered)


def _interpolated(times: Array, known: Array, values: Array) -> Array:
    return np.stack([np.interp(times, known, column) for column in values.T], axis=-1)


def _resolution(column: Array) -> float:
    """Smallest step between distinct values where steps are few; 0 for a continuous column."""
    steps = np.diff(np.unique(column))
    return float(steps.min()) if 0 < len(steps) < len(column) / 2 else 0.0
