"""Misfits of a model's prediction of a log: the residual of each stream, and its correlation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm
from scipy.stats import t as student

from twin.comparison.symptoms import Symptom
from twin.identification.prediction_error import NORMAL, fit
from twin.noise.stream import resolution_of
from twin.predict.body import Exact
from twin.predict.independent_segments import (
    IndependentSegments,
    fit_independent_segments,
    independent_segments,
)
from twin.predict.innovations import Eliminated, Innovations, Problem, Unknowns
from twin.predict.response import Segment
from twin.predict.sensors import Output

Array = NDArray[np.float64]
LAGS = 20
"""Of the autocorrelations that a whiteness test takes together."""
FALSE_ALARM = 0.01
"""Chance of calling a true model wrong, over all its columns and by each kind of test."""
ROUNDED = 0.9
"""Share of a column's noise that its own steps make: what rounding leaves of a slow motion is no
white noise, and nothing is missing."""
QUIET = 0.8
"""Chi-square a sample below which noise was stated so large that intervals show it."""
BLOCKS = 20
"""Of time, that a log is cut into."""
ENOUGH = 4.0
"""Segments a parameter that make their scatter worth looking at."""
STANDS_OUT = 10.0
"""A stretch is disturbed when its residual is so many times the median stretch's."""


@dataclass(frozen=True)
class ColumnMisfit:
    """Of one column of one stream."""

    stream: str
    column: str
    samples: int
    chi2: float
    """Mean squared residual in units of the noise, over the degrees of freedom."""
    low: float
    high: float
    """A true model stays between these 95 times in 100, the noise known as well as it is."""
    sigmas: float
    """Of its logarithm from 0: of a ratio of two estimates that is normal far out, too."""
    correlation: Array
    """(LAGS,) autocorrelation at lags of 1, 2, ... samples."""
    whiteness: float
    """Chance that white noise is as correlated (Monti 1994); 1 of rounding."""
    block_time: Array
    """(b,) middle of each block [s]."""
    block_chi2: Array
    """(b,) mean squared residual there."""
    block_band: Array
    """(b, 2) where it stays 95 times in 100."""

    @property
    def correlation_band(self) -> float:
        """White noise stays within plus and minus this 95 times in 100, at each lag."""
        return float(norm.ppf(0.975) / np.sqrt(self.samples))


def misfits(problem: Problem, innovations: Innovations) -> tuple[ColumnMisfit, ...]:
    """Of a motion that follows the model exactly; the blocks are those of the first log that has
    the stream."""
    left = [
        body.cells.gather(rows)
        for body, rows in zip(problem.bodies, innovations.residuals_of_logs(), strict=True)
    ]
    return misfits_of(
        problem, left, innovations.columns.shape[1] + sum(s.width for s in innovations.at.starts)
    )


def misfits_of(
    problem: Problem, residuals: list[list[Array]], fitted: int
) -> tuple[ColumnMisfit, ...]:
    """Of residuals in units of the noise, log by log and output by output.

    Args:
        problem: the logs.
        left: (m, k) each.
        fitted: how many numbers were fitted to them.
    """
    total = sum(body.samples for body in problem.bodies)
    result: list[ColumnMisfit] = []
    of_stream: dict[str, tuple[Output, list[Array]]] = {}
    for body, parts in zip(problem.bodies, residuals, strict=True):
        for output, part in zip(body.outputs, parts, strict=True):
            of_stream.setdefault(output.stream, (output, []))[1].append(part)
    for output, parts in of_stream.values():
        if not output.scatters:
            continue
        values = np.concatenate(parts)
        for k, column in enumerate(output.columns):
            steps = resolution_of(output.value[:, k]) / np.sqrt(12.0)
            result.append(
                _misfit(
                    output.stream,
                    column,
                    output.time,
                    values[:, k],
                    values.shape[0] - fitted * values.shape[0] / total,
                    1.0 if output.stated else 1.0 / float(output.worth[k]) - 1.0,
                    rounded=steps > ROUNDED * output.noise[k],
                )
            )
    return tuple(result)


def is_noise(result: Sequence[ColumnMisfit]) -> bool:
    """Whether no column leaves more than noise, beyond the chance of a false alarm."""
    limit = float(norm.ppf(1.0 - FALSE_ALARM / max(len(result), 1)))
    return all(part.sigmas < limit for part in result)


def quiet(result: Sequence[ColumnMisfit]) -> list[ColumnMisfit]:
    """Columns that leave far less than their stated noise, which was stated too large."""
    limit = float(norm.isf(FALSE_ALARM / max(len(result), 1)))
    return [part for part in result if part.sigmas < -limit and part.chi2 < QUIET]


def coloured(result: Sequence[ColumnMisfit]) -> list[ColumnMisfit]:
    """Columns whose residual is not white, beyond the chance of a false alarm."""
    return [part for part in result if part.whiteness < FALSE_ALARM / len(result)]


