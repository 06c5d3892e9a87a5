"""Slow noise of a sensor at rest: Allan deviation, and what it is made of.

Over an averaging time tau, white noise N, bias instability B and rate random walk K add up to

    sigma^2(tau) = N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3

IEEE Std 952-1997, annex C. The deviation is the overlapping one of its C.1.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

FLATNESS = 2.0 * np.log(2.0) / np.pi
SEEN = 3.0
"""A part is seen when it is this many times its own standard deviation."""
AVERAGES = 9
"""The longest averaging time leaves at least so many averages; fewer scatter by over a third."""


@dataclass(frozen=True)
class SlowNoise:
    """The parts of a column's Allan deviation; NaN where the log is too short to see one."""

    start: float
    """Of the stretch at rest [s]."""
    stop: float
    """[s]."""
    tau: Array
    """(t,) averaging times [s]."""
    deviation: Array
    """(t, k) Allan deviation, in the stream's unit."""
    random_walk: Array
    """(k,) N: angle random walk of a gyro [unit sqrt(s)]."""
    bias_instability: Array
    """(k,) B [unit]."""
    rate_random_walk: Array
    """(k,) K [unit / sqrt(s)]."""


def slow_noise(time: Array, value: Array) -> SlowNoise:
    """Allan deviation of (m, k) values at rest, m at least 3 AVERAGES."""
    period = float(np.median(np.diff(time)))
    sizes = 2 ** np.arange(int(np.log2(len(time) / AVERAGES)) + 1)
    deviation = np.sqrt(np.array([_variance(value, int(size)) for size in sizes]))
    tau = sizes.astype(np.float64) * period
    parts = np.array([_parts(tau, column, len(time) / sizes) for column in deviation.T])
    walk, flat, ramp = np.sqrt(parts.T)
    return SlowNoise(float(time[0]), float(time[-1]), tau, deviation, walk, flat, ramp)


def _variance(value: Array, size: int) -> Array:
    sums = np.concatenate([np.zeros((1, value.shape[1])), np.cumsum(value, axis=0)])
    means = (sums[size:] - sums[:-size]) / size
    return 0.5 * np.mean(np.square(means[size:] - means[:-size]), axis=0)


def _parts(tau: Array, deviation: Array, averages: Array) -> Array:
    """(3,) N^2, B^2, K^2 by weighted non-negative least squares; NaN where not seen."""
    if not deviation.all():
        return np.full(3, np.nan)
    # an Allan variance over a averages scatters by about sqrt(2 / (a - 1)) of itself
    scatter = np.square(deviation) * np.sqrt(2.0 / (averages - 1.0))
    design = np.stack([1.0 / tau, np.full_like(tau, FLATNESS), tau / 3.0], axis=-1)
    rows = design / scatter[:, None]
    parts = cast(Array, nnls(rows, np.square(deviation) / scatter)[0])
    spread = np.sqrt(np.diag(np.linalg.pinv(rows.T @ rows)))
    return np.where(parts > SEEN * spread, parts, np.nan)
