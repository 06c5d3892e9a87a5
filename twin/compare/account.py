"""One way to set a model's parameters on a log, and what it then misses.

A motion that follows the model exactly, where that leaves no more than noise; else segments
predicted apart, each with a noise of its own (`twin.predict.whitening.apart`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from twin.compare.misfit import Misfit, is_noise, misfits, misfits_of
from twin.compare.symptoms import Symptom
from twin.identify.prediction_error import NORMAL, fit
from twin.predict.body import Exact
from twin.predict.whitening.apart import Apart, apart, fit_apart
from twin.predict.whitening.innovations import Innovations, Problem
from twin.predict.whitening.unknowns import Eliminated, Unknowns

Array = NDArray[np.float64]

ENOUGH = 4.0
"""Segments a parameter that make their scatter worth looking at."""


class Stand(Protocol):
    """A linearised problem of which some unknowns are free."""

    @property
    def exact(self) -> tuple[Exact, ...]:
        """Of each log, its states in it."""
        ...

    @property
    def columns(self) -> Array:
        """(m, unknowns)."""
        ...

    @property
    def cluster(self) -> NDArray[np.intp]:
        """(m,) -1: a row of what was known beforehand."""
        ...

    def best(
        self, free: NDArray[np.intp], shift: Array | None = None
    ) -> tuple[Array, float, Array]:
        """The change of all unknowns that is best after a shift, -2 log L there, and weights."""
        ...


@dataclass(frozen=True)
class Account:
    """A fit of one log with some symptoms in the model."""

    problem: Problem
    chosen: tuple[Symptom, ...]
    """Fitted, in the order of the strengths."""
    now: Innovations | Apart
    misfits: tuple[Misfit, ...]
    """Stream by stream and column by column."""
    follows: bool
    """Whether the motion follows the model exactly, to within the noise."""

    @property
    def at(self) -> Unknowns:
        """The unknowns."""
        return self.now.at

    @property
    def theta(self) -> Array:
        """(p,) base."""
        return self.at.theta

    @property
    def strengths(self) -> Array:
        """(a,) of the symptoms' perturbations."""
        return self.at.strengths

    @property
    def links(self) -> tuple[Eliminated, ...]:
        """The logs, their states gone."""
        return self.now.chains if isinstance(self.now, Innovations) else self.now.links

    @cached_property
    def left(self) -> list[list[Array]]:
        """Of each log and output (m, k): what is left, in units of the noise."""
        if isinstance(self.now, Innovations) and self.now.noise.any:
            rows = self.now.left()
        else:
            rows = [
                exact.linear.residual
                + np.einsum(
                    "snx,sx->sn",
                    exact.linear.state,
                    link.states(np.zeros(exact.linear.shared.shape[-1])),
                )
                for exact, link in zip(self.now.exact, self.links, strict=True)
            ]
        pairs = zip(self.problem.bodies, rows, strict=True)
        return [body.cells.gather(own) for body, own in pairs]

    @cached_property
    def inflation(self) -> float:
        """What is left, in units of white noise: how much less it says of anything."""
        if self.follows:
            return 1.0
        excess = 1.0
        if isinstance(self.now, Innovations):
            excess = max(float(np.mean([part.chi2 for part in self.misfits])), 1.0)
        return excess * correlation_time(self.problem, self.left)

    def covariance(self) -> tuple[Array, float]:
        """Of theta, biases and strengths, and the quantile that makes 95 % intervals of it.

        The inverse of the normal matrix, times the samples that say as much as one of white noise.
        Where the segments are many, the scatter of their own gradients is a second opinion
        (sandwich estimate, segments as clusters, Student's t for their number); the wider of the
        two is kept.
        """
        if isinstance(self.now, Innovations):
            return self.now.covariance * self.inflation, NORMAL
        change, _, weights = self.now.best(np.arange(self.now.columns.shape[1]))
        normal = self.now.normal(weights)
        size = 1.0 / np.sqrt(np.diag(normal))
        inverse = np.linalg.pinv(normal * np.outer(size, size), hermitian=True)
        inverse = inverse * np.outer(size, size)
        full = inverse * self.inflation
        segments, unknowns = len(weights), len(inverse)
        if segments < ENOUGH * unknowns:
            return full, NORMAL
        scores = self.now.scores(weights, change)
        sandwich = inverse @ (scores.T @ scores) @ inverse * segments / (segments - unknowns)
        wider = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(full), 1.0))
        quantile = float(student.ppf(0.975, segments - unknowns))
        return full * np.outer(wider, wider), quantile

    def linearised(self, symptoms: Sequence[Symptom]) -> Stand:
        """With columns for further symptoms, after those that it has."""
        more = [p for symptom in symptoms for p in symptom.perturbations]
        exact = self.problem.with_perturbations(self.now.exact, more)
        if isinstance(self.now, Innovations):
            return White(self.problem.whiten(self.at, exact, self.now.noise))
        return apart(self.problem, self.at, exact)