def _misfit(
    stream: str,
    column: str,
    time: Array,
    values: Array,
    freedom: float,
    unsure: float,
    *,
    rounded: bool,
) -> ColumnMisfit:
    """Of one column.

    Args:
        stream: its name.
        column: its name.
        time: (n,) of the first log [s].
        values: (m,) of all logs, in units of the noise.
        freedom: degrees of freedom of them.
        unsure: variance of their mean square, in units of that of as many independent samples: 1
            where the noise is stated, less where it was estimated from the same samples.
        rounded: whether the noise is that of rounding.
    """
    count = len(values)
    freedom = max(freedom, 1.0)
    sigma = float(np.sqrt(2.0 * count * unsure)) / freedom
    mean = float(values @ values) / freedom
    half = float(norm.ppf(0.975)) * sigma
    correlation = autocorrelation(values)
    own = time[: len(values)]
    length = max(float(own[-1] - own[0]), 1e-9) / BLOCKS
    block = np.minimum((own - own[0]) / length, BLOCKS - 1).astype(np.intp)
    counts = np.bincount(block, minlength=BLOCKS).astype(np.float64)
    squares = np.bincount(block, np.square(values[: len(own)]), minlength=BLOCKS)
    counts = np.maximum(counts, 1.0)
    band = np.stack([chi2.ppf(p, counts) / counts for p in (0.025, 0.975)], axis=-1)
    return ColumnMisfit(
        stream,
        column,
        count,
        mean,
        1.0 - half,
        1.0 + half,
        float(np.log(max(mean, 1e-300))) / sigma,
        correlation,
        1.0 if rounded else whiteness(correlation, count),
        own[0] + length * (np.arange(BLOCKS) + 0.5),
        squares / counts,
        band,
    )


def autocorrelation(values: Array) -> Array:
    """(LAGS,) or fewer, at lags of 1, 2, ... samples."""
    power = max(float(values @ values), 1e-300)
    lags = min(LAGS, len(values) - 1)
    return np.array([float(values[lag:] @ values[:-lag]) / power for lag in range(1, lags + 1)])


def whiteness(correlation: Array, count: int) -> float:
    """Chance that white noise is as correlated at so many lags.

    The squares of its partial autocorrelations add up to a chi-square far out, too (A. C. Monti,
    Biometrika 81, 1994). Those of the autocorrelations themselves (Ljung and Box, Biometrika 65,
    1978) are far too often far out where samples are few.

    Args:
        correlation: (lags,) autocorrelation.
        count: of the samples that it comes from.
    """
    pairs = count - np.arange(1, len(correlation) + 1)
    portmanteau = count * (count + 2.0) * float(np.sum(np.square(_partial(correlation)) / pairs))
    return float(chi2.sf(portmanteau, len(correlation)))


def _partial(correlation: Array) -> Array:
    """(lags,) each autocorrelation less what those at shorter lags explain (Durbin's recursion)."""
    result, model, left = np.empty_like(correlation), correlation[:0], 1.0
    for lag, value in enumerate(correlation):
        result[lag] = (value - float(model @ correlation[:lag][::-1])) / left
        model = np.append(model - result[lag] * model[::-1], result[lag])
        left = max(left * (1.0 - float(result[lag]) ** 2), 1e-12)
    return result


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
    prediction: Innovations | IndependentSegments
    misfits: tuple[ColumnMisfit, ...]
    """Stream by stream and column by column."""
    follows: bool
    """Whether the motion follows the model exactly, to within the noise."""

    @property
    def at(self) -> Unknowns:
        """The unknowns."""
        return self.prediction.at

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
        return (
            self.prediction.chains
            if isinstance(self.prediction, Innovations)
            else self.prediction.links
        )

    @cached_property
    def left(self) -> list[list[Array]]:
        """Of each log and output (m, k): what is left, in units of the noise."""
        if isinstance(self.prediction, Innovations) and self.prediction.noise.any:
            rows = self.prediction.residuals_of_logs()
        else:
            rows = [
                exact.linear.residual
                + np.einsum(
                    "snx,sx->sn",
                    exact.linear.state,
                    link.states(np.zeros(exact.linear.shared.shape[-1])),
                )
                for exact, link in zip(self.prediction.exact, self.links, strict=True)
            ]
        pairs = zip(self.problem.bodies, rows, strict=True)
        return [body.cells.gather(own) for body, own in pairs]

    @cached_property
    def inflation(self) -> float:
        """What is left, in units of white noise: how much less it says of anything."""
        if self.follows:
            return 1.0
        excess = 1.0
        if isinstance(self.prediction, Innovations):
            excess = max(float(np.mean([part.chi2 for part in self.misfits])), 1.0)
        return excess * correlation_time(self.problem, self.left)

    def covariance(self) -> tuple[Array, float]:
        """Of theta, biases and strengths, and the quantile that makes 95 % intervals of it.

        The inverse of the normal matrix, times the samples that say as much as one of white noise.
        Where the segments are many, the scatter of their own gradients is a second opinion
        (sandwich estimate, segments as clusters, Student's t for their number); the wider of the
        two is kept.
        """
        if isinstance(self.prediction, Innovations):
            return self.prediction.covariance * self.inflation, NORMAL
        change, _, weights = self.prediction.best(np.arange(self.prediction.columns.shape[1]))
        normal = self.prediction.normal(weights)
        size = 1.0 / np.sqrt(np.diag(normal))
        inverse = np.linalg.pinv(normal * np.outer(size, size), hermitian=True)
        inverse = inverse * np.outer(size, size)
        full = inverse * self.inflation
        segments, unknowns = len(weights), len(inverse)
        if segments < ENOUGH * unknowns:
            return full, NORMAL
        scores = self.prediction.scores(weights, change)
        sandwich = inverse @ (scores.T @ scores) @ inverse * segments / (segments - unknowns)
        wider = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(full), 1.0))
        quantile = float(student.ppf(0.975, segments - unknowns))
        return full * np.outer(wider, wider), quantile

    def linearised(self, symptoms: Sequence[Symptom]) -> Stand:
        """With columns for further symptoms, after those that it has."""
        more = [p for symptom in symptoms for p in symptom.perturbations]
        exact = self.problem.with_perturbations(self.prediction.exact, more)
        if isinstance(self.prediction, Innovations):
            return White(self.problem.whiten(self.at, exact, self.prediction.noise))
        return independent_segments(self.problem, self.at, exact)


