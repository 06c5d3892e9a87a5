"""Which of the known laws explains what a model leaves unexplained: forward selection.

Each round scores every law by the fall of the cost that its column promises, base and initial
states projected out; the best is fitted properly and stays if its strength is beyond doubt.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from twin.predict.base import BaseParameters
from twin.predict.fit import NORMAL, Fit, Linear, cost, fit, signatures
from twin.predict.laws import LAWS, Law, shape_of
from twin.predict.rollout import Predictor

Array = NDArray[np.float64]

FALSE_ALARM = 0.01
"""Chance of naming any law when there is none."""

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
    while left and len(chosen) < MOST:
        order = [*chosen, *left]
        strengths = np.concatenate([best.strengths, np.zeros(len(left))])
        linear = signatures(predictor, base, best, [shapes[i] for i in order], strengths)
        promise = _promise(linear, base, [LAWS[i] for i in order], len(chosen), refit_base)
        promise = promise / best.samples_each - [LAWS[i].rarity for i in left]
        if promise.max() <= 0.0:
            break
        index = left.pop(int(np.argmax(promise)))
        tried = [*chosen, index]
        found = fit(
            predictor,
            base,
            theta=best.theta,
            shapes=[shapes[i] for i in tried],
            strengths=np.append(best.strengths, 0.0),
            states=best.states,
            refit_base=refit_base,
        )
        if cost(found.residual) < cost(best.residual) and _all_certain(found, tried):
            chosen, best = tried, found
    return Explanation(best, tuple(_strengths(best, chosen)))


def _promise(
    linear: Linear, base: BaseParameters, laws: list[Law], chosen: int, refit_base: bool
) -> Array:
    """Fall of the cost that each law after the first `chosen` promises; negative: none."""
    normal, gradient = linear.normal, linear.gradient
    fixed = len(base.as_stated)
    nuisance = [*range(0 if refit_base else fixed, fixed), *range(fixed, fixed + chosen)]
    promise = np.full(len(laws) - chosen, -1.0)
    for place, law in enumerate(laws[chosen:]):
        column = fixed + chosen + place
        across = normal[column, nuisance]
        known = np.linalg.lstsq(normal[np.ix_(nuisance, nuisance)], across, rcond=1e-12)[0]
        own = normal[column, column] - known @ across
        slope = -(gradient[column] - known @ gradient[nuisance])
        if own > HIDDEN * normal[column, column] and not (law.dissipative and slope < 0.0):
            promise[place] = slope**2 / own
    return promise


def _all_certain(found: Fit, tried: list[int]) -> bool:
    """Whether every law in a fit is different from nothing, beyond the chance of a false alarm."""
    sure = float(norm.ppf(1.0 - FALSE_ALARM / (2 * len(LAWS)))) * found.quantile / NORMAL
    offset = len(found.theta)
    for place, index in enumerate(tried):
        value = found.strengths[place]
        sigma = np.sqrt(found.covariance[offset + place, offset + place])
        if abs(value) < sure * sigma or (LAWS[index].dissipative and value < 0.0):
            return False
    return True


def _strengths(found: Fit, chosen: list[int]) -> list[Strength]:
    fixed = len(found.theta)
    sigma = np.sqrt(np.diag(found.covariance)[fixed:])
    normal = found.linear.normal
    strengths: list[Strength] = []
    for place, index in enumerate(chosen):
        across = normal[fixed + place, :fixed]
        known = np.linalg.lstsq(normal[:fixed, :fixed], across, rcond=1e-12)[0]
        value, half = float(found.strengths[place]), found.quantile * float(sigma[place])
        imitated = float(known @ across / normal[fixed + place, fixed + place])
        strengths.append(Strength(LAWS[index], value, value - half, value + half, imitated))
    return strengths
