"""What a campaign shows: distributions, sensitivities, Sobol indices, worst runs, comparisons.

How a number goes with the factors, where each machine flies every point of the grids.
Machines are drawn, runs are not: ten gains flown on twenty machines are twenty draws of what
differs between machines; and what a gain does is seen on twenty machines, however often on each.

On what a comparison of two arms depends: the same ratio in each part of a factor's range.
A mean over all machines may hide that one way is better on some and worse on others.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import ndtri

from twin.campaigns.merit import METRICS
from twin.campaigns.results import Results
from twin.campaigns.statistics import (
    ArmComparison,
    between_arms,
    between_campaigns,
    bootstrap,
    correlation_within,
    holm,
    mean,
    paired_rows,
    quantile,
    rank_correlation,
    ratio_of_pairs,
)
from twin.interval import Interval
from twin.shown import Shown

Array = NDArray[np.float64]


def dependences(
    results: Results, rows: NDArray[np.intp], numbers: Array
) -> Iterator[tuple[str, Interval, float]]:
    """Rank correlation of a number with each factor, and the p-value that there is none.

    Of a factor that is drawn, a machine counts once: with the mean of its ranks, each among the
    machines at one point of the grids. So each point counts alike, however large the number is
    there, and a machine that failed where others are bad does not look better for it.

    Of a factor on a grid, it is the mean correlation within the machines: see `correlation_within`.
    A block are runs that differ in nothing else.

    Args:
        results: of a campaign.
        rows: (n,) of one arm, and free.
        numbers: (n,) finite, of these rows.
    """
    machines, place = np.unique(results.machine[rows], return_inverse=True)
    grids = grids_within(results)
    shape = tuple(len(values) for values in reversed(grids.values()))  # the first turns fastest
    table = np.full((len(machines), math.prod(shape)), np.nan)
    combination = results.run[rows] % results.spec.points // len(results.spec.arms)
    table[place, combination if grids else 0] = numbers
    cube, mean_ranks = table.reshape(len(machines), *shape), _mean_ranks(table)
    axes = {name: -1 - number for number, name in enumerate(grids)}
    for factor, values in results.causes.items():
        name = factor.strip("|")
        if name in grids:
            levels = np.abs(grids[name]) if name != factor else grids[name]
            blocks = np.moveaxis(cube, axes[name], -1).reshape(len(cube), -1, len(levels))
            yield factor, *correlation_within(blocks, levels)
        else:
            drawn = np.empty(len(machines))
            drawn[place] = values[rows]
            yield factor, *rank_correlation(drawn, mean_ranks)


def grids_within(results: Results) -> dict[str, Array]:
    """Factors that differ within a machine, with their values (k,), in the order of the grids."""
    if not results.spec.dispersed:
        return {}  # each run stands for itself
    return {factor.name: np.array(values) for factor, values in results.spec.grids}


def _mean_ranks(table: Array) -> Array:
    """(machines,) mean over the points (machines, points) of the share of machines below there."""
    known = np.isfinite(table)
    ranks = stats.rankdata(table, axis=0, nan_policy="omit")
    shares = (ranks - 0.5) / np.maximum(np.count_nonzero(known, axis=0), 1)
    return np.nansum(shares, axis=1) / np.count_nonzero(known, axis=1)


PARTS = 5
"""Of a factor's range, of as many machines each."""
MIN_MACHINES = 5
"""Machines of a part."""
STRONG = 0.3
"""Rank correlation of the ratio with a factor, from which on it is worth a table."""
CERTAIN_FACTOR = 0.05
"""Level of significance, after correction for the number of factors and metrics."""


@dataclass(frozen=True)
class FactorPart:
    """Of one metric of two arms, on the machines of one part of a factor's range."""

    one: str
    other: str
    metric: str
    factor: str
    low: float
    high: float
    pairs: int
    ratio: Interval
    """Of the mean of `other` to that of `one`."""