@dataclass(frozen=True)
class White:
    """Whitened innovations, asked as segments apart are."""

    prediction: Innovations

    @property
    def exact(self) -> tuple[Exact, ...]:
        """Of each log, its states in it."""
        return self.prediction.exact

    @property
    def columns(self) -> Array:
        """(m, unknowns)."""
        return self.prediction.columns

    @property
    def cluster(self) -> NDArray[np.intp]:
        """(m,) -1: a row of what was known beforehand."""
        return self.prediction.cluster

    def best(
        self, free: NDArray[np.intp], shift: Array | None = None
    ) -> tuple[Array, float, Array]:
        """The change of some unknowns that is best after a shift, and -2 log L there."""
        now = self.prediction
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
    result = misfits(problem, exact.innovations)
    return Account(problem, chosen, exact.innovations, result, follows=is_noise(result))


def loosen(problem: Problem, chosen: tuple[Symptom, ...], start: Unknowns) -> Account:
    """Fit segments apart."""
    segments = fit_independent_segments(problem, start)
    bare = Account(problem, chosen, segments, (), follows=False)
    return replace(bare, misfits=misfits_of(problem, bare.left, segments.columns.shape[1]))


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
    alone = sum(float(np.sum(np.square(item.linear.shared[..., place]))) for item in stand.exact)
    return float(np.sum(np.square(stand.columns[own, column]))) / max(alone, 1e-300)


def correlation_time(problem: Problem, residuals: list[list[Array]]) -> float:
    """Samples of a residual that say as much as one of white noise; 1 for white noise.

    1 + 2 sum of the autocorrelation up to its first zero, over all columns within segments.
    """
    products = np.zeros(1)
    for body, parts in zip(problem.bodies, residuals, strict=True):
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


@dataclass(frozen=True)
class StreamError:
    """What a model misses of one stream, in its SI unit."""

    stream: str
    unit: str
    noise: float
    """1 sigma a sample, over the columns."""
    noise_stated: bool
    """By the log; else estimated from its data."""
    rms: float
    typical: float
    """The rms of the median segment: what is missed where nothing special happens."""
    worst: float
    worst_time: float
    """[s]."""
    chi2_per_sample: float


def stream_errors(account: Account) -> list[StreamError]:
    """What an account misses, stream by stream."""
    body = account.problem.bodies[0]
    errors: list[StreamError] = []
    for output, left in zip(body.outputs, account.left[0], strict=True):
        values = left * output.sigma
        size = np.linalg.norm(values, axis=1)
        worst = int(np.argmax(size))
        counts = np.bincount(output.segment, minlength=body.grid.segments)
        squares = np.bincount(
            output.segment, np.mean(np.square(values), axis=1), minlength=body.grid.segments
        )
        inside = counts > 0
        errors.append(
            StreamError(
                output.stream,
                output.unit,
                float(np.sqrt(np.mean(np.square(output.noise)))),
                output.stated,
                float(np.sqrt(np.mean(np.square(values)))),
                float(np.median(np.sqrt(squares[inside] / counts[inside]))),
                float(size[worst]),
                float(output.time[worst]),
                float(np.mean(np.square(left))),
            )
        )
    return errors


def disturbed(account: Account) -> list[Segment]:
    """Stretches whose residual stands out: something acted that no symptom knows."""
    body = account.problem.bodies[0]
    grid = body.grid
    squares, counts = np.zeros((2, grid.segments))
    for output, left in zip(body.outputs, account.left[0], strict=True):
        squares += np.bincount(
            output.segment, np.sum(np.square(left), axis=1), minlength=grid.segments
        )
        counts += left.shape[1] * np.bincount(output.segment, minlength=grid.segments)
    sizes = squares / np.maximum(counts, 1.0)
    limit = STANDS_OUT**2 * max(float(np.median(sizes)), 1.0)
    return [
        Segment(float(start), float(start) + grid.length)
        for start, size in zip(grid.starts, sizes, strict=True)
        if size > limit
    ]
