"""Samples far off between others that go on as if nothing had been: wrong bytes, a marker taken for
another.

A stream leaves its course in one step, and within a quarter of a second comes back to it in one
step, calm before and after. No body does that: what has been pushed stays pushed. What noise may do
is not touched.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.noise.stream import noise_of
from twin.recording import Series

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Apart = Callable[[NDArray[np.intp], NDArray[np.intp]], Array]

FAR = 5.0
"""Usual steps from one sample to the next that a step off the course is longer than."""
USUAL = 0.95
"""Quantile of the steps that is their usual length, unless noise alone takes longer ones."""
OF_NOISE = 6.0
"""White sigmas that a usual step is taken to be at least."""
LONGEST = 0.25
"""After which a stream has not come back, but is elsewhere [s]."""
CALM = 3
"""Steps before and after that are no longer than FAR; elsewhere it rattles."""


def glitches(series: Series) -> Mask:
    """(m,) samples that are off the course of their stream."""
    off = np.zeros(len(series), dtype=np.bool_)
    if len(series) <= 2 * CALM + 2:
        return off
    apart = _apart(series)
    row = np.arange(len(series))
    step = apart(row[:-1], row[1:])
    calm = np.convolve(step <= FAR, np.ones(CALM), mode="valid") == CALM
    last = 0
    for before in np.flatnonzero(step[CALM:] > FAR) + CALM:
        if before < last or not calm[before - CALM]:
            continue
        reach = np.searchsorted(series.time, series.time[before] + LONGEST, side="right")
        after = np.arange(before + 1, min(int(reach) + 1, len(series) - CALM))
        distance = apart(np.full(len(after), before), after)
        # on its course it may have gone a usual step a sample
        near = distance <= FAR + (after - before)
        back = after[near & calm[after]]
        if not len(back) or back[0] == before + 1:
            continue
        last = int(back[0])
        off[before + 1 : last] = ~near[: last - before - 1]
    return off


def _apart(series: Series) -> Apart:
    """How many usual steps apart two samples are, in the column in which they are furthest."""
    value, white = series.value, noise_of(series)
    if series.columns == ("w", "x", "y", "z"):
        turned = rotation.conjugate(value)

        def distance(a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
            turn = rotation.to_rotation_vector(rotation.multiply(turned[a], value[b]))
            return np.linalg.norm(turn, axis=1)[:, None]

        white = np.array([np.linalg.norm(white)])
    else:

        def distance(a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
            return np.abs(value[b] - value[a])

    row = np.arange(len(series))
    steps = distance(row[:-1], row[1:])
    usual = np.maximum(np.quantile(steps, USUAL, axis=0), OF_NOISE * white)
    return lambda a, b: (distance(a, b) / usual).max(axis=1)
