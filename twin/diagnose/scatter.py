"""Causes that change no expected value, but how far a sensor's readings scatter.

What a fit leaves of a sensor has a variance a + declared(t) + g^2 s(t)^2, s being what the effect
of size 1 adds. Twice the logarithm of the likelihood's ratio to g = 0 is the gain; declared is what
the platform has of such effects already.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from twin.diagnose.cause import NAMELESS, Cause, Tie, share_of
from twin.diagnose.explanation import Explanation
from twin.diagnose.search import EVEN, FALSE_ALARM, price
from twin.effects import Effect, ScatterEffect, catalogue, effects_of
from twin.effects.effect import targets
from twin.identify.prediction_error import NORMAL
from twin.predict.log.shaking import added_variance

Array = NDArray[np.float64]


def scatter_causes(
    now: Explanation, taken: Sequence[Effect] = (), *, unexplained: bool = False
) -> tuple[Cause, ...]:
    """The best one beyond chance, if any, and those beside it; none where no motion follows.

    Args:
        now: the explanation that stands.
        taken: those that are found already.
        unexplained: something is at work that has no name.
    """
    platform = now.bodies[0].machine.platform
    if not now.follows:
        return ()
    unit = [
        kind(**kind.named([1.0]), target=target)
        for kind in catalogue()
        if issubclass(kind, ScatterEffect) and len(kind.parameters()) == 1
        for target in targets(kind.takes, platform)
    ]
    known = [one.label for one in (*effects_of(platform), *taken)]
    asked = [one for one in unit if not one.unfit(platform) and one.label not in known]
    found = [one for effect in asked if (one := _cause(now, effect, taken)) is not None]
    found.sort(key=lambda cause: -cause.evidence)
    if not found or np.exp(-0.5 * found[0].alone) > FALSE_ALARM / len(asked):
        return ()
    first, *others = found
    behind = {one.effect.label: first.evidence - one.evidence for one in others}
    share = share_of([*behind.values(), first.evidence]) * (NAMELESS if unexplained else 1.0)
    ties = tuple(Tie(label, far) for label, far in behind.items() if far < EVEN)
    named = replace(first, confidence=share, ties=ties, alone=first.evidence)
    rest = () if ties else scatter_causes(now, (*taken, first.effect), unexplained=unexplained)
    return (named, *rest)


def _cause(now: Explanation, effect: ScatterEffect, taken: Sequence[Effect]) -> Cause | None:
    """Alone; its gain as it is stands for its evidence alone."""
    every = (*effects_of(now.bodies[0].machine.platform), *taken)
    others = [
        one for one in every if isinstance(one, ScatterEffect) and one.acts_on == effect.acts_on
    ]
    squares: list[Array] = []
    added: list[Array] = []
    stated: list[Array] = []
    for body, every_left in zip(now.bodies, now.account.left, strict=True):
        for output, left in zip(body.outputs, every_left, strict=True):
            if output.stream != effect.acts_on:
                continue
            squares.append(np.square(left * output.sigma))
            own = added_variance(effect, body.inputs, output.time)
            known = [added_variance(one, body.inputs, output.time) for one in others]
            added.append(own)
            stated.append(sum(known, start=np.zeros_like(own)))
    if not any(own.any() for own in added):
        return None
    square, more, declared = map(np.concatenate, (squares, added, stated))

    def cost(numbers: Array) -> float:
        variance = np.exp(numbers[0]) + declared + np.square(numbers[1] / scale) * more
        return float(np.sum(np.log(variance) + square / variance))

    scale = np.sqrt(more.mean() / square.mean())
    quiet = np.log(max(float(np.mean(square - declared)), 1e-3 * float(square.mean())))
    none = minimize(lambda a: cost(np.array([a[0], 0.0])), [quiet], method="Nelder-Mead")
    best = minimize(cost, [float(none.x[0]), 0.3], method="Nelder-Mead")
    gain = float(none.fun - best.fun)
    evidence = gain - price(gain, np.ones(1))
    if evidence <= 0.0:
        return None
    size = abs(float(best.x[1]))
    step = 0.02 * size
    side = [cost(np.array([best.x[0], size + sign * step])) for sign in (-1.0, 1.0)]
    bend = max((side[0] + side[1] - 2.0 * float(best.fun)) / step**2, 1e-300)
    half = NORMAL * np.sqrt(2.0 / bend) / scale
    there = effect.with_values(np.clip([size / scale], *effect.bounds()))
    width = np.array([half])
    return Cause(there, np.array([True]), width, width, evidence, gain, 1.0, ())
