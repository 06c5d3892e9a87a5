"""How small forces along a path change it, to first order: no rollout, whatever their number."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def carried_forces(carried: Array, answer: Array, forces: Array, step: float) -> Array:
    """Changes (S, steps + 1, x, a) of the state at each instant.

    Half of a step's impulse acts before it, half after: exact to second order in the step.

    Args:
        carried: (S, steps, x, x) change of the state from one instant to the next.
        answer: (S, steps or 1, x, nv) change of the state by a unit impulse on each degree of
            freedom.
        forces: (S, steps, nv, a), constant over each step.
        step: [s].
    """
    segments, steps, x, _ = carried.shape
    half = 0.5 * step * (answer @ forces)
    change = np.zeros((segments, steps + 1, x, forces.shape[-1]))
    for k in range(steps):
        change[:, k + 1] = carried[:, k] @ (change[:, k] + half[:, k]) + half[:, k]
    return change
