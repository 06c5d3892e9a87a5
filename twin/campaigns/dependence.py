"""How a number goes with the factors, where each machine flies every point of the grids.

Machines are drawn, runs are not: ten gains flown on twenty machines are twenty draws of what
differs between machines; and what a gain does is seen on twenty machines, however often on each.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from twin.campaigns.results import Results
from twin.campaigns.statistics import correlation_within, rank_correlation
from twin.interval import Interval

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
