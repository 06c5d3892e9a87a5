"""Wheels that nobody recorded a command of: a white torque, of the size that their speed shows.

What such a torque takes from a wheel it gives the body, so the log still tells the momentum that
both hold together. The path to linearise along follows the smoothed speed; that it does is taken
back in the filter, which expects no torque at all.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from twin.platform import Platform
from twin.recording import Series

Array = NDArray[np.float64]


def torque_intensity(platform: Platform, speed: Series, noise: Array) -> Array:
    """(wheels,) intensity of the white torque on each wheel [(N m)^2 s].

    The most likely one for a wheel whose speed walks at random and is read with white noise: a
    Kalman filter at rest, its gain sought.

    Args:
        platform: the wheels.
        speed: as measured.
        noise: (wheels,) 1 sigma of a reading [rad/s].
    """
    period = float(np.median(np.diff(speed.time)))
    rotor = np.array([wheel.inertia for wheel in platform.wheels])
    walk = [
        _random_walk(column, float(sigma))
        for column, sigma in zip(speed.value.T, noise, strict=True)
    ]
    return np.square(rotor) * np.array(walk) / period


def wander(wheels: Array, force: Array, intensity: Array, step: float) -> tuple[Array, Array]:
    """Covariance (S, x, x) that a state gains in a step, and its expected drift (S, K, x) from the
    path.

    Args:
        wheels: (S, x, w) change of the state by a unit impulse on each wheel, of the machine as it
            is fitted.
        force: (S, K, w) that the path was predicted with [N m].
        intensity: (w,) of the torques; 0 where the force is a recorded command's [(N m)^2 s].
        step: [s].
    """
    unknown = force * (intensity > 0.0)
    drift = -step * np.einsum("sxw,skw->skx", wheels, unknown)
    return (wheels * (intensity * step)) @ wheels.transpose(0, 2, 1), drift


def _random_walk(values: Array, noise: float) -> float:
    """Variance that a random walk gains a sample, from readings (m,) with white noise."""

    def cost(logarithm: float) -> float:
        gain = 1.0 / (1.0 + np.exp(-logarithm))
        error = lfilter([1.0, -1.0], [1.0, gain - 1.0], values - values[0])
        variance = noise**2 / (1.0 - gain)
        return float(np.mean(np.square(error)) / variance + np.log(variance))

    best = minimize_scalar(cost, bounds=(-12.0, 12.0), method="bounded")
    gain = 1.0 / (1.0 + np.exp(-float(best.x)))
    return float(np.square(noise * gain) / (1.0 - gain))
