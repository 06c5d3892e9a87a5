"""Bootstrap intervals, rank correlations, tests of a difference, two sets of runs compared.

Statistics of metrics: bootstrap intervals, rank correlations, tests of a difference.
Runs of one sample are flown on the same machine and are no independent draws: whatever is resampled
is resampled by samples, and whatever is tested is one number a machine.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from twin.campaigns.results import Results
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
    first: tuple[Array, NDArray[np.int64]], other: tuple[Array, NDArray[np.int64]]
) -> Interval:
    """Of the second of two sets that share nothing; each is its values (n,) and their samples."""
    below, above = (
        resampled((values,), sample, mean, seed=seed)
        for seed, (values, sample) in enumerate((first, other))
    )
    many = min(len(below), len(above))
    draws = min(len(np.unique(sample)) for _, sample in (first, other))
    with np.errstate(divide="ignore", invalid="ignore"):
        value = float(np.divide(np.mean(other[0]), np.mean(first[0])))
        return _interval(value, above[:many] / below[:many], draws)


def quantile(values: Array, sample: NDArray[np.int64], share: float) -> Interval:
    """A quantile with the interval that order statistics give, whatever the distribution.

    With few draws an end is infinite: the bound lies outside the sample. Rows of one sample
    count as one draw, so that the interval is rather too wide where they differ.

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
    result: list[Array] = []
    for first in range(0, times, block):
        picked = draw.integers(len(starts), size=(min(block, times - first), len(starts)))
        if table is not None:
            rows = table[picked].reshape(len(picked), -1)
        else:
            rows = np.concatenate([parts[number] for number in picked[0]])[None]
        result.append(np.asarray(statistic(*(column[rows] for column in columns))))
    return np.concatenate(result)


def mean(values: Array) -> Array:
    """Over the last axis."""
    return np.asarray(np.mean(values, axis=-1))


def _interval(value: float, result: Array, draws: int) -> Interval:
    """Of resamples, as much wider as Student's t of few draws is than the normal distribution.

    Source: T. C. Hesterberg, The American Statistician 69, 2015, section 4.3.
    """
    known = result[np.isfinite(result)]
    if draws < FEWEST or not known.size:
        return Interval(value, np.nan, np.nan)
    tail = stats.norm.cdf(np.sqrt(draws / (draws - 1.0)) * stats.t.ppf(0.025, draws - 1))
    low, high = np.quantile(known, [tail, 1.0 - tail])
    return Interval(value, float(low), float(high))


def rank_correlation(first: Array, other: Array) -> tuple[Interval, float]:
    """Spearman's rho with its 95 % interval by Fisher's z, and the p-value of none.

    Source: D. G. Bonett, T. A. Wright, Psychometrika 65, 2000, for the interval's width.
    """
    n = len(first)
    if n < 5 or np.ptp(first) == 0.0 or np.ptp(other) == 0.0:
        return Interval(np.nan, np.nan, np.nan), 1.0
    result = stats.spearmanr(first, other)
    rho = float(np.clip(result.statistic, -0.999999, 0.999999))
    half = 1.96 * np.sqrt((1.0 + 0.5 * rho**2) / (n - 3))
    low, high = np.tanh(np.arctanh(rho) + np.array([-half, half]))
    return Interval(rho, float(low), float(high)), float(result.pvalue)


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
    item, other = (_centred_ranks(np.where(known, values, np.nan)) for values in (table, levels))
    across = np.sum(other**2, axis=-1)
    informative = across > 0.0  # a block of a single level says nothing
    machines = informative.any(axis=-1)
    size = np.sqrt(np.sum(item**2, axis=-1) * across)
    rho = np.sum(item * other, axis=-1) / np.where(size > 0.0, size, 1.0)
    # from the lowest, so that the slope of what does not change is 0 and no rounding
    lowest = np.min(table, axis=-1, keepdims=True, initial=np.inf, where=known)
    rise = np.where(known, table - lowest, 0.0)
    slope = np.sum(rise * other, axis=-1) / np.where(informative, across, 1.0)
    within, slopes = (
        np.sum(values[machines], axis=-1) / np.sum(informative[machines], axis=-1)
        for values in (rho, slope)
    )
    if len(within) < 5 or not within.any():
        return Interval(np.nan, np.nan, np.nan), 1.0
    return bootstrap((within,), np.arange(len(within)), mean), signed_ranks(slopes)


def _centred_ranks(table: Array) -> Array:
    """Ranks over the last axis less their mean; 0 where the value is NaN."""
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


def unpaired_difference(first: Array, other: Array) -> float:
    """p-value of the Mann-Whitney test: that two sets of machines come of one distribution."""
    if np.ptp(np.concatenate([first, other])) == 0.0:
        return 1.0
    return float(stats.mannwhitneyu(first, other).pvalue)


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


@dataclass(frozen=True)
class ArmComparison:
    """Of one metric."""

    one: str
    other: str
    metric: str
    pairs: int
    """Runs on the same machines that both have; 0 where the sets are not paired."""
    machines: int
    """Of these pairs: what the test counts, with the mean of a machine's pairs."""
    ratio: Interval
    """Of the mean of `other` to that of `one`."""
    wins: float
    """Share of machines on which `other` is smaller on average; of all couples of a machine of each
    set where these are not paired."""
    ties: float
    """Share on which both are the same."""
    p: float
    """p-value of no difference, corrected for the number of metrics."""


