"""What a sample of a sensor is worth to a filter."""

import numpy as np
from numpy.typing import NDArray

from twin.platform import Sensor

Array = NDArray[np.float64]


def variance_of(sensor: Sensor) -> Array:
    """(k,) of a sample; a perfect sensor is taken as good to 1e-7 of its unit."""
    return np.maximum(sensor.noise**2 + sensor.resolution**2 / 12.0, 1e-14)
