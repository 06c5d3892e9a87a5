"""Wheels that nobody recorded a command of: a white torque, of the size that their speed shows.

What such a torque takes from a wheel it gives the body, so the log still tells the momentum that
both hold together. The path to linearise along follows the smoothed speed; that it does is taken
back in the filter, which expects no torque at all. So do gimbals go at rates that nobody recorded,
beside their commanded ones or in place of them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from twin.recording import Series

Array = NDArray[np.float64]

ROUNDED = 1.25
"""Digits, from the least to the most, that rounding may take a reading off: one where the truth is
known to the instant, a quarter more for when it was read. What strays farther is not rounding."""
WORTHWHILE = 10.0
"""By how much a walk must lower twice the negative log-likelihood of the readings to be believed.
"""


def random_walk(series: Series, noise: Array, digit: Array) -> Array:
    """(k,) variance a second of what walks at random and is read with white noise.

    The most likely one: a Kalman filter at rest, its gain sought. 0 where the readings do not ask
    for any, or where rounding alone could have them stray so far: of what moves slowly that is no
    white noise, and looks like a walk.

    Args:
        series: as measured.
        noise: (k,) 1 sigma of a reading.
        digit: (k,) to which it is rounded; 0: not at all.
    """
    period = float(np.median(np.diff(series.time)))
    strayed = np.ptp(series.value, axis=0) > ROUNDED * digit
    walk = [
        _random_walk(column, float(sigma)) if far else 0.0
        for column, sigma, far in zip(series.value.T, noise, strayed, strict=True)
    ]
    return np.array(walk) / period


def wander(answer: Array, force: Array, intensity: Array, step: float) -> tuple[Array, Array]:
    """Covariance (S, K, x, x) that a state gains in each step, and its expected drift (S, K, x)
    from the path.

    Args:
        answer: (S, K or 1, x, d) change of the state by a unit impulse on each wheel, a unit turn
            of each gimbal, of the machine as it is fitted.
        force: (S, K, d) that the path was predicted with and no command explains [N m, rad/s].
        intensity: (d,) of the torques, of the rates; 0 where a command explains all.
        step: [s].
    """
    drift = -step * (answer @ (force * (intensity > 0.0))[..., None])[..., 0]
    noise = (answer * (intensity * step)) @ answer.swapaxes(-1, -2)
    return np.broadcast_to(noise, (*drift.shape, drift.shape[-1])), drift


def _random_walk(values: Array, noise: float) -> float:
    """Variance that a random walk gains a sample, from readings (m,) with white noise."""

    def cost(logarithm: float) -> float:
        gain = 1.0 / (1.0 + np.exp(-logarithm))
        error = lfilter([1.0, -1.0], [1.0, gain - 1.0], values - values[0])
        variance = noise**2 / (1.0 - gain)
        return float(np.mean(np.square(error)) / variance + np.log(variance))

    best = minimize_scalar(cost, bounds=(-12.0, 12.0), method="bounded")
    if len(values) * (cost(-12.0) - float(best.fun)) < WORTHWHILE:
        return 0.0
    gain = 1.0 / (1.0 + np.exp(-float(best.x)))
    return float(np.square(noise * gain) / (1.0 - gain))
