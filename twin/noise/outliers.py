"""Which samples no noise explains: one rule, fixed before any fit sees the data.

Hampel's identifier: a sample is an outlier when it lies farther from what its neighbours make of it
than 6 robust sigmas (1.4826 times the median of all such distances), and farther than any of them.
The median is moved by nothing short of half the samples, so outliers cannot hide each other as they
do behind a standard deviation; and Gaussian noise goes beyond 6 sigma once in 5e8 samples, so in a
log of any length a flag is news.

F. R. Hampel, The influence curve and its role in robust estimation, J. Am. Stat. Assoc. 69 (1974).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIGMAS = 6.0
REACH = 2
"""Neighbours on either side; the cubic through them is what they make of the sample."""
ON_A_GRID = np.sqrt(70.0 / 36.0 / 12.0)
"""Sigma of the distance when every value is off by up to half a step."""


def outliers(value: Array, resolution: Array) -> NDArray[np.bool_]:
    """(m,) rows of which any column of (m, k) values is an outlier.

    The sigma of a column on a grid of step `resolution` (k,) is no less than the grid makes it. One
    that scatters in fewer than half its samples has no noise to be held against, and none.
    """
    flagged = np.zeros(len(value), dtype=np.bool_)
    if len(value) <= 2 * REACH:
        return flagged
    near = value[1:-3] + value[3:-1]
    far = value[:-4] + value[4:]
    distance = np.abs(value[REACH:-REACH] - (4.0 * near - far) / 6.0)
    sigma = 1.4826 * np.median(distance, axis=0)
    limit = SIGMAS * np.maximum(sigma, resolution * ON_A_GRID)
    suspect = (distance > limit) & (sigma > 0.0)
    if not suspect.any():
        return flagged
    padded = np.pad(distance, ((REACH, REACH), (0, 0)))
    around = [padded[k : k + len(distance)] for k in range(2 * REACH + 1)]
    worst = distance >= np.max(around, axis=0)
    flagged[REACH:-REACH] = (suspect & worst).any(axis=1)
    return flagged
