"""What logs alone tell of the components of effects: how well, and which only beside others that
they do not tell."""

from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.explanation import Explanation
from twin.diagnose.moves import unseen
from twin.effects import Effect
from twin.platform import Platform
from twin.predict.effects.columns import amplitudes, slopes_of

Array = NDArray[np.float64]

LEANS = 0.2
"""Standard deviations by which a component moves with one that no log tells, if that is wrong by
its own size, from where on it is told only beside that."""

NEARBY = 1e-4
"""Of a component's typical size, to the other end of a finite difference; and what of a difference
is none."""


@dataclass(frozen=True)
class Told:
    """Of one effect."""

    deviations: Array
    """(p,) standard deviations, those held being what they are; NaN of those."""
    leaning: NDArray[np.bool_]
    """(p,) which would be others, were one that is held another."""


def told(now: Explanation) -> tuple[Told, ...]:
    """Of each effect of an explanation, by the logs and by what is known of sensors.

    A fit moves a shape no further than shapes are like, and holds what no log shows. Neither is
    knowledge: that a draft pushes at a point 0.3 m above the bearing is a place to begin from, and
    as far as the point is another, its force is.
    """
    if not now.effects:
        return ()
    platform = now.bodies[0].machine.platform
    free, sizes = np.concatenate(now.free), np.concatenate([*map(amplitudes, now.effects)])
    held = ~free & ~sizes
    slopes = [part for effect in now.effects for part in slopes_of(effect, platform)]
    rows = now.rows_with(list(compress(slopes, held)))
    edge = rows.columns.shape[1] - np.count_nonzero(held)
    own = edge - len(now.laws) - np.count_nonzero(free) + np.arange(np.count_nonzero(free))
    # rows that hold shapes near where they began
    shapes = own[~sizes[free]]
    begun = (rows.cluster < 0) & rows.columns[:, shapes].any(axis=1)
    columns = rows.columns[~begun]
    scale = 1.0 / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    triangle = np.asarray(np.linalg.qr(columns * scale, mode="r"))
    inverse = scale[:edge, None] * np.linalg.pinv(triangle[:edge, :edge], rcond=1e-12)
    moves = (inverse @ triangle[:edge, edge:] / scale[edge:])[own]
    wrong = np.concatenate([np.maximum(np.abs(e.values), e.scale()) for e in now.effects])[held]
    known, moved = np.zeros((len(free), edge)), np.zeros((len(free), len(wrong)))
    known[free], moved[free] = inverse[own], moves
    hidden = np.concatenate(unseen(now.effects, now.free, now.most))
    known[hidden] = inverse[edge - len(now.at.strengths) + now.layout.rests :][: hidden.sum()]
    found: list[Told] = []
    first = 0
    for effect, ones in zip(now.effects, now.free, strict=True):
        part = slice(first, first := first + len(ones))
        share = _least_by(effect, platform)
        deviations = np.linalg.norm(share @ known[part], axis=1)
        leaning = np.abs(share @ moved[part]) @ wrong > LEANS * deviations
        # what is held is told where it goes with what is not
        tells = (np.abs(share) @ ones) > NEARBY
        found.append(Told(np.where(tells, deviations, np.nan), leaning & tells))
    return tuple(found)


def _least_by(effect: Effect, platform: Platform) -> Array:
    """(p, p) how the smallest effect that does the same goes with the components of one."""
    if effect.least(platform) is effect:
        return np.eye(len(effect.values))
    columns: list[Array] = []
    for unit in np.diag(NEARBY * effect.scale()):
        ends = [np.clip(effect.values + side * unit, *effect.bounds()) for side in (-1.0, 1.0)]
        before, after = (effect.with_values(end).least(platform).values for end in ends)
        columns.append((after - before) / np.sum(ends[1] - ends[0]))
    return np.column_stack(columns)
