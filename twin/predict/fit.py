"""Fit base parameters, added torques and each segment's initial state to a log: Gauss-Newton.

Every column of the Jacobian is a finite difference, all of them in a batch a model. The initial
states are eliminated segment by segment (variable projection), so that a long log costs no more
memory than its residuals.

A segment that the model misses, because somebody pushed the machine, must not bend the parameters:
each segment has a noise scale of its own, at least that of its sensors, and the likelihood is taken
at its best. So a segment whose mean squared residual is x (in units of the noise) costs N x up to
x = 1 and N (1 + log x) beyond; in the iteration it weighs 1 / x.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from twin.errors import TwinError
from twin.predict.base import BaseParameters
from twin.predict.rollout import Predictor

Array = NDArray[np.float64]

STEP = 1e-6
"""Of finite differences, in units of a parameter's scale."""

ITERATIONS = 15
HALVINGS = 6
REWEIGHTINGS = 30
NORMAL = 1.96
"""95 % of a normal distribution lie within this many standard deviations."""

CONVERGED = 0.1
"""Fall of the cost at which the iteration ends: a third of a standard deviation."""


@dataclass(frozen=True)
class Linear:
    """A linearised prediction: residual and columns, the initial states projected out."""

    residual: list[Array]
    """Of each segment, (N_s,)."""
    columns: list[Array]
    """Of each segment, (N_s, parameters)."""

    def after(self, step: Array) -> list[Array]:
        """The residual of each segment after a step of the parameters."""
        return [r + a @ step for r, a in zip(self.residual, self.columns, strict=True)]

    def weighed(self, like: list[Array]) -> "Linear":
        """Each segment at the weight that such a residual gives it."""
        roots = [np.sqrt(_weight(r)) for r in like]
        return Linear(
            [root * r for root, r in zip(roots, self.residual, strict=True)],
            [root * a for root, a in zip(roots, self.columns, strict=True)],
        )

    @property
    def normal(self) -> Array:
        """Sum of A^T A."""
        return np.sum([a.T @ a for a in self.columns], axis=0)

    @property
    def gradient(self) -> Array:
        """Sum of A^T r."""
        pairs = zip(self.columns, self.residual, strict=True)
        return np.sum([a.T @ r for a, r in pairs], axis=0)


@dataclass(frozen=True)
class Fit:
    """The parameters that predict a log best, and how well."""

    theta: Array
    """(p,) base parameters."""
    strengths: Array
    """(l,) of the added torques."""
    states: Array
    """(segments, state_width) changes of the initial states."""
    residual: list[Array]
    """(measured - predicted) / noise of each segment, flat."""
    covariance: Array
    """Of the fitted ones of (theta, strengths), zero elsewhere, shape (p + l, p + l)."""
    linear: Linear
    quantile: float
    """Half a 95 % interval is this many standard deviations."""
    samples_each: float
    """Samples that say as much as one of white noise."""

    @property
    def samples(self) -> int:
        """Numbers predicted."""
        return sum(map(len, self.residual))

    @property
    def chi2_per_sample(self) -> float:
        """Mean squared residual in units of the noise, over the degrees of freedom."""
        freedom = max(
            self.samples - self.states.size - np.count_nonzero(self.covariance.diagonal()), 1
        )
        return float(sum(float(r @ r) for r in self.residual)) / freedom


def fit(
    predictor: Predictor,
    base: BaseParameters,
    *,
    theta: Array | None = None,
    shapes: Sequence[Sequence[Array]] = (),
    strengths: Array | None = None,
    states: Array | None = None,
    refit_base: bool = True,
    refit_strengths: bool = True,
) -> Fit:
    """Fit a recording: always the initial states, and what else is free.

    Args:
        predictor: the recording, cut into segments.
        base: which base parameters there are.
        theta: where they start; as stated when None.
        shapes: of each torque to add, one array (steps, base_width) a segment, as strength 1 puts
            it on the base joint.
        strengths: where these start; 0 when None.
        states: where the changes of the initial states start; 0 when None.
        refit_base: whether the base moves.
        refit_strengths: whether the strengths move.
    """
    problem = _Problem(predictor, base, shapes)
    theta = base.as_stated if theta is None else theta
    strengths = np.zeros(len(shapes)) if strengths is None else strengths
    if states is None:
        states = np.zeros((len(predictor.segments), predictor.state_width))
    free = np.concatenate([np.full(len(theta), refit_base), np.full(len(shapes), refit_strengths)])
    residual = problem.predict(theta, strengths, states)
    for _ in range(ITERATIONS):
        columns, local = problem.jacobian(theta, strengths, states, residual, free)
        step, back = _step(residual, columns, local, free)
        before = cost(residual)
        for halving in range(HALVINGS):
            part = 0.5**halving
            new = theta + part * step[: len(theta)], strengths + part * step[len(theta) :]
            moved = states + part * back
            tried = problem.try_predict(*new, moved)
            if tried is not None and cost(tried) < before:
                break
        else:
            break
        (theta, strengths), states, residual = new, moved, tried
        if before - cost(residual) < CONVERGED:
            break
    columns, local = problem.jacobian(theta, strengths, states, residual)
    linear = project(residual, columns, local).weighed(residual)
    samples_each = correlation_time(predictor, linear.residual)
    covariance, quantile = _covariance(linear, free, states.size, samples_each)
    return Fit(theta, strengths, states, residual, covariance, linear, quantile, samples_each)


