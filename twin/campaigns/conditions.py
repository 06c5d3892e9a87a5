"""On what a comparison of two arms depends: the same ratio in each part of a factor's range.

A mean over all machines may hide that one way is better on some and worse on others.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.comparison import paired_rows, ratio_of_pairs
from twin.campaigns.dependence import dependences, grids_within
from twin.campaigns.results import Results
from twin.campaigns.statistics import holm
from twin.interval import Interval

Array = NDArray[np.float64]

PARTS = 5
"""Of a factor's range, of as many machines each."""
FEWEST = 5
"""Machines of a part."""
STRONG = 0.3
"""Rank correlation of the ratio with a factor, from which on it is worth a table."""
CERTAIN = 0.05
"""Level of significance, after correction for the number of factors and metrics."""


@dataclass(frozen=True)
class Part:
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


def conditions(results: Results) -> tuple[Part, ...]:
    """Parts of the factor on which each ratio depends most; none of a ratio that depends on none.

    Only metrics that are above zero have ratios of single machines, whose ranks tell.
    """
    asked: list[tuple[int, int, str, str, float, float]] = []
    arms, grids = range(len(results.spec.arms)), grids_within(results)
    for a, b in combinations(arms, 2):
        for metric in results.metrics:
            left, x, y = _pairs(results, a, b, metric)
            machines = len(np.unique(results.machine[left]))
            if machines < FEWEST or min(x.min(), y.min()) <= 0.0:
                continue
            for factor, found, p in dependences(results, left, y / x):
                # every machine is in each part of a grid
                enough = factor.strip("|") in grids or machines >= FEWEST * PARTS
                if enough and np.isfinite(found.value):
                    asked.append((a, b, metric, factor, abs(found.value), p))
    corrected = holm(np.array([one[-1] for one in asked]))
    strongest: dict[tuple[int, int, str], tuple[float, str]] = {}
    for (a, b, metric, factor, size, _), p in zip(asked, corrected, strict=True):
        if p < CERTAIN and size >= STRONG:
            key = (a, b, metric)
            strongest[key] = max(strongest.get(key, (0.0, "")), (size, factor))
    parts: list[Part] = []
    for (a, b, metric), (_, factor) in strongest.items():
        parts += _parts(results, a, b, metric, factor)
    return tuple(parts)


def _parts(results: Results, a: int, b: int, metric: str, factor: str) -> list[Part]:
    left, x, y = _pairs(results, a, b, metric)
    values = results.causes[factor][left]
    one, other = (results.spec.arms[number].name for number in (a, b))
    found: list[Part] = []
    within = factor.strip("|") in grids_within(results)
    for rows in _split(values, np.arange(len(left)) if within else results.machine[left]):
        ratio = ratio_of_pairs(x[rows], y[rows], results.sample[left][rows])
        ends = float(values[rows].min()), float(values[rows].max())
        found.append(Part(one, other, metric, factor, *ends, len(rows), ratio))
    return found


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
    left, right = paired_rows(results, a, b)
    column = results.metrics[metric]
    known = np.isfinite(column[left]) & np.isfinite(column[right])
    return left[known], column[left[known]], column[right[known]]
