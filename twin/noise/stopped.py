"""What a sensor that hung repeats: rows that noise would have changed, and that did not change.

Noise carries a value out of its step of the grid with a known chance, so a row that repeats the one
before in every column says little, and a long stretch of them says that nobody measured. A stream
whose grid hides its noise may honestly stand still, and nothing is said of it.
"""

import numpy as np
from numpy.typing import NDArray

from twin.noise.stream import measure_noise
from twin.recording import Series

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]

FEWEST = 5
"""Fresh values that a stretch must lack, or it is no more than a hiccup."""
CHANCE = 1e-9
"""Of a stretch that noise leaves alone, over all the rows of a log."""
ROUNDED = 1e-9
"""Of the largest value: what scatters by less does so by rounding, and is no sensor's noise."""
QUIET = 1e-6
"""Of the largest value: a column with less noise than this is computed, not measured."""
USUAL = 0.95
"""Quantile of the rows for which a value is held that a sensor slower than its log holds it."""
LEAP = 3.0
"""Times the largest other step by which a part's speed must jump after such a stretch: a wheel that
coasts, unlike a body on a ball of air, may keep to a number."""


def stopped(series: Series, *, steady: bool = False) -> Mask:
    """Rows that repeat what a sensor read when it hung.

    Args:
        series: m rows of a sensor.
        steady: what it measures may honestly stay the same.

    Returns:
        (m,); the first row of a stretch is not one of them.
    """
    lost = np.zeros(len(series), dtype=np.bool_)
    first, held = runs_of(series.value)
    if held.max(initial=0) <= FEWEST:
        return lost
    repeats = _chance_of_a_repeat(series)
    if repeats == 1.0:
        return lost
    needed = repeats_needed(repeats, len(series))
    usual = usual_run(held)
    step = np.abs(np.diff(series.value[first], axis=0))
    for index in np.flatnonzero(held > usual * max(FEWEST, needed)):
        if steady and not _leaps(step, int(index)):
            continue
        lost[first[index] + 1 : first[index] + held[index]] = True
    return lost


def _chance_of_a_repeat(series: Series) -> float:
    """That all columns of a row fall into the step of the grid in which the last one was."""
    noise = measure_noise(series)
    if series.columns == ("w", "x", "y", "z"):
        peak = np.full(3, np.pi)
    else:
        peak = np.abs(series.value).max(axis=0)
    told = ~noise.quantised & (noise.white > ROUNDED * peak)
    chance = noise.resolution[told] / (2.0 * np.sqrt(np.pi) * noise.white[told])
    return float(np.prod(np.minimum(chance, 1.0)))


def runs_of(value: Array | Mask) -> tuple[Rows, Rows]:
    """First rows and lengths of the runs of equal rows in (m, k)."""
    changes = (value[1:] != value[:-1]).any(axis=1)
    first = np.flatnonzero(np.r_[np.ones(min(len(value), 1), dtype=np.bool_), changes])
    return first, np.diff(np.r_[first, len(value)])


def usual_run(lengths: Rows) -> float:
    """Rows for which a sensor, perhaps slower than its log, holds a value."""
    return float(np.quantile(lengths, USUAL, method="inverted_cdf"))


def chance_of_a_repeat(grid: float, noise: float, peak: float) -> float:
    """That noise leaves one value in its step of the grid; 1 where that cannot be known.

    Args:
        grid: step of the values; 0 without one.
        noise: white, 1 sigma a sample. A grid may hide it.
        peak: largest size of a value. With hardly any noise beside it, values are computed.
    """
    if grid / np.sqrt(12.0) > np.sqrt(0.5) * noise or noise <= QUIET * peak:
        return 1.0
    return min(grid / (2.0 * np.sqrt(np.pi) * noise), 1.0)


def repeats_needed(chance: float, rows: int) -> float:
    """How many repeats in a row are beyond CHANCE anywhere in a log of so many rows."""
    return float(np.log(CHANCE / rows) / np.log(chance)) if chance > 0.0 else 0.0


def _leaps(step: Array, index: int) -> bool:
    """Whether a stretch ends in a jump. `step` (stretches - 1, k) is from each to the next."""
    if index >= len(step):
        return False
    others = np.delete(step, index, axis=0).max(axis=0)
    return bool((step[index] > LEAP * others).any())
