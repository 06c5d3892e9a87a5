"""How far a fit leaves more than noise: by stream, by axis, over time; and whether it is white.

Each number stands beside the band that a true model keeps 95 times in 100.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from twin.noise.quantisation import resolution_of
from twin.predict.sensors.outputs import Output
from twin.predict.whitening.innovations import Innovations, Problem

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


@dataclass(frozen=True)
class Misfit:
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


def misfits(problem: Problem, now: Innovations) -> tuple[Misfit, ...]:
    """Of a motion that follows the model exactly; the blocks are those of the first log that has
    the stream."""
    left = [body.cells.gather(rows) for body, rows in zip(problem.bodies, now.left(), strict=True)]
    return misfits_of(problem, left, now.columns.shape[1] + sum(s.width for s in now.at.starts))


def misfits_of(problem: Problem, left: list[list[Array]], fitted: int) -> tuple[Misfit, ...]:
    """Of residuals in units of the noise, log by log and output by output.

    Args:
        problem: the logs.
        left: (m, k) each.
        fitted: how many numbers were fitted to them.
    """
    total = sum(body.samples for body in problem.bodies)
    found: list[Misfit] = []
    of_stream: dict[str, tuple[Output, list[Array]]] = {}
    for body, parts in zip(problem.bodies, left, strict=True):
        for output, part in zip(body.outputs, parts, strict=True):
            of_stream.setdefault(output.stream, (output, []))[1].append(part)
    for output, parts in of_stream.values():
        if not output.scatters:
            continue
        values = np.concatenate(parts)
        for k, column in enumerate(output.columns):
            steps = resolution_of(output.value[:, k]) / np.sqrt(12.0)
            found.append(
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
    return tuple(found)


def is_noise(found: Sequence[Misfit]) -> bool:
    """Whether no column leaves more than noise, beyond the chance of a false alarm."""
    limit = float(norm.ppf(1.0 - FALSE_ALARM / max(len(found), 1)))
    return all(part.sigmas < limit for part in found)


def quiet(found: Sequence[Misfit]) -> list[Misfit]:
    """Columns that leave far less than their stated noise, which was stated too large."""
    limit = float(norm.isf(FALSE_ALARM / max(len(found), 1)))
    return [part for part in found if part.sigmas < -limit and part.chi2 < QUIET]


def coloured(found: Sequence[Misfit]) -> list[Misfit]:
    """Columns whose residual is not white, beyond the chance of a false alarm."""
    return [part for part in found if part.whiteness < FALSE_ALARM / len(found)]


def _misfit(
    stream: str,
    column: str,
    time: Array,
    values: Array,
    freedom: float,
    unsure: float,
    *,
    rounded: bool,
) -> Misfit:
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
    return Misfit(
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
    found, model, left = np.empty_like(correlation), correlation[:0], 1.0
    for lag, value in enumerate(correlation):
        found[lag] = (value - float(model @ correlation[:lag][::-1])) / left
        model = np.append(model - found[lag] * model[::-1], found[lag])
        left = max(left * (1.0 - float(found[lag]) ** 2), 1e-12)
    return found
