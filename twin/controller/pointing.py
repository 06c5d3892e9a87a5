"""How far a body is from where it should point: what every attitude law begins with."""

import numpy as np
from numpy.typing import NDArray

from twin.rotation import conjugate, multiply, rotate
from twin.signals import Estimate, Target

Array = NDArray[np.float64]


def pointing_error(estimate: Estimate, target: Target) -> tuple[Array, Array]:
    """Error of the body from its target, the shorter way round, and of its rate, in body axes.

    q_e = q_d^* q, of its two signs the one with q_e0 >= 0;  w_e = w - R(q_e)^T w_d

    Returns:
        q_e of shape (n, 4), w_e of shape (n, 3) [rad/s].
    """
    error = multiply(conjugate(target.attitude), estimate.attitude)
    shortest = np.copysign(1.0, error[:, :1]) * error
    return shortest, estimate.rate_body - rotate(conjugate(shortest), target.rate_body)


def mrp_of(error: Array) -> Array:
    """Modified Rodrigues parameters of an error (n, 4) with q_e0 >= 0: tan(angle / 4) about its
    axis, (n, 3), at most 1 in length."""
    return error[:, 1:] / (1.0 + error[:, :1])
