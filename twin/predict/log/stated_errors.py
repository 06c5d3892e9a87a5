"""What platform.toml states of a sensor's errors, and what that is worth beside a log's own."""

from math import inf

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform

Array = NDArray[np.float64]

FEW = 100
"""An estimate of noise that is worth fewer samples is taken together with what platform.toml
states, as that many more: by chance it is half of the truth, or twice as much."""


def claimed_noise(platform: Platform, name: str, k: int) -> Array:
    """(k,) noise that platform.toml states; 0: none."""
    sensor = platform.sensors.get(name)
    noise = np.zeros(1) if sensor is None else np.asarray(sensor.noise, dtype=np.float64)
    return np.broadcast_to(noise, (k,)).copy()


def with_claim(claimed: Array, noise: Array, worth: Array, count: int) -> tuple[Array, Array]:
    """An estimate from few samples, with what platform.toml states as so many more; its worth.

    Args:
        claimed: (k,) as platform.toml has it; 0: none.
        noise: (k,) as estimated, in the stream's unit.
        worth: (k,) share of the samples that would tell as much of it.
        count: of samples.
    """
    enough = worth * count
    few = (enough < FEW) & (claimed > 0.0)
    share = enough / (enough + FEW)
    both = share * np.square(noise) + (1.0 - share) * np.square(claimed)
    # the residual's variance beside it is 2 / count (1 / worth - 1), as that of an estimate
    worth_of_both = 1.0 / (2.0 - 2.0 * share + np.square(share) / worth)
    return np.where(few, np.sqrt(both), noise), np.where(few, worth_of_both, worth)


def counted_noise(platform: Platform, count: int) -> tuple[Array, bool, Array] | None:
    """Of stages' counters, whose noise cannot be told from their moves: as platform.toml states it.

    Rounding is off by half a step at most, and where a drive's own steps are rounded it is off by
    the same at every stop: so many readings say no more of it than one.
    """
    sensor = platform.sensors["stage_position"]
    noise = np.hypot(sensor.noise, 0.5 * sensor.resolution * np.sqrt(count))
    return (noise, True, np.full(len(noise), inf)) if np.all(noise > 0.0) else None


def claimed_delay(platform: Platform, name: str) -> float:
    """The group delay at rest of a Butterworth filter."""
    sensor = platform.sensors.get(name)
    if sensor is None or not np.isfinite(sensor.cutoff):
        return 0.0
    return float(1.0 / (2.0 * np.pi * sensor.cutoff * np.sin(0.5 * np.pi / sensor.order)))


def claimed_bias(platform: Platform, name: str, k: int) -> Array:
    """(k,) 1 sigma of a sensor's constant error; 0: none."""
    if name == "gas_pressure" and platform.gas is not None:
        return np.full(k, platform.gas.pressure)  # nobody states how full the tanks were
    sensor = platform.sensors.get(name)
    return np.zeros(k) if sensor is None else np.broadcast_to(sensor.bias, (k,)).copy()
