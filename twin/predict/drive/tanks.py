"""What the tanks' gauge should show by what the thrusters were told to take."""

import numpy as np
from numpy.typing import NDArray

from twin.plant.gas import STANDARD_GRAVITY
from twin.platform import Platform
from twin.recording import Series

Array = NDArray[np.float64]


def pressure(platform: Platform, edges: Array, thrust: Array) -> Series | None:
    """Pressure [Pa] from full tanks at constant temperature; None of a machine without any.

    How full they were is an error of the gauge, as large as their pressure may be.

    Args:
        platform: whose tanks they are.
        edges: (m + 1,) of the steps [s].
        thrust: (m, thrusters) mean force between them [N].
    """
    gas = platform.gas
    if gas is None:
        return None
    taken = np.sum(thrust, axis=1) * np.diff(edges) / (gas.specific_impulse * STANDARD_GRAVITY)
    left = 1.0 - np.concatenate([[0.0], np.cumsum(taken)]) / gas.mass
    return Series(edges, gas.pressure * left[:, None], ("value",), "Pa")