def conditions(results: Results) -> tuple[FactorPart, ...]:
    """Parts of the factor on which each ratio depends most; none of a ratio that depends on none.

    Only metrics that are above zero have ratios of single machines, and a rank correlation.
    """
    candidates: list[tuple[int, int, str, str, float, float]] = []
    arms, grids = range(len(results.spec.arms)), grids_within(results)
    for a, b in combinations(arms, 2):
        for metric in results.metrics:
            rows_a, x, y = _pairs(results, a, b, metric)
            machines = len(np.unique(results.machine[rows_a]))
            if machines < MIN_MACHINES or min(x.min(), y.min()) <= 0.0:
                continue
            for factor, result, p in dependences(results, rows_a, y / x):
                # every machine is in each part of a grid
                enough = factor.strip("|") in grids or machines >= MIN_MACHINES * PARTS
                if enough and np.isfinite(result.value):
                    candidates.append((a, b, metric, factor, abs(result.value), p))
    corrected = holm(np.array([item[-1] for item in candidates]))
    strongest: dict[tuple[int, int, str], tuple[float, str]] = {}
    for (a, b, metric, factor, size, _), p in zip(candidates, corrected, strict=True):
        if p < CERTAIN_FACTOR and size >= STRONG:
            key = (a, b, metric)
            strongest[key] = max(strongest.get(key, (0.0, "")), (size, factor))
    parts: list[FactorPart] = []
    for (a, b, metric), (_, factor) in strongest.items():
        parts += _parts(results, a, b, metric, factor)
    return tuple(parts)


def _parts(results: Results, a: int, b: int, metric: str, factor: str) -> list[FactorPart]:
    rows_a, x, y = _pairs(results, a, b, metric)
    values = results.causes[factor][rows_a]
    item, other = (results.spec.arms[number].name for number in (a, b))
    parts: list[FactorPart] = []
    within = factor.strip("|") in grids_within(results)
    for rows in _split(values, np.arange(len(rows_a)) if within else results.machine[rows_a]):
        ratio = ratio_of_pairs(x[rows], y[rows], results.sample[rows_a][rows])
        ends = float(values[rows].min()), float(values[rows].max())
        parts.append(FactorPart(item, other, metric, factor, *ends, len(rows), ratio))
    return parts


