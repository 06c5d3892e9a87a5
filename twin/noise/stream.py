"""The noise of one stream, from its own samples: white, quantised, slow; clock and outliers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.noise.allan import SlowNoise, slow_noise
from twin.noise.clock import SampleClock, clock_of
from twin.noise.index_pulse import TURN
from twin.noise.outliers import outliers
from twin.noise.quantisation import resolution_of
from twin.noise.white import white_noise
from twin.recording import Series

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FLOOR = 1e-12
"""No noise is taken for less, so that it can be divided by."""
HELD = 0.2
"""When more rows than this repeat the one before, the sensor is slower than its log."""
AT_REST = 1.5
"""A stretch is at rest while it scatters by less than this times the white noise."""
REST = 500
"""Shortest stretch at rest of which the slow noise is worth a look [samples]."""


@dataclass(frozen=True)
class StreamNoise:
    """How a stream scatters. k columns; of an attitude three: a rotation about body axes [rad]."""

    white: Array
    """(k,) 1 sigma a sample; never below what the quantisation leaves, step / sqrt(12)."""
    resolution: Array
    """(k,) step of the grid on which the values lie; 0 without one."""
    clock: SampleClock
    outliers: Mask
    """(m,) rows that no noise explains, or that are no numbers; left out of `white`."""
    slow: SlowNoise | None
    """From the longest stretch at rest; None where there is none."""

    @property
    def quantised(self) -> Mask:
        """(k,) whether the grid makes most of the noise: its errors are neither white nor normal
        while the signal stands still."""
        return self.resolution / np.sqrt(12.0) > np.sqrt(0.5) * self.white


def noise_of(series: Series) -> Array:
    """White noise of a stream, 1 sigma a sample: (k,), or (3,) of an attitude [rad]."""
    return _white(series)[0]


def noise_and_worth(series: Series) -> tuple[Array, Array]:
    """The same, and the share of the samples that would tell as much of it were they all noise."""
    white, worth, *_ = _white(series)
    return white, worth


def noise_left(time: Array, value: Array, left: Array) -> tuple[Array, Array]:
    """The same of a stream whose motion is known.

    Args:
        time: (m,) [s].
        value: (m, k) as measured, or (m, 4) of an attitude.
        left: (m, k) measured less predicted, in the stream's unit; of an attitude (m, 3) [rad].

    Returns:
        (k,) white noise, 1 sigma a sample, and (k,) what it is worth.
    """
    white, worth = white_noise(time, left)
    return _no_less_than_rounding(white, _resolution(value, left.shape[1])), worth


def measure_noise(series: Series) -> StreamNoise:
    """Everything that a stream says of its own noise."""
    white, _, resolution, flagged, moved = _white(series)
    return StreamNoise(
        white, resolution, clock_of(series), flagged, _slow(series, moved, white, flagged)
    )


def _white(series: Series) -> tuple[Array, Array, Array, Mask, Array]:
    """White noise, what it is worth, resolution, outliers, and the values as numbers that
    differences make sense of."""
    attitude = series.columns == ("w", "x", "y", "z")
    finite = np.isfinite(series.value).all(axis=1)
    resolution = _resolution(series.value[finite], 3 if attitude else len(series.columns))
    value = np.full((len(series), len(resolution)), np.nan)
    value[finite] = angles(series.value[finite]) if attitude else series.value[finite]
    flagged: Mask = np.logical_not(finite)
    flagged[finite] = outliers(value[finite], resolution)
    white, worth = white_noise(series.time[~flagged], value[~flagged])
    fresh = np.concatenate([[True], (np.diff(series.value, axis=0) != 0.0).any(axis=1)])
    if 1.0 - fresh.mean() > HELD and np.all(resolution <= white):
        kept = fresh & ~flagged
        white, worth = white_noise(series.time[kept], value[kept])
    return _no_less_than_rounding(white, resolution), worth, resolution, flagged, value


def _resolution(value: Array, k: int) -> Array:
    """(k,) steps of a stream (m, k), or of the turns of an attitude (m, 4).

    A step of one turn is that of an index mark's passages, which are exact.
    """
    steps = np.array([resolution_of(column) for column in value.T])
    steps = np.where(np.abs(steps / TURN - 1.0) < 1e-6, 0.0, steps)
    # a rotation vector is twice the vector part of its quaternion
    return steps if len(steps) == k else np.full(k, 2.0 * steps.max(initial=0.0))


def _no_less_than_rounding(white: Array, resolution: Array) -> Array:
    least = np.maximum(resolution / np.sqrt(12.0), FLOOR)
    return np.where(white > least, white, least)


def angles(attitude: Array) -> Array:
    """(m, 3) running sum of the turns from one attitude (m, 4) to the next, in body axes [rad].

    No attitude in itself, but its differences are those of the noise: each turn holds the error of
    its end minus that of its start.
    """
    turns = rotation.to_rotation_vector(
        rotation.multiply(rotation.conjugate(attitude[:-1]), attitude[1:])
    )
    return np.concatenate([np.zeros((min(len(attitude), 1), 3)), np.cumsum(turns, axis=0)])


def _slow(series: Series, value: Array, white: Array, flagged: Mask) -> SlowNoise | None:
    """Allan deviation of the longest stretch in which every column only scatters."""
    size = REST // 10
    count = len(value) // size
    if count < REST // size:
        return None
    kept = value.copy()
    kept[flagged] = np.nan
    blocks = kept[: count * size].reshape(count, size, -1)
    scatter, level = np.nanstd(blocks, axis=1), np.nanmean(blocks, axis=1)
    still = (scatter < AT_REST * white).all(axis=1)
    # At rest the level stays; 10 standard errors leave room for the drift of a bias.
    same = (np.abs(np.diff(level, axis=0)) < 10.0 * white / np.sqrt(size)).all(axis=1)
    first, last = _longest_run(still, same)
    stretch = slice(first * size, last * size)
    if (last - first) * size < REST:
        return None
    wander = np.std(level[first:last], axis=0)
    if (wander > 10.0 * white / np.sqrt(size)).any():
        return None
    good = ~flagged[stretch]
    return slow_noise(series.time[stretch][good], value[stretch][good])


def _longest_run(still: Mask, same: Mask) -> tuple[int, int]:
    """First and one past the last of the longest row of still blocks at the same level."""
    best, start = (0, 0), None
    for index, quiet in enumerate(still):
        if not quiet:
            start = None
            continue
        if start is None or not same[index - 1]:
            start = index
        if index + 1 - start > best[1] - best[0]:
            best = (start, index + 1)
    return best
