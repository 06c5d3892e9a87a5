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

SHORT = 4
"""Longest stride of the mean. Longer ones would make it a tenth sharper, and they see how a control
law answers the noise: a percent more, too little to be told from chance in one log."""

FLAT = 3.0
"""Standard deviations by which the variance at a stride must exceed that at shorter ones to have
grown."""


def white_noise(time: Array, value: Array) -> tuple[Array, Array]:
    """White noise of each column, 1 sigma a sample, and how well it is known.

    Args:
        time: (m,) [s], in order; uneven spacing and gaps do no harm.
        value: (m, k).

    Returns:
        (k,) sigma; zeros where there are no more than ORDER rows. (k,) the share of the samples
        that would tell as much of sigma were they nothing but noise.
    """
    strides = [stride for stride in STRIDES if len(time) > ORDER * stride]
    enough = [stride for stride in strides if len(time) > ORDER * stride + SHORTEST_BLOCK]
    strides = enough or strides[:1]
    if not strides:
        return np.zeros(value.shape[1]), np.full(value.shape[1], _worth(1))
    variances = np.array([_variance(time, value, stride) for stride in strides])
    growth = np.array([_growth(stride) for stride in strides])
    spread = float(np.sqrt(2.0 / (len(time) * _worth(1))))
    short = sum(stride <= SHORT for stride in strides)
    flat = [_flat(column[:short], spread) for column in variances.T]
    # Held to be no less than nothing, growth that is not there would take its share of the noise.
    sigma = [
        np.sqrt(column[:count].mean()) if count > 1 else _constant_part(column, growth)
        for column, count in zip(variances.T, flat, strict=True)
    ]
    return np.array(sigma), np.array([_worth(count) for count in flat])


def _flat(variance: Array, spread: float) -> int:
    """How many of the first strides show no growth, their variances known to a share of them."""
    for count in range(1, len(variance)):
        if variance[count] > (1.0 + FLAT * spread) * variance[:count].mean():
            return count
    return len(variance)


@cache
def _worth(strides: int) -> float:
    """Independent squares a sample, in the mean over so many strides of medians over blocks."""
    taps = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(_SQUARED_WEIGHTS)
    filters: list[Array] = []
    for stride in STRIDES[:strides]:
        spaced = np.zeros(ORDER * stride + 1)
        spaced[::stride] = taps
        filters.append(spaced)
    alike = np.array(
        [[np.sum(np.square(np.convolve(a, b[::-1]))) for a in filters] for b in filters]
    )
    # Medians of normal variables that correlate by r vary together as asin(r), means as r.
    return float(1.0 / np.mean(alike[0, 0] * np.arcsin(np.minimum(alike / alike[0, 0], 1.0))))


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
