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

FEWEST = 5
"""Fresh values that a stretch must lack, or it is no more than a hiccup."""
CHANCE = 1e-9
"""Of a stretch that noise leaves alone, over all the rows of a log."""
ROUNDED = 1e-9
"""Of the largest value: what scatters by less does so by rounding, and is no sensor's noise."""
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
    fresh = np.r_[True, (np.diff(series.value, axis=0) != 0.0).any(axis=1)]
    first = np.flatnonzero(fresh)
    held = np.diff(np.r_[first, len(series)])
    if held.max(initial=0) <= FEWEST:
        return lost
    repeats = _chance_of_a_repeat(series)
    if repeats == 1.0:
        return lost
    needed = np.log(CHANCE / len(series)) / np.log(repeats) if repeats > 0.0 else 0.0
    usual = float(np.quantile(held, USUAL, method="inverted_cdf"))
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


def run_lengths(rows: Mask) -> NDArray[np.intp]:
    """Lengths of the stretches of True in (m,)."""
    edges = np.flatnonzero(np.diff(np.r_[False, rows, False].astype(np.int8)))
    return edges[1::2] - edges[::2]


def _leaps(step: Array, index: int) -> bool:
    """Whether a stretch ends in a jump. `step` (stretches - 1, k) is from each to the next."""
    if index >= len(step):
        return False
    others = np.delete(step, index, axis=0).max(axis=0)
    return bool((step[index] > LEAP * others).any())
