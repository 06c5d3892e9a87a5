"""The torque that the logs ask for beyond the model: those that a fit takes for noise, smoothed.

A Kalman smoother within each segment, from the start and to the end that `chain` gives it; no
second derivative of the data is taken.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.predict.whitening.augmented import Augmented, with_none
from twin.predict.whitening.innovations import Innovations, Problem
from twin.predict.whitening.kalman import scaled
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
    """Smooth the torques that a fit takes for noise over one of its logs."""
    body = problem.bodies[log]
    grid = body.grid
    time = grid.starts[:, None] + grid.step * np.arange(grid.steps)
    torque = np.zeros((*time.shape, now.exact[log].local.pushed.shape[-1]))
    if now.noise.pushes:
        torque = smoothed_torque(now, log)
    inside = time.ravel() <= body.motion.time[-1]
    return Unexplained(
        time.ravel()[inside],
        body.motion.at(time.ravel()[inside]).rate,
        torque.reshape(-1, torque.shape[-1])[inside],
    )


def smoothed_torque(now: Innovations, log: int) -> Array:
    """(S, steps, k) mean of all torques that are noise over each step, of the machine as stated
    [N m]."""
    chain, noise = now.chains[log], now.noise
    linear, local, _ = scaled(now.exact[log].linear, now.exact[log].local, noise)
    states = Augmented(local, noise)
    segments, instants, width = local.row.shape
    x, y = states.x, states.x + states.n
    starts, adjoints = chain.backward(np.zeros(linear.shared.shape[-1]))
    residual = linear.residual + np.einsum("snx,sx->sn", linear.state, starts[:, :x])
    residual, measured = with_none(residual), states.measured
    every = np.arange(segments)[:, None]
    mean = np.concatenate([np.zeros((segments, x)), starts[:, x:]], axis=1)
    spread = np.zeros((segments, y, y))
    eye = np.eye(width)
    pull = np.zeros((segments, instants, y))
    keep = np.zeros((segments, instants, y, y))
    for k in range(instants):
        if k:
            carry = states.carry(k - 1)
            mean = np.einsum("sxy,sy->sx", carry, mean)
            mean[:, :x] += local.drift[:, k - 1]
            spread = carry @ spread @ carry.transpose(0, 2, 1) + states.gained(k - 1)
        at = every, local.row[:, k]
        h = measured[at]
        across = h @ spread
        lower = root(across @ h.transpose(0, 2, 1) + eye)
        left = (residual[at] - np.einsum("swx,sx->sw", h, mean))[..., None]
        white = np.linalg.solve(lower, np.concatenate([left, h, across], axis=-1))
        left, seen, gain = white[..., 0], white[..., 1 : 1 + y], white[..., 1 + y :]
        pull[:, k] = np.einsum("swx,sw->sx", seen, left)
        keep[:, k] = np.eye(y) - gain.transpose(0, 2, 1) @ seen
        mean = mean + np.einsum("swx,sw->sx", gain, left)
        # squared, so that it stays symmetric: else errors of rounding would grow along a segment
        spread = spread - gain.transpose(0, 2, 1) @ gain
    adjoint = np.concatenate([adjoints[1:], np.zeros((1, y))])
    torque = np.zeros((segments, instants - 1, local.pushed.shape[-1]))
    fresh = np.zeros((segments, instants - 1, states.torques))
    for k in range(instants - 1, 0, -1):
        adjoint = np.einsum("syx,sy->sx", keep[:, k], adjoint) + pull[:, k]
        pushed = np.einsum("sxc,sx->sc", local.pushed, adjoint[:, :x])
        torque[:, k - 1] = noise.white_torque * pushed
        moved = states.moves[..., : states.torques]
        fresh[:, k - 1] = np.einsum("sxn,sx->sn", moved, adjoint) * states.size[: states.torques]
        adjoint = np.einsum("syx,sy->sx", states.carry(k - 1), adjoint)
    if states.torques:
        wander = starts[:, x : x + states.torques]
        for k in range(instants - 1):
            after = states.decay[: states.torques] * wander + fresh[:, k]
            torque[:, k] += 0.5 * noise.torque.rms * (wander + after)
            wander = after
    return torque
