"""What a campaign says: distributions, sensitivities, worst runs and why, comparisons."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from twin.campaigns.comparison import Comparison, between_arms, between_campaigns
from twin.campaigns.conditions import Part, conditions
from twin.campaigns.dependence import dependences
from twin.campaigns.indices import Index, sobol_indices
from twin.campaigns.merit import METRICS
from twin.campaigns.results import Results
from twin.campaigns.statistics import bootstrap, holm, mean, quantile
from twin.interval import Interval
from twin.shown import Shown

Array = NDArray[np.float64]

WORST = 5
"""Runs named of each metric."""
HIGH = 0.95
"""Share of the runs that stay below the percentile that is told."""
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
class Sensitivity:
    """How one metric goes with one factor, over the machines of an arm."""

    arm: str
    metric: str
    factor: str
    correlation: Interval
    """Of ranks; with a factor on a grid, the mean of those that each machine has by itself."""
    certain: bool
    """Whether it is no chance, among all that were asked."""


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
    """Runs of each arm that touched the tilt stop, where a metric tells."""
    sensitivities: tuple[Sensitivity, ...]
    indices: tuple[Index, ...]
    """Where the campaign has a Saltelli design."""
    worst: tuple[Worst, ...]
    comparisons: tuple[Comparison, ...]
    conditions: tuple[Part, ...]
    """On what they depend."""
    against: Results | None = None
    """The campaign that these are held against."""


def answers(results: Results, against: Results | None = None) -> Answers:
    """Everything that there is to say.

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
            own = known[results.free[known]]
            for factor, found, p in dependences(results, own, column[own]):
                if np.isfinite(found.value):
                    links.append((arm, metric, factor, found, p))
    corrected = holm(np.array([link[-1] for link in links]))
    sensitivities = tuple(
        Sensitivity(*link[:-1], bool(p < CERTAIN)) for link, p in zip(links, corrected, strict=True)
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
            for point, there in zip(at, runs, strict=True):
                known = there[np.isfinite(column[there])]
                if known.size:
                    own, sample = column[known], results.sample[known]
                    median, high = (quantile(own, sample, share) for share in (0.5, HIGH))
                    yield AtPoint(arm.name, point, metric, len(known), median, high)


def _at_stop(results: Results) -> dict[str, int]:
    found: dict[str, int] = {}
    if "tilt_max" not in results.metrics:
        return found
    for arm in results.spec.arms:
        platform, tilt = arm.platform, results.metrics["tilt_max"][results.of(arm.name)]
        touched = int(np.count_nonzero(tilt >= platform.stop_angle))
        if touched and platform.base.kind == "ball" and platform.pitch_stop is None:
            found[arm.name] = touched
    return found


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


def _worst(results: Results, links: Sequence[Sensitivity]) -> tuple[Worst, ...]:
    found: list[Worst] = []
    for metric, column in results.metrics.items():
        side = METRICS[metric].worse
        known = np.flatnonzero(np.isfinite(column))
        if not side or not known.size or np.ptp(column[known]) == 0.0:
            continue
        order = known[np.argsort(-side * column[known], kind="stable")][:WORST]
        for row in order.tolist():
            arm = str(results.arm[row])
            own = [s for s in links if s.arm == arm and s.metric == metric and s.certain]
            blamed = _blamed(results, row, own, side)
            found.append(Worst(int(results.run[row]), arm, metric, float(column[row]), blamed))
    return tuple(found)


def _blamed(
    results: Results, row: int, links: Sequence[Sensitivity], side: int
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
