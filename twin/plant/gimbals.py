"""Motion of gimbals driven at a rate: ramps of one acceleration, planned a tick at once."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def ramp(
    angle: Array, rate: Array, target: Array, *, steps: int, step: float, max_acceleration: Array
) -> tuple[Array, Array, Array]:
    """Bring the rate to `target` for a number of steps.

    Arrays are (n, g) [rad, rad/s]; the limit is (g,) [rad/s^2].

    Returns:
        Accelerations held in each step (n, steps, g) [rad/s^2], angle and rate at the end.
    """
    reach = (max_acceleration * step) * np.arange(steps + 1)[:, None]
    rates = rate[:, None] + np.clip((target - rate)[:, None], -reach, reach)
    turned = step * (0.5 * (rates[:, 0] + rates[:, -1]) + rates[:, 1:-1].sum(axis=1))
    return np.diff(rates, axis=1) / step, angle + turned, rates[:, -1]
