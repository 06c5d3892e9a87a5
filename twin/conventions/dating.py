"""How well a clock's offset is known: from how the misfit grows about it, and from how the parts of
a log disagree."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Array = NDArray[np.float64]

NARROW, WIDE = 0.02, 0.4
"""The parabola is laid through lags no nearer and no farther than this [s]."""
FIRST = 0.05
"""Where it is laid first [s]."""
ROUNDS = 3
POINTS = np.linspace(-1.0, 1.0, 9)
PARTS = 20
"""Into which the log is cut."""


def dated(residual: Callable[[float], Array], lag: float) -> tuple[float, float]:
    """The lag near `lag` at which a residual is least, and its 95 % half width [s].

    Args:
        residual: of a lag: (n, ...) rows in the order of time, in units of their noise.
        lag: where to begin [s].

    The squared residual is a parabola over the interval; nearer, it ripples with the sampling. Two
    noisy series held against each other agree by chance as well, at one lag or another: the slopes
    of the parts of the log, which should all be 0, tell how much (a sandwich variance). Infinite
    where the residual does not grow.
    """
    best, half_width, reach = lag, np.inf, FIRST
    for _ in range(ROUNDS):
        tried = np.array([_misfit(residual(float(best + reach * point))) for point in POINTS])
        bends, slopes, _ = np.polyfit(reach * POINTS, tried, 2)
        bend = float(bends.sum())
        if bend <= 0.0:
            return best, np.inf
        step = float(np.clip(-0.5 * slopes.sum() / bend, -reach, reach))
        left = slopes + 2.0 * bends * step
        scatter = float(left @ left) * PARTS / (PARTS - 1)
        variance = max(1.0 / (2.0 * bend), scatter / (2.0 * bend) ** 2)
        best, half_width = best + step, float(student.ppf(0.975, PARTS - 1) * np.sqrt(variance))
        reach = float(np.clip(half_width, NARROW, WIDE))
    return best, half_width


def _misfit(residual: Array) -> Array:
    """(PARTS,) [nats] of the parts of the log."""
    return np.array([0.5 * np.sum(np.square(part)) for part in np.array_split(residual, PARTS)])
