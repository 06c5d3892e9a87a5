"""Causes fitted where an explanation stands, from what the linear columns make them.

What a large turn does is not proportional to it, so such fits begin from turns about each axis.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation
from twin.diagnose.laws import Law
from twin.diagnose.screen import Weighing
from twin.effects import Effect
from twin.errors import TwinError
from twin.platform import Platform
from twin.predict.columns import amplitudes, strengths_of, with_strengths

LARGE = 0.5
"""Turn [rad] from which on its linear column is no guess of where it leads."""
ASTRAY = 0.1
"""A fit that is less likely by more than this a sample than the one it began from has lost it."""
ELSEWHERE = 1.0
"""-2 log L by which a fit from another start must be likelier to be more than the same minimum."""
CROWD = 3
"""Causes beyond which a set stands in for something else: neither one of them of another shape, nor
any that points elsewhere."""


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


def guesses(
    now: Explanation, asked: Sequence[Candidate], weighing: Weighing, chosen: tuple[int, ...]
) -> list[Effect]:
    """The chosen effects, new ones with their linearised strengths; no laws."""
    found: list[Effect] = []
    for index, own in zip(chosen, weighing.weigh(chosen).strengths, strict=True):
        if index < len(now.effects):
            found.append(now.effects[index])
        elif index >= len(now.own):
            effect = asked[index - len(now.own)].effect
            strengths = strengths_of(effect)
            strengths[amplitudes(effect)] = own
            found.append(with_strengths(effect, strengths))
    return found


def fitted(
    now: Explanation, effects: Sequence[Effect], laws: Sequence[Law] = ()
) -> Explanation | None:
    """Other effects and laws in place of its own; None where no machine can have them."""
    best: Explanation | None = None
    for start in starts(effects, now.effects, now.bodies[0].machine.platform):
        with suppress(TwinError):
            found = now.instead(start, laws)
            best = found if best is None or found.cost < best.cost - ELSEWHERE else best
        # wherever one of a crowd points, it stands in for something else
        if best is not None and len(effects) > CROWD:
            break
    return best


def followed(
    now: Explanation, effects: Sequence[Effect], laws: Sequence[Law] = ()
) -> Explanation | None:
    """Likewise; None too where the fit loses the motion."""
    found = fitted(now, effects, laws)
    return None if found is None or astray(now, found) else found


def astray(now: Explanation, tried: Explanation) -> bool:
    """Whether a fit has lost the motion that it should follow."""
    return now.follows and not tried.cost < now.cost + ASTRAY * now.samples
