"""Statistics of metrics: bootstrap intervals, rank correlations, tests of a difference.

Runs of one sample are flown on the same machine and are no independent draws: whatever is resampled
is resampled by samples, and whatever is tested is one number a machine.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from twin.interval import Interval

Array = NDArray[np.float64]

RESAMPLES = 2000
FEWEST = 5
"""Draws without which a mean has no interval."""
_NUMBERS = 2 * 10**7
"""Drawn for one interval, or for 200 resamples: of many runs fewer will do."""
_BLOCK = 10**6
"""Numbers held at once."""

Statistic = Callable[..., Array]


def bootstrap(
    columns: tuple[Array, ...],
    sample: NDArray[np.int64],
    statistic: Statistic,
) -> Interval:
    """Percentile bootstrap of a statistic.

    Source: B. Efron, R. J. Tibshirani, An introduction to the bootstrap, 1993, chapter 13.

    Args:
        columns: (n,) each; they stay together row by row.
        sample: (n,) of each row; rows of one sample stay together.
        statistic: of columns (..., m), over their last axis.
    """
    value = float(statistic(*columns))
    draws = len(np.unique(sample))
    return _interval(value, resampled(columns, sample, statistic, seed=0), draws)


def ratio_of_means(
    one: tuple[Array, NDArray[np.int64]], other: tuple[Array, NDArray[np.int64]]
) -> Interval:
    """Of the second of two sets that share nothing; each is its values (n,) and their samples."""
    below, above = (
        resampled((values,), sample, mean, seed=seed)
        for seed, (values, sample) in enumerate((one, other))
    )
    many = min(len(below), len(above))
    draws = min(len(np.unique(sample)) for _, sample in (one, other))
    with np.errstate(divide="ignore", invalid="ignore"):
        value = float(np.divide(np.mean(other[0]), np.mean(one[0])))
        return _interval(value, above[:many] / below[:many], draws)


def quantile(values: Array, sample: NDArray[np.int64], share: float) -> Interval:
    """A quantile with the interval that order statistics give, whatever the distribution.

    Of few draws an end is infinite: beyond all that was seen. Rows of one sample count as one draw,
    so that the interval is rather too wide where they differ.

    Source: H. A. David, H. N. Nagaraja, Order Statistics, 2003, section 7.1.

    Args:
        values: (n,).
        sample: (n,) of each; rows of one sample are no independent draws.
        share: of the distribution that lies below it.
    """
    rows, draws = len(values), len(np.unique(sample))
    ordered = np.sort(values)
    below, above = (int(stats.binom.ppf(tail, draws, share)) for tail in (0.025, 0.975))
    low = ordered[(below - 1) * rows // draws] if below > 0 else -np.inf
    high = ordered[-(-(above + 1) * rows // draws) - 1] if above < draws else np.inf
    return Interval(float(np.quantile(values, share)), float(low), float(high))


def resampled(
    columns: tuple[Array, ...], sample: NDArray[np.int64], statistic: Statistic, *, seed: int
) -> Array:
    """The statistic of as many resamples of the samples as an interval needs."""
    order = np.argsort(sample, kind="stable")
    _, starts, counts = np.unique(sample[order], return_index=True, return_counts=True)
    if len(starts) < 2:
        return np.full(2, np.nan)
    draw = np.random.default_rng(seed)
    times = int(np.clip(_NUMBERS // len(sample), 200, RESAMPLES))
    alike = bool((counts == counts[0]).all())
    block = max(_BLOCK // len(sample), 1) if alike else 1
    parts = np.split(order, starts[1:])
    table = order.reshape(len(starts), -1) if alike else None
    found: list[Array] = []
    for first in range(0, times, block):
        picked = draw.integers(len(starts), size=(min(block, times - first), len(starts)))
        if table is not None:
            rows = table[picked].reshape(len(picked), -1)
        else:
            rows = np.concatenate([parts[number] for number in picked[0]])[None]
        found.append(np.asarray(statistic(*(column[rows] for column in columns))))
    return np.concatenate(found)


def mean(values: Array) -> Array:
    """Over the last axis."""
    return np.asarray(np.mean(values, axis=-1))


def _interval(value: float, found: Array, draws: int) -> Interval:
    """Of resamples, as much wider as Student's t of few draws is than the normal distribution.

    Source: T. C. Hesterberg, The American Statistician 69, 2015, section 4.3.
    """
    known = found[np.isfinite(found)]
    if draws < FEWEST or not known.size:
        return Interval(value, np.nan, np.nan)
    tail = stats.norm.cdf(np.sqrt(draws / (draws - 1.0)) * stats.t.ppf(0.025, draws - 1))
    low, high = np.quantile(known, [tail, 1.0 - tail])
    return Interval(value, float(low), float(high))


def rank_correlation(one: Array, other: Array) -> tuple[Interval, float]:
    """Spearman's rho with its 95 % interval by Fisher's z, and the p-value of none.

    Source: D. G. Bonett, T. A. Wright, Psychometrika 65, 2000, for the interval's width.
    """
    n = len(one)
    if n < 5 or np.ptp(one) == 0.0 or np.ptp(other) == 0.0:
        return Interval(np.nan, np.nan, np.nan), 1.0
    found = stats.spearmanr(one, other)
    rho = float(np.clip(found.statistic, -0.999999, 0.999999))
    half = 1.96 * np.sqrt((1.0 + 0.5 * rho**2) / (n - 3))
    low, high = np.tanh(np.arctanh(rho) + np.array([-half, half]))
    return Interval(rho, float(low), float(high)), float(found.pvalue)


def correlation_within(table: Array, levels: Array) -> tuple[Interval, float]:
    """Mean over machines of the rank correlation that each has by itself, and the p-value of none.

    The interval resamples machines. The test is Wilcoxon's signed-rank test on the machines' slopes
    against the levels' ranks; of two levels that is the test of pairs. (Page's test of a trend
    takes the runs of a machine for independent: where half of the machines rise and half fall, it
    finds a trend in every second campaign.)

    Args:
        table: (machines, blocks, k), NaN where there is none; a block is correlated by itself, and
            a machine has the mean of its blocks.
        levels: (k,) what it is correlated with.
    """
    known = np.isfinite(table)
    one, other = (_centred_ranks(np.where(known, values, np.nan)) for values in (table, levels))
    across = np.sum(other**2, axis=-1)
    told = across > 0.0  # a block of a single level says nothing
    machines = told.any(axis=-1)
    size = np.sqrt(np.sum(one**2, axis=-1) * across)
    rho = np.sum(one * other, axis=-1) / np.where(size > 0.0, size, 1.0)
    # from the lowest, so that the slope of what does not change is 0 and no rounding
    lowest = np.min(table, axis=-1, keepdims=True, initial=np.inf, where=known)
    rise = np.where(known, table - lowest, 0.0)
    slope = np.sum(rise * other, axis=-1) / np.where(told, across, 1.0)
    own, slopes = (
        np.sum(values[machines], axis=-1) / np.sum(told[machines], axis=-1)
        for values in (rho, slope)
    )
    if len(own) < 5 or not own.any():
        return Interval(np.nan, np.nan, np.nan), 1.0
    return bootstrap((own,), np.arange(len(own)), mean), signed_ranks(slopes)


def _centred_ranks(table: Array) -> Array:
    """Over the last axis, less their mean; 0 where there is no number."""
    ranks = stats.rankdata(table, axis=-1, nan_policy="omit")
    middle = 0.5 * (np.count_nonzero(np.isfinite(table), axis=-1, keepdims=True) + 1.0)
    return np.nan_to_num(ranks - middle)


def of_machines(values: Array, machine: NDArray[np.int64]) -> Array:
    """(m,) mean of the values (n,) of each machine, by its number (n,), ascending."""
    _, place, counts = np.unique(machine, return_inverse=True, return_counts=True)
    return np.bincount(place, weights=values) / counts


def signed_ranks(differences: Array) -> float:
    """p-value of Wilcoxon's signed-rank test: that (n,), one a machine, lie evenly about 0."""
    if not differences.any():
        return 1.0
    return float(stats.wilcoxon(differences).pvalue)


def unpaired_difference(one: Array, other: Array) -> float:
    """p-value of the Mann-Whitney test: that two sets of machines come of one distribution."""
    if np.ptp(np.concatenate([one, other])) == 0.0:
        return 1.0
    return float(stats.mannwhitneyu(one, other).pvalue)


def holm(p_values: Array) -> Array:
    """p-values corrected for their number.

    Source: S. Holm, Scandinavian Journal of Statistics 6, 1979.
    """
    n = len(p_values)
    order = np.argsort(p_values)
    stepped = np.maximum.accumulate(p_values[order] * (n - np.arange(n)))
    corrected = np.empty(n)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected
