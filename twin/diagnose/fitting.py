"""Causes fitted where an explanation stands, from what the linear columns make them."""

from collections.abc import Sequence
from contextlib import suppress

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation
from twin.diagnose.law import Law
from twin.diagnose.turns import starts
from twin.diagnose.weighing import Weighing
from twin.effects import Effect
from twin.errors import TwinError
from twin.predict.effects.columns import amplitudes, strengths_of, with_strengths

ASTRAY = 0.1
"""A fit that is less likely by more than this a sample than the one it began from has lost it."""
ELSEWHERE = 1.0
"""-2 log L by which a fit from another start must be likelier to be more than the same minimum."""
CROWD = 3
"""Causes beyond which a set stands in for something else: neither one of them of another shape, nor
any that points elsewhere."""


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
