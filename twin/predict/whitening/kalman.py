"""White innovations where the motion itself is noisy: a Kalman filter within each segment.

Each segment's filter starts from a known state, so it runs beside the others, all in one pass; what
it says is affine in that state and in the shared unknowns, and `chain` puts the segments together.
Its gain depends on the path only, so residual and columns go through as right-hand sides of one
filter. What wanders (`NoiseModel`) has states of its own, which a segment hands on to the next.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.predict.whitening.augmented import Augmented, Local
from twin.predict.whitening.linearised import Linearised
from twin.predict.whitening.noise_model import NoiseModel
from twin.predict.whitening.spread import root

Array = NDArray[np.float64]


def whitened(linear: Linearised, local: Local, noise: NoiseModel) -> tuple[Linearised, float]:
    """With all that is noise taken into account.

    Args:
        linear: of a motion without noise.
        local: along the same paths.
        noise: besides the sensors'.

    Returns:
        The same with innovations for residuals, and the log-determinant of their covariance. States
        of the noise stand after those of the motion, and what is known of the first ones in rows
        after all others.
    """
    linear, local, logarithm = scaled(linear, local, noise)
    if not noise.wanders and not local.wander.any():
        return linear, logarithm
    states = Augmented(local, noise)
    segments, count, x = local.measured.shape
    n, y = states.n, x + states.n
    # all of a row together, as the filter goes through them, and one more that holds no sample
    white = np.zeros((segments, count + 1, y + 1 + linear.shared.shape[-1]))
    white[:, :count, :x] = linear.state
    white[:, :count, y] = linear.residual
    white[:, :count, y + 1 :] = linear.shared
    measured = states.measured
    telling = np.any(measured != 0.0, axis=-1)
    every = np.arange(segments)[:, None]
    mean = np.zeros((segments, y, white.shape[-1]))
    mean[:, x:, x:y] = np.eye(n)
    spread = np.zeros((segments, y, y))
    for k in range(local.row.shape[1]):
        if k:
            carry = states.carry(k - 1)
            mean = carry @ mean
            mean[:, :x, y] += local.drift[:, k - 1]
            spread = carry @ spread @ carry.transpose(0, 2, 1) + states.gained(k - 1)
        slots = local.row[:, k]
        at = every, slots[:, np.any(telling[every, slots], axis=0)]
        h = measured[at]
        if not h.size:
            continue
        across = h @ spread
        covariance = across @ h.transpose(0, 2, 1) + np.eye(h.shape[1])
        lower = root(covariance)
        both = np.concatenate([white[at] - h @ mean, across], axis=-1)
        both = np.linalg.solve(lower, both)
        told = both[..., : white.shape[-1]]
        white[at] = told
        gain = both[..., white.shape[-1] :].transpose(0, 2, 1)
        mean = mean + gain @ told
        spread = spread - gain @ gain.transpose(0, 2, 1)
        logarithm += 2.0 * float(np.log(np.diagonal(lower, axis1=1, axis2=2)).sum())
    # nothing is known of the noise before the log but its size, which is 1
    white = white[:, :count]
    if n:
        first = np.zeros((segments, n, white.shape[-1]))
        first[0, :, x:y] = np.eye(n)
        white = np.concatenate([white, first], axis=1)
    ends = mean[:-1]
    beside = ((0, 0), (0, n))
    return (
        replace(
            linear,
            state=white[..., :y],
            residual=white[..., y],
            shared=white[..., y + 1 :],
            transition=np.pad(linear.transition, (*beside, (0, n))) + ends[..., :y],
            jump=np.pad(linear.jump, beside) + ends[..., y],
            jump_shared=np.pad(linear.jump_shared, (*beside, (0, 0))) + ends[..., y + 1 :],
            spread=spread[:-1],
        ),
        logarithm,
    )


def scaled(linear: Linearised, local: Local, noise: NoiseModel) -> tuple[Linearised, Local, float]:
    """With rows in units of their noise, and the log-determinant of that."""
    if all(size == 1.0 for size in noise.scales.values()):
        return linear, local, 0.0
    scale = local.scale(noise)
    each = scale[..., None]
    shown = {stream: rows / each for stream, rows in local.shown.items()}
    return (
        replace(
            linear,
            residual=linear.residual / scale,
            state=linear.state / each,
            shared=linear.shared / each,
        ),
        replace(local, measured=local.measured / each, shown=shown),
        2.0 * float(np.log(scale).sum()),
    )
