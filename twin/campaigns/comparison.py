"""Two sets of runs held against each other, metric by metric."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.results import Results
from twin.campaigns.statistics import (
    bootstrap,
    holm,
    of_machines,
    ratio_of_means,
    signed_ranks,
    unpaired_difference,
)
from twin.interval import Interval

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
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
    """That there is no difference; corrected for the number of metrics."""


def between_arms(results: Results) -> tuple[Comparison, ...]:
    """Every two arms, on the samples that both flew."""
    found: list[Comparison] = []
    count = len(results.spec.arms)
    for a, b in combinations(range(count), 2):
        one, other = (results.spec.arms[number].name for number in (a, b))
        left, right = paired_rows(results, a, b)
        for metric, column in results.metrics.items():
            known = np.isfinite(column[left]) & np.isfinite(column[right])
            if np.count_nonzero(known) < 5:
                continue
            x, y = column[left[known]], column[right[known]]
            ratio = ratio_of_pairs(x, y, results.sample[left[known]])
            more = of_machines(y - x, results.machine[left[known]])
            found.append(Comparison(one, other, metric, len(x), len(more), ratio, *_sided(more)))
    return _corrected(found)


def paired_rows(results: Results, a: int, b: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of two arms, by number, that flew the same sample at the same point of the grids."""
    of_one, of_other = (_free(results, results.spec.arms[number].name) for number in (a, b))
    first = {run - a: row for run, row in zip(results.run[of_one], of_one, strict=True)}
    second = {run - b: row for run, row in zip(results.run[of_other], of_other, strict=True)}
    both = [key for key in first if key in second]
    left = np.array([first[key] for key in both], dtype=np.intp)
    return left, np.array([second[key] for key in both], dtype=np.intp)


def ratio_of_pairs(one: Array, other: Array, sample: NDArray[np.int64]) -> Interval:
    """Of the mean of the second set to that of the first, (n,) each, row by row of one sample."""
    return bootstrap((one, other), sample, _ratio)


def _free(results: Results, arm: str) -> NDArray[np.intp]:
    """Rows of an arm that a test may take for draws of their own."""
    rows = results.of(arm)
    return rows[results.free[rows]]


def between_campaigns(results: Results, against: Results) -> tuple[Comparison, ...]:
    """All runs of one campaign and all of another, arm by arm where both have it by name.

    Where both drew the same machines they are paired, machine by machine.
    """
    same = same_machines(results, against)
    found: list[Comparison] = []
    ours, theirs = ([arm.name for arm in r.spec.arms] for r in (results, against))
    couples = [(name, name) for name in ours if name in theirs]
    if not couples:
        couples = [(one, other) for one in ours for other in theirs]
    for one, other in couples:
        for metric in (name for name in results.metrics if name in against.metrics):
            rows, others = _free(results, one), _free(against, other)
            x, y = results.metrics[metric][rows], against.metrics[metric][others]
            x_known, y_known = np.isfinite(x), np.isfinite(y)
            if min(x_known.sum(), y_known.sum()) < 5:
                continue
            x, y, rows, others = x[x_known], y[y_known], rows[x_known], others[y_known]
            machine, machines = results.machine[rows], against.machine[others]
            x_mean, y_mean = of_machines(x, machine), of_machines(y, machines)
            names = f"{results.folder.name}: {one}", f"{against.folder.name}: {other}", metric
            both = np.intersect1d(machine, machines)
            if same and len(both) >= 5:
                left, right = (np.searchsorted(np.unique(m), both) for m in (machine, machines))
                x_mean, y_mean = x_mean[left], y_mean[right]
                ratio = ratio_of_pairs(x_mean, y_mean, both)
                sided = _sided(y_mean - x_mean)
                found.append(Comparison(*names, len(both), len(both), ratio, *sided))
                continue
            ratio = ratio_of_means((x, results.sample[rows]), (y, against.sample[others]))
            order = np.sort(x_mean)
            not_above = np.searchsorted(order, y_mean, side="right")
            below = np.searchsorted(order, y_mean)
            wins = 1.0 - float(np.mean(not_above) / len(order))
            ties = float(np.mean(not_above - below) / len(order))
            p = unpaired_difference(x_mean, y_mean)
            found.append(Comparison(*names, 0, 0, ratio, wins, ties, p))
    return _corrected(found)


def same_machines(results: Results, against: Results) -> bool:
    """Whether two campaigns drew the same of every factor that both spread, sample by sample."""
    ours, theirs = ({f.name for f in r.spec.dispersed} for r in (results, against))
    if not ours or ours != theirs:
        return False
    first = [dict(zip(r.machine[::-1].tolist(), range(len(r.run))[::-1], strict=True))
             for r in (results, against)]  # fmt: skip
    both = sorted(first[0].keys() & first[1].keys())
    left, right = ([rows[machine] for machine in both] for rows in first)
    return bool(both) and all(
        np.array_equal(results.factors[name][left], against.factors[name][right]) for name in ours
    )


def _sided(more: Array) -> tuple[float, float, float]:
    """Share of machines that have less, and as much, and the p-value of no difference."""
    return float(np.mean(more < 0.0)), float(np.mean(more == 0.0)), signed_ranks(more)


def _corrected(found: list[Comparison]) -> tuple[Comparison, ...]:
    corrected = holm(np.array([one.p for one in found]))
    return tuple(replace(one, p=float(p)) for one, p in zip(found, corrected, strict=True))


def _ratio(one: Array, other: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.mean(other, axis=-1) / np.mean(one, axis=-1))
