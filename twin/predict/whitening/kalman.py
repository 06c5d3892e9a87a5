"""White innovations where the motion itself is noisy: a Kalman filter within each segment.

Each segment's filter starts from a known state, so it runs beside the others, all in one pass; what
it says is affine in that state and in the shared unknowns, and `chain` puts the segments together.
Its gain depends on the path only, so residual and columns go through as right-hand sides of one
filter.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.predict.whitening.linearised import Linearised
from twin.predict.whitening.spread import root

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Local:
    """How noise travels: S segments of N rows and K grid instants, W slots an instant, x numbers of
    a state."""

    measured: Array
    """(S, N, x) d(measured / noise) / d(state at the instant)."""
    row: NDArray[np.int32]
    """(S, K, W) which row each slot of each instant is; N where it holds no sample."""
    carried: Array
    """(S, K - 1, x, x) from one instant to the next."""
    pushed: Array
    """(S, x, c) change of the state by a unit impulse on each of c degrees of freedom."""
    step: float
    """[s]."""
    wander: Array
    """(S, K - 1, x, x) covariance that a state gains in each step whatever else is at work: wheels'
    unknown torques, gimbals' unknown rates."""
    drift: Array
    """(S, K - 1, x) by how much the expected motion leaves the nominal path in each step."""


def whitened(linear: Linearised, local: Local, intensity: Array) -> tuple[Linearised, float]:
    """With white generalised forces of these intensities at work.

    Args:
        linear: of a motion without noise.
        local: along the same paths.
        intensity: (c,) [(N m)^2 s].

    Returns:
        The same with innovations for residuals, and the log-determinant of their covariance.
    """
    segments, count, x = local.measured.shape
    # all of a row together, as the filter goes through them, and one more that holds no sample
    white = np.zeros((segments, count + 1, x + 1 + linear.shared.shape[-1]))
    white[:, :count, :x] = linear.state
    white[:, :count, x] = linear.residual
    white[:, :count, x + 1 :] = linear.shared
    measured = with_none(local.measured)
    telling = np.any(measured != 0.0, axis=-1)
    every = np.arange(segments)[:, None]
    force = local.pushed * (intensity * local.step)
    noise = force @ local.pushed.transpose(0, 2, 1)
    mean = np.zeros((segments, x, white.shape[-1]))
    spread = np.zeros((segments, x, x))
    logarithm = 0.0
    for k in range(local.row.shape[1]):
        if k:
            carry = local.carried[:, k - 1]
            mean = carry @ mean
            mean[..., x] += local.drift[:, k - 1]
            spread = carry @ spread @ carry.transpose(0, 2, 1) + noise + local.wander[:, k - 1]
        slots = local.row[:, k]
        at = every, slots[:, np.any(telling[every, slots], axis=0)]
        h = measured[at]
        if not h.size:
            continue
        across = h @ spread
        covariance = across @ h.transpose(0, 2, 1) + np.eye(h.shape[1])
        lower = root(covariance)
        # many small triangles: a third of the time that solving takes
        inverse = np.linalg.inv(lower)
        told = inverse @ (white[at] - h @ mean)
        white[at] = told
        gain = (inverse @ across).transpose(0, 2, 1)
        mean = mean + gain @ told
        spread = spread - gain @ gain.transpose(0, 2, 1)
        logarithm += 2.0 * float(np.log(np.diagonal(lower, axis1=1, axis2=2)).sum())
    white = white[:, :count]
    ends = mean[:-1]
    return (
        replace(
            linear,
            state=white[..., :x],
            residual=white[..., x],
            shared=white[..., x + 1 :],
            transition=linear.transition + ends[..., :x],
            jump=linear.jump + ends[..., x],
            jump_shared=linear.jump_shared + ends[..., x + 1 :],
            spread=spread[:-1],
        ),
        logarithm,
    )


def with_none(rows: Array) -> Array:
    """Rows (S, N, ...), and after them one of zeros: of a slot that holds no sample."""
    return np.concatenate([rows, np.zeros_like(rows[:, :1])], axis=1)