def signatures(
    predictor: Predictor,
    base: BaseParameters,
    found: Fit,
    shapes: Sequence[Sequence[Array]],
    strengths: Array,
) -> Linear:
    """The prediction linearised at a fit, with columns of torques that it left out.

    `strengths` are those of `shapes` in the fit, 0 for the ones left out.
    """
    problem = _Problem(predictor, base, shapes)
    columns, local = problem.jacobian(found.theta, strengths, found.states, found.residual)
    return project(found.residual, columns, local).weighed(found.residual)


def project(residual: list[Array], columns: list[Array], local: list[Array]) -> Linear:
    """Take out of residual and columns what the initial states can explain."""
    orthogonal = [np.linalg.qr(own)[0] for own in local]
    return Linear(
        [r - q @ (q.T @ r) for r, q in zip(residual, orthogonal, strict=True)],
        [a - q @ (q.T @ a) for a, q in zip(columns, orthogonal, strict=True)],
    )


def cost(residual: list[Array]) -> float:
    """Twice the negative log-likelihood, each segment at its own best noise scale."""
    total = 0.0
    for r in residual:
        x = float(r @ r) / len(r)
        total += len(r) * (x if x <= 1.0 else 1.0 + float(np.log(x)))
    return total


def _weight(residual: Array) -> float:
    return 1.0 / max(float(residual @ residual) / len(residual), 1.0)


class _Problem:
    """Residuals and their derivatives as functions of the unknowns."""

    def __init__(
        self, predictor: Predictor, base: BaseParameters, shapes: Sequence[Sequence[Array]]
    ) -> None:
        self.predictor = predictor
        self.base = base
        count = len(predictor.segments)
        self.all = np.arange(count)
        empty = np.zeros((0, count, predictor.steps, predictor.base_width))
        self.shapes = np.array([list(shape) for shape in shapes]) if shapes else empty

    def predict(self, theta: Array, strengths: Array, states: Array) -> list[Array]:
        torque = np.tensordot(strengths, self.shapes, axes=1)
        model = self.base.model(theta)
        return self.predictor.predict(model, self.all, states, torque)

    def try_predict(self, theta: Array, strengths: Array, states: Array) -> list[Array] | None:
        """None where the parameters are no body's."""
        try:
            return self.predict(theta, strengths, states)
        except TwinError:
            return None

    def jacobian(
        self,
        theta: Array,
        strengths: Array,
        states: Array,
        residual: list[Array],
        free: NDArray[np.bool_] | None = None,
    ) -> tuple[list[Array], list[Array]]:
        """Of each segment: d residual / d(theta, strengths) and / d(its own initial state).

        Columns of a base that is not free are 0 where `free` is given: they cost the most.
        """
        segments, width = len(self.all), states.shape[1]
        torque = np.tensordot(strengths, self.shapes, axes=1)
        global_columns: list[list[Array]] = [[] for _ in self.all]
        for i, scale in enumerate(self.base.scale):
            if free is not None and not free[i]:
                for s in self.all:
                    global_columns[s].append(np.zeros(len(residual[s])))
                continue
            moved = theta.copy()
            moved[i] += STEP * scale
            run = self.predictor.predict(self.base.model(moved), self.all, states, torque)
            for s in self.all:
                global_columns[s].append((run[s] - residual[s]) / (STEP * scale))
        # strengths and initial states share the model: one batch for all of them
        pushes = [torque + STEP * shape for shape in self.shapes]
        shifts = [states + STEP * unit for unit in np.eye(width)]
        rows = np.tile(self.all, len(pushes) + width)
        change = np.concatenate([states] * len(pushes) + shifts)
        torques = np.concatenate(pushes + [torque] * width)
        runs = self.predictor.predict(self.base.model(theta), rows, change, torques)
        for place, s in enumerate(rows):
            if place // segments < len(pushes):
                global_columns[s].append((runs[place] - residual[s]) / STEP)
        first = len(pushes) * segments
        local = [
            np.stack(
                [(runs[first + k * segments + s] - residual[s]) / STEP for k in range(width)],
                axis=-1,
            )
            for s in self.all
        ]
        return [np.stack(columns, axis=-1) for columns in global_columns], local