def between_arms(results: Results) -> tuple[ArmComparison, ...]:
    """Every two arms, on the samples that both flew."""
    comparisons: list[ArmComparison] = []
    count = len(results.spec.arms)
    for a, b in combinations(range(count), 2):
        item, other = (results.spec.arms[number].name for number in (a, b))
        rows_a, rows_b = paired_rows(results, a, b)
        for metric, column in results.metrics.items():
            known = np.isfinite(column[rows_a]) & np.isfinite(column[rows_b])
            if np.count_nonzero(known) < 5:
                continue
            x, y = column[rows_a[known]], column[rows_b[known]]
            ratio = ratio_of_pairs(x, y, results.sample[rows_a[known]])
            more = of_machines(y - x, results.machine[rows_a[known]])
            comparisons.append(
                ArmComparison(item, other, metric, len(x), len(more), ratio, *_sided(more))
            )
    return _corrected(comparisons)


def paired_rows(results: Results, a: int, b: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of two arms, by number, that flew the same sample at the same point of the grids."""
    of_first, of_other = (_free(results, results.spec.arms[number].name) for number in (a, b))
    first = {run - a: row for run, row in zip(results.run[of_first], of_first, strict=True)}
    second = {run - b: row for run, row in zip(results.run[of_other], of_other, strict=True)}
    both = [key for key in first if key in second]
    rows_a = np.array([first[key] for key in both], dtype=np.intp)
    return rows_a, np.array([second[key] for key in both], dtype=np.intp)


def ratio_of_pairs(first: Array, other: Array, sample: NDArray[np.int64]) -> Interval:
    """Of the mean of the second set to that of the first, (n,) each, row by row of one sample."""
    return bootstrap((first, other), sample, _ratio)


def _free(results: Results, arm: str) -> NDArray[np.intp]:
    """Rows of an arm that a test may take as independent draws."""
    rows = results.of(arm)
    return rows[results.free[rows]]


def between_campaigns(results: Results, against: Results) -> tuple[ArmComparison, ...]:
    """All runs of one campaign and all of another, arm by arm where both have it by name.

    Where both drew the same machines they are paired, machine by machine.
    """
    same = same_machines(results, against)
    comparisons: list[ArmComparison] = []
    ours, theirs = ([arm.name for arm in r.spec.arms] for r in (results, against))
    couples = [(name, name) for name in ours if name in theirs]
    if not couples:
        couples = [(our, other) for our in ours for other in theirs]
    for item, other in couples:
        for metric in (name for name in results.metrics if name in against.metrics):
            rows, others = _free(results, item), _free(against, other)
            x, y = results.metrics[metric][rows], against.metrics[metric][others]
            x_known, y_known = np.isfinite(x), np.isfinite(y)
            if min(x_known.sum(), y_known.sum()) < 5:
                continue
            x, y, rows, others = x[x_known], y[y_known], rows[x_known], others[y_known]
            machine, machines = results.machine[rows], against.machine[others]
            x_mean, y_mean = of_machines(x, machine), of_machines(y, machines)
            names = f"{results.folder.name}: {item}", f"{against.folder.name}: {other}", metric
            both = np.intersect1d(machine, machines)
            if same and len(both) >= 5:
                rows_a, rows_b = (np.searchsorted(np.unique(m), both) for m in (machine, machines))
                x_mean, y_mean = x_mean[rows_a], y_mean[rows_b]
                ratio = ratio_of_pairs(x_mean, y_mean, both)
                sided = _sided(y_mean - x_mean)
                comparisons.append(ArmComparison(*names, len(both), len(both), ratio, *sided))
                continue
            ratio = ratio_of_means((x, results.sample[rows]), (y, against.sample[others]))
            order = np.sort(x_mean)
            not_above = np.searchsorted(order, y_mean, side="right")
            below = np.searchsorted(order, y_mean)
            wins = 1.0 - float(np.mean(not_above) / len(order))
            ties = float(np.mean(not_above - below) / len(order))
            p = unpaired_difference(x_mean, y_mean)
            comparisons.append(ArmComparison(*names, 0, 0, ratio, wins, ties, p))
    return _corrected(comparisons)


def same_machines(results: Results, against: Results) -> bool:
    """Whether two campaigns drew the same of every factor that both spread, sample by sample."""
    ours, theirs = ({f.name for f in r.spec.dispersed} for r in (results, against))
    if not ours or ours != theirs:
        return False
    first = [dict(zip(r.machine[::-1].tolist(), range(len(r.run))[::-1], strict=True))
             for r in (results, against)]  # fmt: skip
    both = sorted(first[0].keys() & first[1].keys())
    rows_a, rows_b = ([rows[machine] for machine in both] for rows in first)
    return bool(both) and all(
        np.array_equal(results.factors[name][rows_a], against.factors[name][rows_b])
        for name in ours
    )


def _sided(more: Array) -> tuple[float, float, float]:
    """Share of machines that have less, and as much, and the p-value of no difference."""
    return float(np.mean(more < 0.0)), float(np.mean(more == 0.0)), signed_ranks(more)


def _corrected(comparisons: list[ArmComparison]) -> tuple[ArmComparison, ...]:
    corrected = holm(np.array([item.p for item in comparisons]))
    return tuple(replace(item, p=float(p)) for item, p in zip(comparisons, corrected, strict=True))


def _ratio(first: Array, other: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.mean(other, axis=-1) / np.mean(first, axis=-1))
