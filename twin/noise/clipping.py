"""Samples at the end of a sensor's range, where nobody stated the range.

Beyond its range a sensor gives the same extreme value again and again. Noise would have changed
that value, and a sensor that hung repeats any value, rarely the largest one of the log. Where a
coarse grid hides the noise, only an extreme value far more frequent than all others counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.noise.quantisation import resolution_of
from twin.noise.stopped import chance_of_a_repeat, repeats_needed, runs_of, usual_run
from twin.noise.stream import noise_of
from twin.recording import Series

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]

CLIPPED = ("gyro", "joint_rate", "accelerometer", "magnetometer")
"""Streams whose sensors have a range that the machine can leave. An angle may really stay where it
is largest, at a stop, and a wheel at its largest speed."""
SAME = 1e-9
"""Of a value: rounding that another unit leaves in it."""
LARGE = 0.5
"""Of the largest value of a column, either sign: an end of the range is at least so large. A rate
that is never negative is at rest at its smallest value."""
FEWEST = 5
"""Repeated rows at an end, at least."""
NEIGHBOURS = 3
"""Rows on either side of one at an end that are not used. Near an end, only the rows whose noise
points inwards stay off it: used alone, they would bend the motion inwards too."""
SHARE, STRETCH, OFTEN = 0.02, 5, 10.0
"""On a grid that hides the noise: share of the rows at an end, rows of each of at least two
stretches there, and times the rows at the most frequent value that is no end."""


@dataclass(frozen=True)
class RangeEnds:
    """Samples at the ends of a range."""

    rows: Mask
    """(m,) rows in which at least one column is at an end."""
    ends: tuple[float, ...]
    """The values of the ends, in the stream's unit, rising."""


def range_ends(series: Series) -> RangeEnds:
    """The samples at the ends of a range that shows in the data.

    Args:
        series: m rows of a sensor.
    """
    rows = np.zeros(len(series), dtype=np.bool_)
    ends: list[float] = []
    if len(series) <= FEWEST or series.stands_still:
        return RangeEnds(rows, ())
    value = series.value
    high, low = value.max(axis=0), value.min(axis=0)
    at_ends: Mask = np.stack([_same(value, high), _same(value, low)])
    inside = ~(at_ends & (high > low)).any(axis=(0, 2))
    noise = noise_of(series.only(inside)) if inside.any() else np.zeros(value.shape[1])
    stuck = np.r_[False, (np.diff(value, axis=0) == 0.0).all(axis=1)]
    stuck &= ~np.all(at_ends[0] | at_ends[1], axis=1)
    for column in range(value.shape[1]):
        peak = max(abs(high[column]), abs(low[column]))
        for end, at in zip((high[column], low[column]), at_ends[:, :, column], strict=True):
            if abs(end) < LARGE * peak or high[column] == low[column]:
                continue
            # a row in which all columns repeat is of a sensor that hung
            if _is_end(value[:, column], at & ~stuck, at_ends[:, :, column], noise[column], peak):
                rows |= at
                ends.append(float(end))
    return RangeEnds(rows, tuple(sorted(set(ends))))


def with_neighbours(rows: Mask) -> Mask:
    """Rows (m,) at an end of a range, and those too near to it to be used."""
    if not rows.any():
        return rows
    return np.convolve(rows, np.ones(2 * NEIGHBOURS + 1), mode="full")[NEIGHBOURS:-NEIGHBOURS] > 0.5


def _same(value: Array, end: Array) -> Mask:
    return np.abs(value - end) <= SAME * np.abs(end)


def _is_end(column: Array, at: Mask, ends: Mask, noise: float, peak: float) -> bool:
    """Whether the rows `at` an extreme value of a column (m,) repeat it as the end of a range.

    Args:
        column: (m,).
        at: (m,) rows at that value.
        ends: (2, m) rows at the largest and at the smallest value.
        noise: white, 1 sigma a sample, of the other rows.
        peak: largest size of a value.
    """
    others = column[~ends.any(axis=0)]
    lengths = _lengths(at)
    if not len(others) or not len(lengths):
        return False
    grid = resolution_of(others)
    if grid / np.sqrt(12.0) > np.sqrt(0.5) * noise:  # the grid hides the noise
        most = np.unique(others, return_counts=True)[1].max()
        many = np.count_nonzero(at) > max(SHARE * len(at), OFTEN * float(most))
        return bool(many and np.count_nonzero(lengths >= STRETCH) >= 2)
    chance = chance_of_a_repeat(grid, noise, peak)
    if chance == 1.0:
        return False
    usual = usual_run(runs_of(others[:, None])[1])
    repeats = np.maximum(lengths - usual, 0.0).sum()
    return bool(repeats >= usual * max(FEWEST, repeats_needed(chance, len(at))))


def _lengths(rows: Mask) -> Rows:
    """Lengths of the stretches of True in (m,)."""
    first, length = runs_of(rows[:, None])
    return length[rows[first]]