def _step(
    residual: list[Array], columns: list[Array], local: list[Array], free: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """The step of the shared parameters and of each initial state: best of the linearised cost.

    The weights follow the step within the linearised problem, which costs no prediction; with
    weights held over a step the iteration would creep.
    """
    flat = project(residual, columns, local)
    step, ahead = np.zeros(len(free)), residual
    for _ in range(REWEIGHTINGS if free.any() else 0):
        linear = flat.weighed(ahead)
        previous = step.copy()
        step[free] = -_solve(linear.normal[np.ix_(free, free)], linear.gradient[free])
        ahead = flat.after(step)
        if np.allclose(step, previous, rtol=1e-3, atol=0.0):
            break
    back = [
        -np.linalg.lstsq(own, r + a @ step, rcond=None)[0]
        for own, r, a in zip(local, residual, columns, strict=True)
    ]
    return step, np.array(back, dtype=np.float64)


def _solve(normal: Array, right: Array) -> Array:
    """Solve scaled normal equations; what the data do not show stays where it is."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * np.outer(scale, scale)
    return scale * np.linalg.lstsq(scaled, scale * right, rcond=1e-10)[0]


def correlation_time(predictor: Predictor, residual: list[Array]) -> float:
    """Samples of a residual that say as much as one of white noise; 1 for white noise.

    1 + 2 sum of the autocorrelation up to its first zero, over all segments and columns.
    """
    sequences = [
        column
        for segment, flat in enumerate(residual)
        for output, (_, values) in zip(
            predictor.outputs, predictor.split(segment, flat).values(), strict=True
        )
        for column in (values / output.noise).T
    ]
    lags = max(min(map(len, sequences)) // 2, 1)
    products = np.zeros(lags)
    for column in sequences:
        for lag in range(lags):
            products[lag] += float(column[lag:] @ column[: len(column) - lag])
    correlation = products / max(products[0], 1e-300)
    below = np.flatnonzero(correlation <= 0.0)
    positive = correlation[1 : below[0] if below.size else lags]
    return 1.0 + 2.0 * float(positive.sum())


def _covariance(
    linear: Linear, free: NDArray[np.bool_], states: int, samples_each: float
) -> tuple[Array, float]:
    """Covariance of the free parameters, and the quantile that makes 95 % intervals of it.

    The inverse of the normal matrix, times what is left of chi-square and times `samples_each`,
    the samples that say as much as one of white noise. Where the segments are many, the scatter
    of their own gradients is a second opinion (sandwich estimate, segments as clusters, Student's
    t for their number); the wider of the two is kept.
    """
    full = np.zeros((len(free), len(free)))
    if not free.any():
        return full, NORMAL
    place = np.ix_(free, free)
    inverse = np.linalg.pinv(linear.normal[place], rcond=1e-14, hermitian=True)
    segments, parameters = len(linear.residual), int(free.sum())
    count = sum(map(len, linear.residual))
    chi2 = sum(float(r @ r) for r in linear.residual) / max(count - states - parameters, 1)
    full[place] = inverse * max(chi2, 1.0) * samples_each
    if segments < 4 * parameters or samples_each < 2.0:
        return full, NORMAL
    pairs = zip(linear.columns, linear.residual, strict=True)
    scores = np.stack([(a.T @ r)[free] for a, r in pairs])
    sandwich = inverse @ (scores.T @ scores) @ inverse * segments / (segments - parameters)
    wider = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(full[place]), 1.0))
    full[place] = full[place] * np.outer(wider, wider)
    return full, float(student.ppf(0.975, segments - parameters))
