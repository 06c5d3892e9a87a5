"""Effects between two fits: how far they may move and did, how large they are, what of them no log
shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.layout import Layout
from twin.effects import Effect
from twin.predict.effects.columns import amplitudes
from twin.predict.effects.perturbation import Perturbation

Array = NDArray[np.float64]


def between(first: Sequence[Effect], last: Sequence[Effect], share: float) -> tuple[Effect, ...]:
    """So much of the way from one to the other."""
    # a sum may end a rounding beyond a bound
    return tuple(
        end.with_values(np.clip(begin.values + share * (end.values - begin.values), *end.bounds()))
        for begin, end in zip(first, last, strict=True)
    )


def held(effect: Effect, parts: Sequence[Perturbation]) -> tuple[Perturbation, ...]:
    """Its perturbations, those of its shape moved by a fit no further than what shapes are like.

    What a log hardly tells, a fit would follow to where the columns mean nothing any more, and an
    amplitude with it: a draft that pushes hard near the bearing is one that pushes far from it.
    """
    if not parts:
        return ()
    return tuple(
        part if size else replace(part, spread=scale)
        for part, size, scale in zip(
            parts, amplitudes(effect), effect.scale().tolist(), strict=True
        )
    )


def largest(effect: Effect, free: NDArray[np.bool_]) -> float:
    """Of its amplitudes, in units of what each is usually like, if a log shows any."""
    size = amplitudes(effect)
    return float(np.abs(effect.values / usual(effect))[size].max()) if (size & free).any() else 0.0


def usual(effect: Effect) -> Array:
    """(p,) what each component is usually like; the same for all of a vector."""
    scale = effect.scale()
    ends = np.cumsum([0, *(known.size for known in effect.parameters())])
    return np.concatenate(
        [np.full(j - i, scale[i:j].max()) for i, j in zip(ends, ends[1:], strict=False)]
    )


def unseen(
    effects: Sequence[Effect], free: Sequence[NDArray[np.bool_]], most: Sequence[float]
) -> list[NDArray[np.bool_]]:
    """(p,) of each effect, amplitudes that no log shows beside the others."""
    return [
        amplitudes(effect) & ~ones & (size > 0.0)
        for effect, ones, size in zip(effects, free, most, strict=True)
    ]


def whole(
    effects: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    columns: Array,
    strengths: Array,
    layout: Layout,
) -> Array:
    """Columns without the first, of amplitudes of each effect that no log shows: they come and go
    with the largest that one does. `layout` is that of the columns and their strengths."""
    first = layout.own.start
    found = columns[:, first:].copy()
    places = zip(effects, free, layout.of_hidden, layout.of_free, strict=True)
    for effect, ones, beside, own in places:
        sizes = np.where(amplitudes(effect)[ones], np.abs(strengths[own]), 0.0)
        if beside.stop > beside.start and sizes.any():
            most = own.start + int(np.argmax(sizes))
            share = strengths[beside] / strengths[most]
            found[:, most - first] += columns[:, beside] @ share
    return found


def in_sigmas(
    effects: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    covariances: Sequence[Array],
) -> float:
    """How far the largest effect's amplitudes are from none, given the covariances of what was
    fitted of each effect; 0 without any."""
    sizes = [0.0]
    for effect, fitted, spread in zip(effects, free, covariances, strict=True):
        own = amplitudes(effect)[fitted]
        if own.any():
            sizes.append(distance(effect.values[fitted][own], spread[np.ix_(own, own)]))
    return max(sizes)


def farthest(
    before: Sequence[Effect],
    after: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    covariances: Sequence[Array],
) -> float:
    """How far effects have moved at most, likewise."""
    return max(
        distance((now.values - then.values)[fitted], spread)
        for then, now, fitted, spread in zip(before, after, free, covariances, strict=True)
    )


def distance(step: Array, spread: Array) -> float:
    """Of a step, in standard deviations."""
    return float(np.sqrt(max(step @ np.linalg.pinv(spread, hermitian=True) @ step, 0.0)))
