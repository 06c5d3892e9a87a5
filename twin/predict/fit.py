"""Fit base parameters, biases, added torques and each segment's initial state: Gauss-Newton.

Every column of the Jacobian is a finite difference, all of them in a batch a model. The initial
states are eliminated segment by segment (variable projection), so that a long log costs no more
memory than its residuals.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.predict.base import BaseParameters
from twin.predict.linear import Linear, best_step, cost, project
from twin.predict.problem import Problem, Unknowns
from twin.predict.rollout import Predictor
from twin.predict.uncertainty import correlation_time, covariance_of

Array = NDArray[np.float64]

ITERATIONS = 15
HALVINGS = 6

CONVERGED = 0.1
"""Fall of the cost at which the iteration ends: a third of a standard deviation."""


@dataclass(frozen=True)
class Fit:
    """The unknowns that predict a log best, and how well."""

    at: Unknowns
    residual: list[Array]
    """(measured - predicted) / noise of each segment, flat."""
    covariance: Array
    """Of the shared unknowns, zero for those held."""
    linear: Linear
    """At the fit, each segment at its weight."""
    quantile: float
    """Half a 95 % interval is this many standard deviations."""
    samples_each: float
    """Samples that say as much as one of white noise."""

    @property
    def theta(self) -> Array:
        """(p,) base parameters."""
        return self.at.theta

    @property
    def strengths(self) -> Array:
        """(l,) of the added torques."""
        return self.at.strengths

    @property
    def half_widths(self) -> Array:
        """Half the 95 % interval of each shared unknown."""
        return self.quantile * np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def samples(self) -> int:
        """Numbers predicted."""
        return sum(map(len, self.residual))

    @property
    def chi2_per_sample(self) -> float:
        """Mean squared residual in units of the noise, over the degrees of freedom."""
        fitted = self.at.states.size + np.count_nonzero(self.covariance.diagonal())
        return float(sum(float(r @ r) for r in self.residual)) / max(self.samples - fitted, 1)

    @property
    def is_noise(self) -> bool:
        """Whether what is left is no more than the noise, itself known from as many samples."""
        return self.chi2_per_sample < 1.02 + 5.0 * np.sqrt(5.0 / self.samples)


def fit(
    predictor: Predictor,
    base: BaseParameters,
    *,
    theta: Array | None = None,
    shapes: Sequence[Sequence[Array]] = (),
    strengths: Array | None = None,
    start: Fit | None = None,
    refit_base: bool = True,
    refit_strengths: bool = True,
) -> Fit:
    """Fit a recording: always the initial states and the sensors' biases, and what else is free.

    Args:
        predictor: the recording, cut into segments.
        base: which base parameters there are.
        theta: where they start; as in `start`, or as stated.
        shapes: of each torque to add, one array (steps, base_width) a segment, as strength 1 puts
            it on the base joint.
        strengths: where these start; as in `start`, 0 for those it lacks.
        start: an earlier fit of this predictor, whose torques were the first of `shapes`.
        refit_base: whether the base moves.
        refit_strengths: whether the strengths move.
    """
    problem = Problem(predictor, base, shapes)
    at = problem.start()
    if start is not None:
        missing = np.zeros(len(shapes) - len(start.strengths))
        at = replace(start.at, strengths=np.append(start.strengths, missing))
    if theta is not None:
        at = replace(at, theta=theta)
    if strengths is not None:
        at = replace(at, strengths=strengths)
    free = np.concatenate(
        [
            np.full(len(at.theta), refit_base),
            np.full(len(at.biases), True),
            np.full(len(at.strengths), refit_strengths),
        ]
    )
    residual = problem.residual(at)
    for _ in range(ITERATIONS):
        step, back = best_step(residual, *problem.jacobian(at, residual, free), free)
        before = cost(residual)
        for halving in range(HALVINGS):
            part = 0.5**halving
            moved = at.moved(part * step, part * back)
            tried = problem.try_residual(moved)
            if tried is not None and cost(tried) < before:
                break
        else:
            break
        at, residual = moved, tried
        if before - cost(residual) < CONVERGED:
            break
    linear = project(residual, *problem.jacobian(at, residual)).weighed(residual)
    samples_each = correlation_time(predictor, linear.residual)
    covariance, quantile = covariance_of(linear, free, at.states.size, samples_each)
    return Fit(at, residual, covariance, linear, quantile, samples_each)


def signatures(
    predictor: Predictor, base: BaseParameters, found: Fit, shapes: Sequence[Sequence[Array]]
) -> Linear:
    """The prediction linearised at a fit, with columns of torques that it left out.

    The fit's own torques are the first of `shapes`.
    """
    problem = Problem(predictor, base, shapes)
    missing = np.zeros(len(shapes) - len(found.strengths))
    at = replace(found.at, strengths=np.append(found.strengths, missing))
    shared, local = problem.jacobian(at, found.residual)
    return project(found.residual, shared, local)
