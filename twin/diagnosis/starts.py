"""Fits of a set of causes that begin from several starts.

A fit finds the nearest minimum. A large turn begins along each axis in turn, and a base that other
effects have led far from any machine's begins again as stated.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from twin.diagnosis.explanation import CROWD, Explanation, astray
from twin.diagnosis.laws import Law
from twin.effects import Effect
from twin.errors import TwinError
from twin.platform import Platform

TURNED = 0.5
"""Turn [rad] above which a linear column is no start for a fit, and all axes are tried."""
ELSEWHERE = 1.0
"""Difference of -2 log L above which a fit from another start is another minimum."""


def starts(
    effects: Sequence[Effect], fitted: Collection[Effect], platform: Platform
) -> Iterator[tuple[Effect, ...]]:
    """Starts of a fit: the effects as given, then with each large turn about each axis in turn.

    Args:
        effects: at their starting values.
        fitted: those of them that are fitted already.
        platform: the machine.
    """
    yield tuple(effects)
    for index, guess in enumerate(effects):
        turn = _turn_of(guess)
        size = float(np.linalg.norm(guess.values[turn]))
        if size < TURNED or guess in fitted:
            continue
        low, high = guess.bounds()
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            values = guess.values.copy()
            values[turn] = np.clip(size * axis, low[turn], high[turn])
            # a turn about the part's own axis does nothing
            other = guess.with_values(values).least(platform)
            if np.linalg.norm(other.values[turn]) > 0.5 * size:
                yield (*effects[:index], other, *effects[index + 1 :])


def _turn_of(effect: Effect) -> NDArray[np.bool_]:
    """(p,) which components are a vector of angles."""
    known = effect.parameters()
    return np.concatenate(
        [
            np.full(item.size, item.unit == "rad" and item.size == 3 and item.amplitude)
            for item in known
        ]
    )


def fitted(
    explanation: Explanation, effects: Sequence[Effect], laws: Sequence[Law] = ()
) -> Explanation | None:
    """Fit other effects and laws from several starts; None where the machine cannot have them."""
    best: Explanation | None = None
    for start in starts(effects, explanation.effects, explanation.bodies[0].machine.platform):
        with suppress(TwinError):
            result = explanation.instead(start, laws)
            best = result if best is None or result.cost < best.cost - ELSEWHERE else best
        # of a large set, one start is enough
        if best is not None and len(effects) > CROWD:
            break
    if best is None or not best.converged:
        with suppress(TwinError):
            best = _from_stated(explanation, effects, laws, best)
    return best


def _from_stated(
    explanation: Explanation,
    effects: Sequence[Effect],
    laws: Sequence[Law],
    best: Explanation | None,
) -> Explanation | None:
    """The best of a fit that has not converged and, where the base as stated is nearer to the logs
    than that, of one that begins there: beside other effects the base may have moved far from any
    machine's."""
    exact = explanation.follows and not explanation.noise.wanders
    if not exact or not len(explanation.base.as_stated):
        return best
    if best is not None and not explanation.as_stated(effects, laws).cost < best.cost:
        return best
    result = explanation.instead(effects, laws, stated=True)
    return result if best is None or result.cost < best.cost else best


def followed(
    explanation: Explanation, effects: Sequence[Effect], laws: Sequence[Law] = ()
) -> Explanation | None:
    """The same; None also where the fit diverges."""
    result = fitted(explanation, effects, laws)
    return None if result is None or astray(explanation, result) else result
