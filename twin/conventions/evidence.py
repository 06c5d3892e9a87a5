"""How much better one reading of a log explains it than another, in nats.

Both leave a residual that the right reading would leave white with unit variance. Their likelihood
ratio alone cannot be trusted where the signal is weak: the same sensor noise turned another way, or
taken at another time, is another draw, and two draws of n samples differ by sqrt(n) nats by chance.
How far the residuals are apart tells how large that chance is, and the ratio is weighed by it:

    L = (|r0|^2 - |r1|^2) / 2,   evidence = L min(1, 2 |L| / |r0 - r1|^2)

For a clear signal, r0 = r1 + s, this is the likelihood ratio |s|^2 / 2 itself; for two draws of
mere noise it is of the order of one.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


def evidence(residual: Array, other: Array, inflated: float) -> float:
    """In favour of `residual` over `other` [nats]; what no reading explains divides it."""
    ratio = 0.5 * float(np.sum(np.square(other)) - np.sum(np.square(residual)))
    apart = float(np.sum(np.square(other - residual)))
    return ratio * min(1.0, 2.0 * abs(ratio) / apart) / inflated if apart > 0.0 else 0.0


def inflation(residual: Array) -> float:
    """By how much the best residual, (n, k), falls short of white with unit variance; at least 1.

    What no reading explains (a misaligned gyro, a torque nobody models) must not count as
    evidence: its size and its correlation from sample to sample divide all of it. Both together,
    for it is the slow part of it that looks like motion: a small one does so however slow it is.
    """
    power = float(np.mean(np.square(residual)))
    if power <= 0.0 or len(residual) < 3:
        return 1.0
    echo = float(np.mean(residual[1:] * residual[:-1])) / power
    echo = float(np.clip(echo, 0.0, 0.98))
    return max(power * (1.0 + echo) / (1.0 - echo), 1.0)


def whitened(rate: Array, angle_noise: float, rate_noise: float) -> Array:
    """Differences of noisy angles minus noisy rates, made white with unit variance.

    Their noise is rate_noise on each row and the difference of angle_noise (both as rates, 1 sigma
    a row): a first-order low-pass undoes its spectrum.
    """
    pole = forgetting(angle_noise, rate_noise)
    gain = (1.0 - pole) / rate_noise
    return np.asarray(lfilter([gain], [1.0, -pole], rate, axis=0))


def forgetting(angle_noise: float, rate_noise: float) -> float:
    """What the whitening filter keeps from row to row: the root below 1 of its spectral factor."""
    first = 0.5 * (rate_noise + np.hypot(rate_noise, 2.0 * angle_noise))
    return 1.0 - rate_noise / first


def drift(count: int, pole: float) -> Array:
    """(count, 3) bias, its drift, and a whitening filter's memory of what came before."""
    memory = np.power(pole, np.arange(count, dtype=np.float64))
    columns = [np.ones(count), np.linspace(-1.0, 1.0, count), memory]
    return np.asarray(np.stack(columns, axis=-1), dtype=np.float64)


def without(columns: Array, values: Array) -> Array:
    """Values (n, k) with the columns (n, c) projected out."""
    basis = np.linalg.qr(columns)[0]
    return values - basis @ (basis.T @ values)
