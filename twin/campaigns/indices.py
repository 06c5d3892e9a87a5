"""How much of a metric's variance each factor explains: Sobol indices of a Saltelli design."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.results import Results
from twin.campaigns.statistics import bootstrap
from twin.interval import Interval

Array = NDArray[np.float64]

FEWEST = 16
"""Points of a design of which indices are computed."""


@dataclass(frozen=True)
class Index:
    """What one factor does to one metric, over the runs of an arm."""

    arm: str
    metric: str
    factor: str
    first: Interval
    """Share of the variance that it explains by itself."""
    total: Interval
    """Share that is explained by it and by whatever it does together with others."""
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
    found: list[Index] = []
    for arm in (one.name for one in spec.arms):
        rows = results.of(arm)
        points, row_of = np.unique(results.sample[rows], return_inverse=True)
        for metric, column in results.metrics.items():
            values = np.full((len(points), spec.together), np.nan)
            values[row_of, place[rows]] = column[rows]
            values = values[np.isfinite(values).all(axis=1)]
            if len(values) < FEWEST or np.ptp(values[:, :2]) == 0.0:
                continue
            for number, factor in enumerate(spec.dispersed):
                first, total = indices_of(values, number)
                found.append(Index(arm, metric, factor.name, first, total, len(values)))
    return tuple(found)


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


def _first(one: Array, other: Array, mixed: Array) -> Array:
    middle = 0.5 * (one.mean(axis=-1, keepdims=True) + other.mean(axis=-1, keepdims=True))
    return np.mean((other - middle) * (mixed - one), axis=-1) / _variance(one, other)


def _total(one: Array, other: Array, mixed: Array) -> Array:
    return 0.5 * np.mean((one - mixed) ** 2, axis=-1) / _variance(one, other)


def _variance(one: Array, other: Array) -> Array:
    """Of the two halves, which are independent."""
    return np.var(np.concatenate([one, other], axis=-1), axis=-1)