@dataclass(frozen=True)
class White:
    """Whitened innovations, asked as segments apart are."""

    now: Innovations

    @property
    def exact(self) -> tuple[Exact, ...]:
        """Of each log, its states in it."""
        return self.now.exact

    @property
    def columns(self) -> Array:
        """(m, unknowns)."""
        return self.now.columns

    @property
    def cluster(self) -> NDArray[np.intp]:
        """(m,) -1: a row of what was known beforehand."""
        return self.now.cluster

    def best(
        self, free: NDArray[np.intp], shift: Array | None = None
    ) -> tuple[Array, float, Array]:
        """The change of some unknowns that is best after a shift, and -2 log L there."""
        now = self.now
        residual = now.residual if shift is None else now.residual + now.columns @ shift
        size = 1.0 / np.maximum(np.linalg.norm(now.columns[:, free], axis=0), 1e-300)
        step = np.zeros(now.columns.shape[1])
        solved = np.linalg.lstsq(now.columns[:, free] * size, -residual, rcond=1e-10)[0]
        step[free] = solved * size
        left = residual + now.columns @ step
        return step, float(left @ left) + now.logarithm, np.ones(0)


def follow(problem: Problem, chosen: tuple[Symptom, ...], start: Unknowns) -> Account | None:
    """Fit a motion that follows the model exactly; None where that does not settle."""
    exact = fit(problem, start)
    if not exact.converged:
        return None
    found = misfits(problem, exact.innovations)
    return Account(problem, chosen, exact.innovations, found, follows=is_noise(found))


def loosen(problem: Problem, chosen: tuple[Symptom, ...], start: Unknowns) -> Account:
    """Fit segments apart."""
    now = fit_apart(problem, start)
    bare = Account(problem, chosen, now, (), follows=False)
    return replace(bare, misfits=misfits_of(problem, bare.left, now.columns.shape[1]))


def imitated(stand: Stand | Innovations, effect: Array, base: int) -> float:
    """Share of an effect (m,) on the logs that a change of the first `base` unknowns could take."""
    own = stand.cluster >= 0
    columns = stand.columns[own, :base]
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    mix = np.linalg.lstsq(columns, effect[own], rcond=1e-10)[0]
    taken = columns @ mix
    return float(taken @ taken / max(float(effect[own] @ effect[own]), 1e-300))


def shown(stand: Stand, column: int) -> float:
    """Share of an effect on the logs that no other states of the motion could take."""
    own = stand.cluster >= 0
    place = column - stand.columns.shape[1]
    alone = sum(float(np.sum(np.square(one.linear.shared[..., place]))) for one in stand.exact)
    return float(np.sum(np.square(stand.columns[own, column]))) / max(alone, 1e-300)


def correlation_time(problem: Problem, left: list[list[Array]]) -> float:
    """Samples of a residual that say as much as one of white noise; 1 for white noise.

    1 + 2 sum of the autocorrelation up to its first zero, over all columns within segments.
    """
    products = np.zeros(1)
    for body, parts in zip(problem.bodies, left, strict=True):
        for output, values in zip(body.outputs, parts, strict=True):
            for s in range(body.grid.segments):
                inside = values[output.segment == s]
                # a gap may leave a stream without any in a segment
                for column in inside.T if len(inside) else ():
                    own = _products(column)
                    longest = np.zeros(max(len(own), len(products)))
                    longest[: len(products)] += products
                    longest[: len(own)] += own
                    products = longest
    correlation = products / max(products[0], 1e-300)
    below = np.flatnonzero(correlation <= 0.0)
    positive = correlation[1 : below[0] if below.size else len(correlation)]
    return 1.0 + 2.0 * float(positive.sum())


def _products(column: Array) -> Array:
    """Sums of a column's products with itself, lag by lag, up to half its length."""
    count = len(column)
    spectrum = np.fft.rfft(column, 2 * count)
    return np.fft.irfft(np.abs(spectrum) ** 2)[: max(count // 2, 1)]
