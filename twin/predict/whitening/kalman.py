"""White innovations where the motion itself is noisy: a Kalman filter within each segment.

Each segment's filter starts from a known state, so it runs beside the others, all in one pass; what
it says is affine in that state and in the shared unknowns, and `chain` puts the segments together.
Its gain depends on the path only, so residual and columns go through as right-hand sides of one
filter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twin.predict.whitening.linearised import Linearised
from twin.predict.whitening.noise import Noise
from twin.predict.whitening.spread import root

Array = NDArray[np.float64]


TORQUE = "torque"
"""Among the names of what wanders: no stream has it."""


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
    driven: Array
    """(S, K - 1 or 1, x, c) change of the state in each step by a constant unit force."""
    errors: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """(S, N, k) d(measured / noise) / d error of each of a stream's k columns, by its name; of
    `TORQUE` by a force on each degree of freedom, the state at the instant as it is."""


def whitened(
    linear: Linearised, local: Local, intensity: Array, wandering: Noise | None = None
) -> tuple[Linearised, float]:
    """With random generalised forces and sensor errors at work.

    Args:
        linear: of a motion without noise.
        local: along the same paths.
        intensity: (c,) of the white forces [(N m)^2 s].
        wandering: what else wanders; its n numbers join the states of a segment's start.

    Returns:
        The same with innovations for residuals, and the log-determinant of their covariance.
    """
    x = local.measured.shape[-1]
    known = np.zeros(x)
    force = local.pushed * (intensity * local.step)
    noise = local.wander + (force @ local.pushed.transpose(0, 2, 1))[:, None]
    if wandering is not None:
        local, noise, known = _augmented(local, noise, wandering)
    segments, count, width = local.measured.shape
    # all of a row together, as the filter goes through them, and one more that holds no sample
    white = np.zeros((segments, count + 1, width + 1 + linear.shared.shape[-1]))
    white[:, :count, :x] = linear.state
    white[:, :count, width] = linear.residual
    white[:, :count, width + 1 :] = linear.shared
    measured = with_none(local.measured)
    telling = np.any(measured != 0.0, axis=-1)
    every = np.arange(segments)[:, None]
    mean = np.zeros((segments, width, white.shape[-1]))
    # the path starts from x, and has what wanders nowhere in it yet
    mean[:, x:, x:width] = np.eye(width - x)
    spread = np.zeros((segments, width, width))
    logarithm = 0.0
    for k in range(local.row.shape[1]):
        if k:
            carry = local.carried[:, k - 1]
            mean = carry @ mean
            mean[..., width] += local.drift[:, k - 1]
            spread = carry @ spread @ carry.transpose(0, 2, 1) + noise[:, k - 1]
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
    ends = mean[:-1].copy()
    ends[:, :x, :x] += linear.transition
    ends[:, :x, width] += linear.jump
    ends[:, :x, width + 1 :] += linear.jump_shared
    return (
        replace(
            linear,
            state=white[..., :width],
            residual=white[..., width],
            shared=white[..., width + 1 :],
            transition=ends[..., :width],
            jump=ends[..., width],
            jump_shared=ends[..., width + 1 :],
            spread=spread[:-1],
            known=known,
        ),
        logarithm,
    )


def _augmented(local: Local, noise: Array, wandering: Noise) -> tuple[Local, Array, Array]:
    """The same with the numbers that wander behind those of the state: (S, ., x + n).

    Returns:
        How noise travels, the covariance (S, K - 1, x + n, x + n) that each step adds, and (x + n,)
        one over the standard deviation of what is known of them beforehand.
    """
    x, c = local.measured.shape[-1], local.pushed.shape[-1]
    parts = [np.zeros((*local.measured.shape[:2], 0))]
    rms, times = list[float](), list[float]()
    acting = 0
    if wandering.torque is not None:
        parts.append(local.errors.get(TORQUE, np.zeros((*local.measured.shape[:2], c))))
        rms += [wandering.torque.rms] * c
        times += [wandering.torque.time] * c
        acting = c
    for stream, one in wandering.errors:
        if stream in local.errors:
            seen = local.errors[stream]
            parts.append(seen)
            rms += [one.rms] * seen.shape[-1]
            times += [one.time] * seen.shape[-1]
    kept, variance = np.exp(-local.step / np.array(times)), np.square(np.array(rms))
    n = len(kept)
    segments, steps = local.carried.shape[:2]
    carried = np.zeros((segments, steps, x + n, x + n))
    carried[..., :x, :x] = local.carried
    carried[..., :x, x : x + acting] = local.driven[..., :acting]
    places = np.arange(x, x + n)
    carried[..., places, places] = kept
    added = np.zeros_like(carried)
    added[..., :x, :x] = noise
    added[..., places, places] = variance * (1.0 - np.square(kept))
    drift = np.concatenate([local.drift, np.zeros((*local.drift.shape[:2], n))], axis=-1)
    measured = np.concatenate([local.measured, *parts], axis=-1)
    known = np.concatenate([np.zeros(x), 1.0 / np.sqrt(variance)])
    return replace(local, measured=measured, carried=carried, drift=drift), added, known


def scaled(
    linear: Linearised, local: Local, scales: Sequence[tuple[str, float]]
) -> tuple[Linearised, Local, float]:
    """With the white noise of some streams so many times larger; and by how much the
    log-determinant of the covariance grows."""
    each = np.ones(linear.residual.shape)
    logarithm = 0.0
    for stream, factor in scales:
        if stream in local.errors:
            own = np.any(local.errors[stream] != 0.0, axis=-1)
            each[own] /= factor
            logarithm += 2.0 * float(np.log(factor)) * np.count_nonzero(own)
    rows = each[..., None]
    linear = replace(
        linear,
        residual=linear.residual * each,
        state=linear.state * rows,
        shared=linear.shared * rows,
    )
    errors = {stream: seen * rows for stream, seen in local.errors.items()}
    return linear, replace(local, measured=local.measured * rows, errors=errors), logarithm


def with_none(rows: Array) -> Array:
    """Rows (S, N, ...), and after them one of zeros: of a slot that holds no sample."""
    return np.concatenate([rows, np.zeros_like(rows[:, :1])], axis=1)
