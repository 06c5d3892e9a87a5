"""The torque that the logs ask for beyond the model: the white torque of a fit, smoothed.

A Kalman smoother within each segment, from the start and to the end that `chain` gives it; no
second derivative of the data is taken.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.predict.whitening.innovations import Innovations, Problem
from twin.predict.whitening.kalman import with_none
from twin.predict.whitening.spread import root

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unexplained:
    """Of one log, at the instants of its grid."""

    time: Array
    """(m,) [s]."""
    rate: Array
    """(m, k) [rad/s], body axes, of the smoothed motion."""
    torque: Array
    """(m, k) [N m], body axes; 0 where nothing is left to explain."""


def unexplained_torque(problem: Problem, now: Innovations, log: int) -> Unexplained:
    """Smooth the white torque of a fit over one of its logs."""
    body = problem.bodies[log]
    grid = body.grid
    time = grid.starts[:, None] + grid.step * np.arange(grid.steps)
    torque = np.zeros((*time.shape, now.exact[log].local.pushed.shape[-1]))
    if now.intensity > 0.0:
        torque = smoothed_torque(now, log)
    inside = time.ravel() <= body.motion.time[-1]
    return Unexplained(
        time.ravel()[inside],
        body.motion.at(time.ravel()[inside]).rate,
        torque.reshape(-1, torque.shape[-1])[inside],
    )


def smoothed_torque(now: Innovations, log: int) -> Array:
    """(S, steps, k) mean of the white torque over each step, of the machine as stated [N m]."""
    chain = now.chains[log]
    linear, local = now.exact[log].linear, now.exact[log].local
    segments, instants, width = local.row.shape
    x = local.measured.shape[-1]
    starts, adjoints = chain.backward(np.zeros(linear.shared.shape[-1]))
    residual = linear.residual + np.einsum("snx,sx->sn", linear.state, starts)
    residual, measured = with_none(residual), with_none(local.measured)
    every = np.arange(segments)[:, None]
    noise = now.intensity * local.step * local.pushed @ local.pushed.transpose(0, 2, 1)
    mean = np.zeros((segments, x))
    spread = np.zeros((segments, x, x))
    eye = np.eye(width)
    pull = np.zeros((segments, instants, x))
    keep = np.zeros((segments, instants, x, x))
    for k in range(instants):
        if k:
            carry = local.carried[:, k - 1]
            mean = np.einsum("sxy,sy->sx", carry, mean) + local.drift[:, k - 1]
            spread = carry @ spread @ carry.transpose(0, 2, 1) + noise + local.wander[:, k - 1]
        at = every, local.row[:, k]
        h = measured[at]
        across = h @ spread
        lower = root(across @ h.transpose(0, 2, 1) + eye)
        left = (residual[at] - np.einsum("swx,sx->sw", h, mean))[..., None]
        white = np.linalg.solve(lower, np.concatenate([left, h, across], axis=-1))
        left, seen, gain = white[..., 0], white[..., 1 : 1 + x], white[..., 1 + x :]
        pull[:, k] = np.einsum("swx,sw->sx", seen, left)
        keep[:, k] = np.eye(x) - gain.transpose(0, 2, 1) @ seen
        mean = mean + np.einsum("swx,sw->sx", gain, left)
        # squared, so that it stays symmetric: else errors of rounding would grow along a segment
        spread = spread - gain.transpose(0, 2, 1) @ gain
    adjoint = np.concatenate([adjoints[1:], np.zeros((1, x))])
    torque = np.zeros((segments, instants - 1, local.pushed.shape[-1]))
    for k in range(instants - 1, 0, -1):
        adjoint = np.einsum("syx,sy->sx", keep[:, k], adjoint) + pull[:, k]
        torque[:, k - 1] = now.intensity * np.einsum("sxc,sx->sc", local.pushed, adjoint)
        adjoint = np.einsum("syx,sy->sx", local.carried[:, k - 1], adjoint)
    return torque
