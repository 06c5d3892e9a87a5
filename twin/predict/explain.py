"""Which of the known laws explains what a model leaves unexplained: forward selection.

Each round scores every law by the fall of the cost that its column promises, base and initial
states projected out; the best is fitted properly and stays if its strength is beyond doubt. What
dissipates is asked first: every bearing has friction, not every machine a cable.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from twin.predict.base import BaseParameters
from twin.predict.fit import Fit, fit, signatures
from twin.predict.laws import LAWS, Law, shape_of
from twin.predict.linear import Linear, cost, shared_step
from twin.predict.rollout import Predictor
from twin.predict.uncertainty import NORMAL

Array = NDArray[np.float64]

FALSE_ALARM = 0.01
"""Chance of naming any law when there is none."""

CERTAIN = float(norm.ppf(1.0 - FALSE_ALARM / (2 * len(LAWS))))
"""Standard deviations by which a strength must differ from 0."""

HIDDEN = 1e-4
"""A law of which less than this share is left when base and initial states are free is not seen."""

MOST = 3
"""Laws named; beyond, the numbers of a sum of simple laws mean little."""


@dataclass(frozen=True)
class Strength:
    """A law with the strength that a log gives it, and its 95 % interval."""

    law: Law
    value: float
    low: float
    high: float
    imitated: float
    """Share of its effect on the log that a change of the base could imitate."""


@dataclass(frozen=True)
class Explanation:
    """The laws that pay, and the fit that contains them."""

    fit: Fit
    laws: tuple[Strength, ...]


def explain(
    predictor: Predictor, base: BaseParameters, plain: Fit, *, refit_base: bool
) -> Explanation:
    """Add laws to a fit as long as they pay.

    Args:
        predictor: the recording.
        base: its base parameters.
        plain: the fit without any law.
        refit_base: whether the base stays free, as it was in `plain`.
    """
    shapes = [shape_of(law, predictor) for law in LAWS]
    left = [i for i, shape in enumerate(shapes) if any(np.any(part) for part in shape)]
    chosen: list[int] = []
    best = plain
    while left and len(chosen) < MOST and not (chosen and best.is_noise):
        order = [*chosen, *left]
        linear = signatures(predictor, base, best, [shapes[i] for i in order])
        held = 0 if refit_base else len(best.theta)
        known = range(held, best.at.shared)
        promise = _promise(linear, known, [LAWS[i] for i in left]) / best.samples_each
        first = [LAWS[i].dissipative for i in left] & (promise > CERTAIN**2)
        place = int(np.argmax(np.where(first, promise, -np.inf) if first.any() else promise))
        if promise[place] < CERTAIN**2:
            break
        tried = [*chosen, left.pop(place)]
        found = fit(
            predictor,
            base,
            shapes=[shapes[i] for i in tried],
            start=best,
            refit_base=refit_base,
        )
        sure = _certain(found, tried)
        if tried[-1] in sure and len(sure) < len(tried):
            tried = sure
            found = fit(predictor, base, shapes=[shapes[i] for i in tried], refit_base=refit_base)
            sure = _certain(found, tried)
        if cost(found.residual) < cost(best.residual) and sure == tried:
            chosen, best = tried, found
    return Explanation(best, tuple(_strengths(best, chosen)))


def _promise(flat: Linear, known: range, laws: list[Law]) -> Array:
    """Fall of the linearised cost that each of the last columns promises beside the known ones.

    -inf: the log does not show it, or shows less than nothing of a law that only dissipates.
    """
    normal = flat.weighed(flat.residual).normal
    free = np.zeros(len(normal), dtype=bool)
    free[known] = True
    without = cost(shared_step(flat, free)[1])
    promise = np.full(len(laws), -np.inf)
    for column, law in enumerate(laws, known.stop):
        own, across = normal[column, column], normal[column, known]
        mix = np.linalg.lstsq(normal[np.ix_(known, known)], across, rcond=1e-12)[0]
        if own - mix @ across <= HIDDEN * own:
            continue
        free[column] = True
        step, left = shared_step(flat, free)
        free[column] = False
        if not (law.dissipative and step[column] < 0.0):
            promise[column - known.stop] = without - cost(left)
    return promise


def _certain(found: Fit, tried: list[int]) -> list[int]:
    """Those laws of a fit that differ from nothing, beyond the chance of a false alarm."""
    halves = found.half_widths[-len(tried) :] * CERTAIN / NORMAL
    return [
        index
        for index, value, half in zip(tried, found.strengths, halves, strict=True)
        if abs(value) > half and not (LAWS[index].dissipative and value < 0.0)
    ]


def _strengths(found: Fit, chosen: list[int]) -> list[Strength]:
    normal, base = found.linear.normal, range(len(found.theta))
    first = found.at.shared - len(chosen)
    strengths: list[Strength] = []
    for place, index in enumerate(chosen):
        column = first + place
        across = normal[column, base]
        mix = np.linalg.lstsq(normal[np.ix_(base, base)], across, rcond=1e-12)[0]
        value, half = float(found.strengths[place]), float(found.half_widths[column])
        imitated = float(mix @ across / normal[column, column])
        strengths.append(Strength(LAWS[index], value, value - half, value + half, imitated))
    return strengths
