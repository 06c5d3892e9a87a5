"""White noise of a moving signal: what is left of it when the motion has been differenced away.

The fourth divided difference over samples that lie `stride` apart takes every cubic out of a signal
and, scaled to unit weights, leaves white noise at sigma whatever the stride. All else grows with
the stride: a random walk (a wheel driven by a noisy law) with its first power, an integrated one
with the third, smooth motion with the eighth. So the white part is what does not grow, found by
non-negative least squares over the strides.

Gasser, Sroka and Jennen-Steinmetz, Residual variance and residual pattern in nonlinear regression,
Biometrika 73 (1986), have the divided difference with unit weights, for any spacing of the samples.
"""

from functools import cache
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

ORDER = 4
STRIDES = (1, 2, 3, 4, 6, 8, 12, 16)
BLOCKS = 20
"""The median of so many stretches is taken, so that a bump in one of them counts for nothing."""
SHORTEST_BLOCK = 50
"""[samples]."""
COLOURED = 0.25
"""The white part is never taken for less than this share of the least variance."""
MOTION = 30.0
"""Strides at which the variance is more than this times the least show motion, not noise."""


def white_noise(time: Array, value: Array) -> Array:
    """White noise of each column, 1 sigma a sample.

    Args:
        time: (m,) [s], in order; uneven spacing and gaps do no harm.
        value: (m, k).

    Returns:
        (k,); zeros where there are no more than ORDER rows.
    """
    strides = [stride for stride in STRIDES if len(time) > ORDER * stride]
    enough = [stride for stride in strides if len(time) > ORDER * stride + SHORTEST_BLOCK]
    strides = enough or strides[:1]
    if not strides:
        return np.zeros(value.shape[1])
    variances = np.array([_variance(time, value, stride) for stride in strides])
    growth = np.array([_growth(stride) for stride in strides])
    return np.array([_constant_part(column, growth) for column in variances.T])


def _variance(time: Array, value: Array, stride: int) -> Array:
    """(k,) variance of the scaled difference: the median over stretches of the log."""
    taps = ORDER + 1
    count = len(time) - ORDER * stride
    times = np.stack([time[j * stride : j * stride + count] for j in range(taps)])
    span = times[-1] - times[0]
    weights = np.empty_like(times)
    for j in range(taps):
        apart = np.delete(times, j, axis=0) - times[j]
        weights[j] = span**ORDER / np.prod(apart, axis=0)
    weights /= np.sqrt(np.sum(np.square(weights), axis=0))
    difference = np.zeros((count, value.shape[1]))
    for j in range(taps):
        difference += weights[j][:, None] * value[j * stride : j * stride + count]
    squares = np.square(difference[span < 1.5 * np.median(span)])
    blocks = int(np.clip(len(squares) // SHORTEST_BLOCK, 1, BLOCKS))
    means = np.array([block.mean(axis=0) for block in np.array_split(squares, blocks)])
    # Neighbouring differences overlap: a block's mean scatters as chi2 of so many degrees.
    freedom = len(squares) / blocks * _SHARE
    bias = (1.0 - 2.0 / (9.0 * freedom)) ** 3 if blocks > 2 else 1.0
    return np.median(means, axis=0) / max(bias, 0.5)


_SHARE = 0.36
"""Independent squares a fourth difference: C(8, 4)^2 / C(16, 8)."""


@cache
def _growth(stride: int) -> tuple[float, ...]:
    """Variance of the scaled difference of white noise, of its once and twice running sum, and of
    smooth motion, relative to stride 1 for the last."""
    omega = (np.arange(4096) + 0.5) / 4096 * np.pi
    gain = (2.0 * np.sin(0.5 * stride * omega)) ** (2 * ORDER) / _SQUARED_WEIGHTS
    once = 4.0 * np.sin(0.5 * omega) ** 2
    return (
        1.0,
        float(np.mean(gain / once)),
        float(np.mean(gain / once**2)),
        float(stride) ** (2 * ORDER),
    )


_SQUARED_WEIGHTS = 70.0
"""C(8, 4): sum of the squares of 1 -4 6 -4 1."""


def _constant_part(variance: Array, growth: Array) -> float:
    if not variance.any():
        return 0.0
    used = variance <= MOTION * max(float(variance[0]), float(variance.min()))
    # each variance is known to a share of itself
    rows = growth[used] / np.maximum(variance[used], 1e-300)[:, None]
    parts = cast(Array, nnls(rows, np.ones(len(rows)))[0])
    # Noise that a sensor's own filter has smoothed grows from the start, and would leave nothing.
    return float(np.sqrt(max(parts[0], COLOURED * variance.min())))