def _split(values: Array, together: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Rows of each part; values of a grid, if they are few, are parts of their own.

    Args:
        values: (n,).
        together: (n,) rows of one of these have one value, and stay in one part.
    """
    different = np.unique(values)
    if len(different) <= PARTS:
        return [np.flatnonzero(values == value) for value in different]
    order = np.argsort(values, kind="stable")
    _, first, place = np.unique(together, return_index=True, return_inverse=True)
    parts = np.array_split(np.argsort(values[first], kind="stable"), PARTS)
    return [order[np.isin(place[order], part)] for part in parts if part.size]


def _pairs(results: Results, a: int, b: int, metric: str) -> tuple[NDArray[np.intp], Array, Array]:
    """Rows of the first arm, and the metric of both where both have it."""
    rows_a, right = paired_rows(results, a, b)
    column = results.metrics[metric]
    known = np.isfinite(column[rows_a]) & np.isfinite(column[right])
    return rows_a[known], column[rows_a[known]], column[right[known]]


MIN_POINTS = 16
"""Points of a design of which indices are computed."""


@dataclass(frozen=True)
class Index:
    """What one factor does to one metric, over the runs of an arm."""

    arm: str
    metric: str
    factor: str
    first: Interval
    """First-order index: share of the variance that the factor explains alone."""
    total: Interval
    """Total index: share that the factor explains alone and together with others."""
    count: int
    """Points of the design of which all runs have the metric."""


def sobol_indices(results: Results) -> tuple[Index, ...]:
    """Of each metric and factor; none where the campaign has no Saltelli design.

    Points of which a run has not come, or failed, are left out whole.
    """
    spec = results.spec
    if spec.sampling != "saltelli":
        return ()
    place = (results.run // spec.points) % spec.together
    indexes: list[Index] = []
    for arm in (item.name for item in spec.arms):
        rows = results.of(arm)
        points, row_of = np.unique(results.sample[rows], return_inverse=True)
        for metric, column in results.metrics.items():
            values = np.full((len(points), spec.together), np.nan)
            values[row_of, place[rows]] = column[rows]
            values = values[np.isfinite(values).all(axis=1)]
            if len(values) < MIN_POINTS or np.ptp(values[:, :2]) == 0.0:
                continue
            for number, factor in enumerate(spec.dispersed):
                first, total = indices_of(values, number)
                indexes.append(Index(arm, metric, factor.name, first, total, len(values)))
    return tuple(indexes)


def indices_of(values: Array, factor: int) -> tuple[Interval, Interval]:
    """First-order and total index of a factor, each with its bootstrap interval.

    The bootstrap resamples points as if they were independent; those of a Sobol sequence are more
    even than that, so its intervals are rather too wide.

    Source: A. Saltelli et al., Computer Physics Communications 181, 2010, table 2 (b) and (f).

    Args:
        values: (points, 2 + factors) of a design: at the first half, at the second, and at the
            first with each factor from the second.
        factor: which one.
    """
    columns = (values[:, 0], values[:, 1], values[:, 2 + factor])
    points = np.arange(len(values))
    return bootstrap(columns, points, _first), bootstrap(columns, points, _total)


def _first(first: Array, other: Array, mixed: Array) -> Array:
    middle = 0.5 * (first.mean(axis=-1, keepdims=True) + other.mean(axis=-1, keepdims=True))
    return np.mean((other - middle) * (mixed - first), axis=-1) / _variance(first, other)


def _total(first: Array, other: Array, mixed: Array) -> Array:
    return 0.5 * np.mean((first - mixed) ** 2, axis=-1) / _variance(first, other)


def _variance(first: Array, other: Array) -> Array:
    """Of the two halves, which are independent."""
    return np.var(np.concatenate([first, other], axis=-1), axis=-1)


WORST = 5
"""Runs named of each metric."""
HIGH = 0.95
"""Share of the runs below the percentile that is reported."""
BLAMED = 2
"""Factors named of each of these."""
CERTAIN = 0.05
"""Level of significance, after correction for the number of tests."""


@dataclass(frozen=True)
class Spread:
    """How one metric is distributed over the runs of an arm."""

    arm: str
    metric: str
    count: int
    """Runs that have it."""
    mean: Interval
    median: Interval
    high: Interval
    """95th percentile."""


@dataclass(frozen=True)
class AtPoint:
    """How one metric is distributed at one point of the grids, over the machines of an arm."""

    arm: str
    at: tuple[tuple[str, float], ...]
    """Factors that are on a grid, and their values there."""
    metric: str
    count: int
    """Runs that have it."""
    median: Interval
    high: Interval
    """95th percentile."""


@dataclass(frozen=True)
class MetricSensitivity:
    """How one metric goes with one factor, over the machines of an arm."""

    arm: str
    metric: str
    factor: str
    correlation: Interval
    """Rank correlation; with a factor on a grid, the mean over machines of each machine's."""
    certain: bool
    """Whether it is significant, corrected for the number of correlations tested."""


class Blamed(NamedTuple):
    """A factor far out on the side to which a metric gets worse."""

    factor: str
    value: float
    below: float
    """Share of the runs that have less."""
    above: float
    """And more."""


@dataclass(frozen=True)
class Worst:
    """A run that came out badly."""

    run: int
    arm: str
    metric: str
    value: float
    blamed: tuple[Blamed, ...]
    """Factors that may have done it."""


@dataclass(frozen=True)
class Answers(Shown):
    """Of a campaign as far as it is flown."""

    results: Results
    ended: dict[str, dict[str, int]]
    """Of each arm: how its runs ended."""
    reasons: tuple[tuple[str, int, int], ...]
    """Why runs did not come to their end: sentence without its numbers, count, first such run."""
    spreads: tuple[Spread, ...]
    points: tuple[AtPoint, ...]
    """Of each arm, metric by metric; none without a grid."""
    at_stop: dict[str, int]
    """Runs of each arm that touched the tilt stop, where a metric shows it."""
    sensitivities: tuple[MetricSensitivity, ...]
    indices: tuple[Index, ...]
    """Where the campaign has a Saltelli design."""
    worst: tuple[Worst, ...]
    comparisons: tuple[ArmComparison, ...]
    conditions: tuple[FactorPart, ...]
    """On what they depend."""
    against: Results | None = None
    """The campaign that this one is compared with."""


def answers(results: Results, against: Results | None = None) -> Answers:
    """Evaluate a campaign.

    Args:
        results: of a campaign.
        against: of another one, whose metrics of the same names are compared.
    """
    names = [arm.name for arm in results.spec.arms]
    spreads: list[Spread] = []
    links: list[tuple[str, str, str, Interval, float]] = []
    for arm in names:
        rows = results.of(arm)
        for metric, column in results.metrics.items():
            known = rows[np.isfinite(column[rows])]
            if not known.size:
                continue
            spreads.append(_spread(arm, metric, column[known], results.sample[known]))
            free = known[results.free[known]]
            for factor, result, p in dependences(results, free, column[free]):
                if np.isfinite(result.value):
                    links.append((arm, metric, factor, result, p))
    corrected = holm(np.array([link[-1] for link in links]))
    sensitivities = tuple(
        MetricSensitivity(*link[:-1], bool(p < CERTAIN))
        for link, p in zip(links, corrected, strict=True)
    )
    comparisons = between_arms(results) if len(names) > 1 else ()
    if against is not None:
        comparisons = (*comparisons, *between_campaigns(results, against))
    return Answers(
        results=results,
        ended={arm: dict(Counter(results.ended[results.of(arm)].tolist())) for arm in names},
        reasons=_reasons(results),
        spreads=tuple(spreads),
        points=tuple(_at_points(results)),
        at_stop=_at_stop(results),
        sensitivities=sensitivities,
        indices=sobol_indices(results),
        worst=_worst(results, sensitivities),
        comparisons=comparisons,
        conditions=conditions(results) if len(names) > 1 else (),
        against=against,
    )


def _spread(arm: str, metric: str, column: Array, sample: NDArray[np.int64]) -> Spread:
    return Spread(
        arm,
        metric,
        len(column),
        bootstrap((column,), sample, mean),
        quantile(column, sample, 0.5),
        quantile(column, sample, HIGH),
    )


def _at_points(results: Results) -> Iterator[AtPoint]:
    grids = results.spec.grids
    if not grids:
        return
    for arm in results.spec.arms:
        rows = results.of(arm.name)
        values = np.column_stack([results.factors[factor.name][rows] for factor, _ in grids])
        points, place = np.unique(values, axis=0, return_inverse=True)
        at = [tuple(zip((f.name for f, _ in grids), p, strict=True)) for p in points.tolist()]
        runs = [rows[place == number] for number in range(len(points))]
        for metric, column in results.metrics.items():
            for point, run in zip(at, runs, strict=True):
                known = run[np.isfinite(column[run])]
                if known.size:
                    free, sample = column[known], results.sample[known]
                    median, high = (quantile(free, sample, share) for share in (0.5, HIGH))
                    yield AtPoint(arm.name, point, metric, len(known), median, high)


def _at_stop(results: Results) -> dict[str, int]:
    result: dict[str, int] = {}
    if "tilt_max" not in results.metrics:
        return result
    for arm in results.spec.arms:
        platform, tilt = arm.platform, results.metrics["tilt_max"][results.of(arm.name)]
        touched = int(np.count_nonzero(tilt >= platform.stop_angle))
        if touched and platform.base.kind == "ball" and platform.pitch_stop is None:
            result[arm.name] = touched
    return result


def _reasons(results: Results) -> tuple[tuple[str, int, int], ...]:
    count: Counter[str] = Counter()
    first: dict[str, int] = {}
    for run, reason in zip(results.run.tolist(), results.reason, strict=True):
        if reason:
            plain = _without_numbers(reason)
            count[plain] += 1
            first.setdefault(plain, run)
    return tuple((reason, number, first[reason]) for reason, number in count.most_common())


def _without_numbers(reason: str) -> str:
    words = (
        "..." if any(c.isdigit() for c in word) else word
        for word in reason.split("(at ")[0].split()
    )
    return " ".join(words)


def _worst(results: Results, links: Sequence[MetricSensitivity]) -> tuple[Worst, ...]:
    worsts: list[Worst] = []
    for metric, column in results.metrics.items():
        side = METRICS[metric].worse
        known = np.flatnonzero(np.isfinite(column))
        if not side or not known.size or np.ptp(column[known]) == 0.0:
            continue
        order = known[np.argsort(-side * column[known], kind="stable")][:WORST]
        for row in order.tolist():
            arm = str(results.arm[row])
            free = [s for s in links if s.arm == arm and s.metric == metric and s.certain]
            blamed = _blamed(results, row, free, side)
            worsts.append(Worst(int(results.run[row]), arm, metric, float(column[row]), blamed))
    return tuple(worsts)


def _blamed(
    results: Results, row: int, links: Sequence[MetricSensitivity], side: int
) -> tuple[Blamed, ...]:
    """The strongest first."""
    rows, causes = results.of(str(results.arm[row])), results.causes
    scored: list[tuple[float, Blamed]] = []
    for link in links:
        values = causes[link.factor][rows]
        value = causes[link.factor][row]
        below, above = float(np.mean(values < value)), float(np.mean(values > value))
        middle = np.clip(0.5 + 0.5 * (below - above), 1e-6, 1.0 - 1e-6)
        push = side * link.correlation.value * float(ndtri(middle))
        if push > 0.0:
            scored.append((push, Blamed(link.factor, float(value), below, above)))
    scored.sort(reverse=True)
    return tuple(blamed for _, blamed in scored[:BLAMED])
