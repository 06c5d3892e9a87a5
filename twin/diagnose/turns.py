"""Where fits of parts that point elsewhere begin: what a large turn does is not proportional to
it."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.effects import Effect
from twin.platform import Platform

LARGE = 0.5
"""Turn [rad] from which on its linear column is no guess of where it leads."""


def starts(
    effects: Sequence[Effect], fitted: Collection[Effect], platform: Platform
) -> Iterator[tuple[Effect, ...]]:
    """A set of effects as it is, then with each large turn that is but guessed about each axis.

    Args:
        effects: the set.
        fitted: those of it that are no guesses.
        platform: what they are effects of.
    """
    yield tuple(effects)
    for index, guess in enumerate(effects):
        turn = _turn_of(guess)
        size = float(np.linalg.norm(guess.values[turn]))
        if size < LARGE or guess in fitted:
            continue
        low, high = guess.bounds()
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            values = guess.values.copy()
            values[turn] = np.clip(size * axis, low[turn], high[turn])
            # about the part's own axis nothing turns
            other = guess.with_values(values).least(platform)
            if np.linalg.norm(other.values[turn]) > 0.5 * size:
                yield (*effects[:index], other, *effects[index + 1 :])


def _turn_of(effect: Effect) -> NDArray[np.bool_]:
    """(p,) which of its components are a vector of angles; none if it has no such."""
    known = effect.parameters()
    return np.concatenate(
        [np.full(one.size, one.unit == "rad" and one.size == 3 and one.amplitude) for one in known]
    )
