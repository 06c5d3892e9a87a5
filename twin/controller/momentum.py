"""A momentum of the body as the aim: the feedback that adaptive balancing stands on."""

import numpy as np
from numpy.typing import NDArray

from twin.controller.exchange import Exchange
from twin.rotation import cross
from twin.signals import Estimate, Target

Array = NDArray[np.float64]


def follow_momentum(
    exchange: Exchange, estimate: Estimate, target: Target, gain: float
) -> tuple[Array, Array]:
    """The momentum error, and the change of momentum of wheels or gyros that undoes it.

    H_s = J w,  H_d = J w_d                   of the body and its aim, body axes
    tau = -K (H_s - H_d) + w x H_s + dH_d/dt  torque on the body, -dh/dt - w x h

    It leaves d(H_s - H_d)/dt = -K (H_s - H_d) + m r x g. Source: paper 000 of docs/design.md, eq.
    22 and 35. J is that at stage position 0, and what the sliding masses carry is left out.

    Args:
        exchange: wheels or gyros.
        estimate: of the machine.
        target: its rate and acceleration; the attitude has no part in it.
        gain: K [1/s].

    Returns:
        H_s - H_d [N m s] and dh/dt [N m], both (n, 3), body axes.
    """
    inertia, rate = exchange.inertia, estimate.rate_body
    # einsum rather than @: a row's last bits must not depend on how many runs there are.
    own = np.einsum("ij,nj->ni", inertia, rate)
    error = own - np.einsum("ij,...j->...i", inertia, target.rate_body)
    ahead = np.einsum("ij,...j->...i", inertia, target.acceleration_body)
    whole = own + exchange.momentum(estimate)
    return error, gain * error - cross(rate, whole) - ahead
