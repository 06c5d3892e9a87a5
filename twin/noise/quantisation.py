"""The grid that a converter, a counter or a printed number leaves in a column."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OFF_GRID = 0.01
"""Of a step: how far from the grid rounding in another unit may leave a value."""


def resolution_of(column: Array) -> float:
    """The step of the grid on which all values of a column lie; 0 where there is none.

    The step is the smallest distance between two different values, if every other distance is a
    whole number of it. A column of one value, or two, shows no grid.
    """
    steps = np.diff(np.unique(column))
    if len(steps) < 2:
        return 0.0
    # the same value written in another unit differs in its last bits
    alike = 64.0 * np.finfo(np.float64).eps * float(np.abs(column).max())
    steps = steps[steps > alike]
    if len(steps) < 2:
        return 0.0
    smallest = float(steps.min())
    counts = np.round(steps / smallest)
    # the mean over all distances sharpens the step beyond the rounding of the smallest one
    step = float(steps.sum() / counts.sum())
    off = np.abs(steps / step - np.round(steps / step))
    tolerance = max(OFF_GRID, 2.0 * alike / step)
    return step if tolerance < 0.1 and float(off.max()) < tolerance else 0.0
