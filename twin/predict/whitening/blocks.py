"""A linearised log in blocks of time within which nothing wanders: as good for slow processes.

The intensities of noise processes are sought by many filter passes. In a block, some ten samples of
each sensor depend on the state at its beginning and on what wanders; an orthogonal transformation
squeezes them into as many rows as there are such numbers, once, and each pass then visits blocks
instead of samples.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.predict.whitening.kalman import TORQUE, Local, with_none
from twin.predict.whitening.linearised import Linearised

Array = NDArray[np.float64]

LENGTH = 0.1
"""Of a block [s]."""


def blocked(linear: Linearised, local: Local, length: float = LENGTH) -> tuple[Linearised, Local]:
    """The same log in blocks; what wanders is constant in each.

    Args:
        linear: of a motion without noise.
        local: along the same paths.
        length: of a block [s].
    """
    steps = max(round(length / local.step), 1)
    if steps == 1:
        return linear, local
    x, c = local.measured.shape[-1], local.pushed.shape[-1]
    names = [TORQUE, *local.errors]
    widths = [c, *(seen.shape[-1] for seen in local.errors.values())]
    n, segments, instants = sum(widths), *local.row.shape[:2]
    right = np.concatenate([linear.residual[..., None], linear.state, linear.shared], axis=-1)
    parts = [with_none(one) for one in (local.measured, *local.errors.values(), right)]
    every = np.arange(segments)[:, None]
    # the last instant by itself: there the next segment begins
    edges = [*range(0, instants - 1, steps), instants - 1, instants]
    triangles: list[Array] = []
    carried: list[Array] = []
    driven: list[Array] = []
    added: list[Array] = []
    drifts: list[Array] = []
    for first, last in zip(edges, edges[1:], strict=False):
        moved = np.zeros((segments, x, x + c))
        moved[:, :, :x] = np.eye(x)
        drift, noise = np.zeros((segments, x)), np.zeros((segments, x, x))
        rows: list[Array] = []
        for k in range(first, last):
            slots = local.row[:, k]
            measured, *errors, affine = (part[every, slots] for part in parts)
            affine[..., 0] -= np.einsum("swx,sx->sw", measured, drift)
            rows.append(np.concatenate([measured @ moved, *errors, affine], axis=-1))
            if k == instants - 1:
                break
            carry = local.carried[:, k]
            moved = carry @ moved
            moved[:, :, x:] += local.driven[:, min(k, local.driven.shape[1] - 1)]
            drift = np.einsum("sxy,sy->sx", carry, drift) + local.drift[:, k]
            noise = carry @ noise @ carry.transpose(0, 2, 1) + local.wander[:, k]
        stacked = np.concatenate(rows, axis=1)
        triangles.append(np.asarray(np.linalg.qr(_taller(stacked, x + n), mode="r")))
        carried.append(moved[:, :, :x])
        driven.append(moved[:, :, x:])
        drifts.append(drift)
        added.append(noise)
    tall = max(one.shape[1] for one in triangles)
    whole = np.stack([_taller(one, tall) for one in triangles], axis=1)
    flat = whole.reshape(segments, -1, whole.shape[-1])
    telling = np.zeros(tall, dtype=bool)
    telling[: x + n] = True
    row = np.arange(len(triangles) * tall, dtype=np.int32).reshape(1, -1, tall)[..., telling]
    ends = np.cumsum([x, *widths])
    own = [flat[..., i:j] for i, j in zip(ends, ends[1:], strict=False)]
    unseen = ~np.tile(telling, len(triangles))
    for one in (flat[..., :x], *own):
        one[:, unseen] = 0.0
    right = flat[..., x + n :]
    return (
        replace(
            linear,
            residual=right[..., 0],
            state=right[..., 1 : 1 + x],
            shared=right[..., 1 + x :],
        ),
        Local(
            flat[..., :x],
            np.broadcast_to(row, (segments, *row.shape[1:])),
            np.stack(carried[:-1], 1),
            local.pushed,
            local.step * steps,
            np.stack(added[:-1], 1),
            np.stack(drifts[:-1], 1),
            np.stack(driven[:-1], 1),
            dict(zip(names, own, strict=True)),
        ),
    )


def _taller(rows: Array, least: int) -> Array:
    """(S, N, k) with so many rows at least."""
    return np.pad(rows, ((0, 0), (0, max(least - rows.shape[1], 0)), (0, 0)))
