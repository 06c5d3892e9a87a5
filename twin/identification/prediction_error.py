"""The base by prediction error: Gauss-Newton on the whitened innovations of all logs together.

Maximum likelihood under the model: sensors with white noise, and a motion that follows the
machine's equations exactly; where that leaves more than noise, under a white torque besides.
L. Ljung, System Identification, 2nd ed. (1999), chapter 7.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import norm
from scipy.stats import t as student

from twin.errors import TwinError
from twin.predict.innovations import Innovations, Problem, Unknowns
from twin.predict.kalman import EXACT, NoiseProcess
from twin.stop import check
from twin.units import span

_LOGGER = logging.getLogger(__name__)

Array = NDArray[np.float64]

ITERATIONS = 12
HALVINGS = 6
CONVERGED = 0.02
"""Largest step, in standard deviations, at which the iteration ends."""
SETTLED = 0.5
"""Likewise once steps shrink no more. Under a disturbance that will do: where a model misses by far
they do not become as small, and the intervals are wide."""
SHRINKING = 0.9
"""Ratio of a step to the smallest so far at which the iteration is still under way."""
ENOUGH = 2.0
"""Segments a parameter that make their scatter worth looking at."""
DECADES = (-14.0, 2.0)
"""Powers of ten between which the intensity is sought, per squared scale of the base: the random
walk of the rate [rad^2/s^3]."""
NEAR = 2.0
"""How far from its first value, in decades, the intensity is sought again."""
ROUGH, SHARP = 0.5, 0.05
"""Tolerance of its logarithm in decades, where it may be zero and where it matters."""
WORTHWHILE = 10.0
"""By how much a disturbance must lower twice the negative log-likelihood to be believed: by chance
it does so once in a thousand logs."""
CLOSE = 1.0
"""Tolerance in decades of the smallest intensity that matters."""
HARDLY = 0.1
"""Part of what is worthwhile that a tenth of a worthwhile torque gains in any case; a tenth of that
is nothing."""
WORSE = 1.5
"""A step is halved when chi-square grows by more than this factor; that of a disturbed motion, when
the logs become less likely."""


NORMAL = float(norm.ppf(0.975))
"""95 % of a normal distribution lie within this many standard deviations."""


@dataclass(frozen=True)
class Fit:
    """The unknowns that predict the logs best."""

    innovations: Innovations
    """Linearised there."""
    converged: bool

    @property
    def at(self) -> Unknowns:
        """The unknowns."""
        return self.innovations.at

    def covariance(self) -> tuple[Array, float]:
        """Covariance (p, p) of the base, and the quantile that makes 95 % intervals of it."""
        everything, quantile = self.spread()
        p = len(self.at.theta)
        return everything[:p, :p], quantile

    def spread(self) -> tuple[Array, float]:
        """Covariance of base, biases and strengths, in this order; and the same quantile.

        (A^T A)^-1. Where a disturbance had to be fitted, it is not as white as it was taken to be:
        there the scatter of the segments' own gradients is a second opinion (sandwich estimate,
        segments as clusters), and the wider of the two is kept, if there are segments enough.
        """
        current = self.innovations
        inverse = current.covariance
        _, cluster = np.unique(current.cluster, return_inverse=True)
        clusters = int(cluster.max()) + 1
        if not current.noise.any or clusters < ENOUGH * len(inverse):
            return inverse, NORMAL
        scores = np.zeros((clusters, len(inverse)))
        np.add.at(scores, cluster, current.columns * current.residual[:, None])
        freedom = clusters - len(inverse)
        sandwich = inverse @ (scores.T @ scores) @ inverse * clusters / freedom
        wider = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(inverse), 1.0))
        scaled = inverse * np.outer(wider, wider)
        return scaled, float(student.ppf(0.975, freedom))


def fit(problem: Problem, start: Unknowns, noise: NoiseProcess = EXACT) -> Fit:
    """Fit the base, the biases and the states of a motion that follows the model.

    Args:
        problem: the logs.
        start: where the iteration starts.
        noise: what disturbs the motion and the sensors, beside their white noise.

    Raises:
        TwinError: no rigid body has the base that the iteration starts from.
    """

    def innovations(at: Unknowns) -> Innovations:
        return problem.innovations(at, noise)

    return _iterate(problem, innovations(start), innovations)


def fit_disturbed(problem: Problem, exact: Fit, start: Unknowns) -> Fit:
    """Likewise, of a motion that a white torque disturbs; its intensity is fitted too.

    That torque stands for whatever the model lacks: the states may leave the model's path, and what
    the path says of the base counts for less.

    Args:
        problem: the logs.
        exact: their fit without that torque; returned as it is if the torque explains nothing.
        start: where to begin if that fit has not converged.
    """
    current = exact.innovations if exact.converged else problem.innovations(start)
    if exact.converged and not _strays(problem, current):
        return exact
    roughly = likeliest_noise(problem, current, DECADES, ROUGH)
    if exact.converged and roughly.cost > current.cost - 0.5 * WORTHWHILE:
        return exact
    size = float(np.max(problem.base.scale)) ** 2
    decade = float(np.log10(roughly.intensity / size))
    near = (max(decade - NEAR, DECADES[0]), min(decade + NEAR, DECADES[1]))
    first = likeliest_noise(problem, current, near)
    if exact.converged and first.cost > current.cost - WORTHWHILE:
        return exact

    def innovations(at: Unknowns) -> Innovations:
        return likeliest_noise(problem, problem.innovations(at), near)

    # Freed of the model's path, the states go to their best first: linearised before that, the logs
    # look likelier than any step makes them.
    freed = innovations(first.moved(np.zeros(first.columns.shape[1])))
    return _iterate(problem, freed, innovations)


def _iterate(
    problem: Problem,
    current: Innovations,
    innovations: Callable[[Unknowns], Innovations],
) -> Fit:
    """Gauss-Newton; the slope of the log-determinant joins where that has converged.

    Steps that overshoot, where the columns miss how the path bends, are shortened by the secant.
    Where a late clock moves a sample from one step of the grid to the next, the slope jumps, and
    steps go to and fro between two places: of those the likelier is kept, and is not converged.
    """
    if not current.columns.shape[1]:
        return _along_itself(current, innovations)
    if not current.determined:
        return Fit(current, converged=False)
    tilted, freed = False, False
    size = _size(current)
    best, idle, smallest, before = current, 0, np.inf, None
    began, first = time.monotonic(), size
    for number in range(ITERATIONS):
        check()
        _log(number, time.monotonic() - began, first, size)
        if (size < CONVERGED and not tilted) or (tilted and size > SETTLED):
            # far from where it was taken that slope is another one
            current, tilted, before = problem.tilted(current), True, None
            size, idle, smallest = _size(current), 0, np.inf
        if size < CONVERGED:
            return Fit(current, converged=True)
        step = current.step()
        share = 1.0 if before is None else _share(current, step, *before)
        moved = _moved(current, share * step, innovations)
        if moved is None and current.tilt.any():  # as likely as it becomes
            return Fit(current, converged=True)
        if moved is None and not freed:
            # columns mislead along states that are far from their best: those go there first
            moved, freed = _moved(current, 0.0 * step, innovations), True
            step = None
        if moved is None:
            break
        if not moved[0].determined:  # a clock that is off by more than the log lasts
            break
        current, taken = moved
        before = None if step is None else (step, share * taken)
        likelier = current.chi2 + current.logarithm < best.chi2 + best.logarithm
        best = current if likelier else best
        size = _size(current)
        idle = 0 if size < SHRINKING * smallest else idle + 1
        smallest = min(size, smallest)
        if idle > 3 and not current.noise.any and size < SETTLED:
            current = best
            break
    return Fit(current, converged=current.noise.any and size < SETTLED)


def _log(number: int, seconds: float, first: float, size: float) -> None:
    """Log a step's number and the time that remains, extrapolated from how steps have shrunk.

    Args:
        number: of steps that were taken.
        seconds: that they took.
        first: size of the first step, in standard deviations.
        size: of the next one; near the optimum steps shrink faster than extrapolated.
    """
    remaining = ""
    if number > 1 and CONVERGED < size < first:
        steps = number * np.log(size / CONVERGED) / np.log(first / size)
        remaining = f", about {span(seconds / number * min(steps, ITERATIONS - number))} of it left"
    _LOGGER.info("step %d%s", number + 1, remaining)


def _size(innovations: Innovations) -> float:
    """Of the next step, in standard deviations."""
    return float(np.max(np.abs(innovations.step()) / np.sqrt(np.diag(innovations.covariance))))


def _along_itself(current: Innovations, innovations: Callable[[Unknowns], Innovations]) -> Fit:
    """Of a machine that is known whole: only the states of the motion are fitted."""
    for _ in range(ITERATIONS):
        moved = innovations(current.moved(np.zeros(0)))
        fallen = current.chi2 + current.logarithm - moved.chi2 - moved.logarithm
        current = moved
        if abs(fallen) < CONVERGED:
            return Fit(current, converged=True)
    return Fit(current, converged=False)


def _share(innovations: Innovations, step: Array, before: Array, taken: float) -> float:
    """Of a step, where the last ones overshot: the secant through it and the one before, of which
    so much was taken, ends there."""
    step_change, last = innovations.columns @ step, innovations.columns @ before
    curvature = (1.0 - float(step_change @ last) / float(last @ last)) / taken
    return 1.0 / max(curvature, 1.0)


def _moved(
    current: Innovations, step: Array, innovations: Callable[[Unknowns], Innovations]
) -> tuple[Innovations, float] | None:
    """After the largest part of a step that does not make things worse, and that part; None
    without any."""
    for halving in range(HALVINGS if step.any() else 1):
        try:
            tried = replace(innovations(current.moved(0.5**halving * step)), tilt=current.tilt)
        except TwinError:
            continue
        before, after = current.chi2 + current.logarithm, tried.chi2 + tried.logarithm
        # Paths that follow the model exactly may part from the logs first; disturbed ones need not,
        # nor those that are there already.
        settled = current.noise.any or bool(current.tilt.any())
        room = 0.0 if settled else (WORSE - 1.0) * max(current.chi2, float(current.samples))
        if after <= before + room:
            return tried, 0.5**halving
    return None


def likeliest_noise(
    problem: Problem,
    exact: Innovations,
    decades: tuple[float, float] = DECADES,
    within: float = SHARP,
) -> Innovations:
    """With the intensity of the torque at which the logs are most likely.

    Whatever the base and the biases are: what these take of the noise would pass for a torque that
    is not there (restricted likelihood; H. D. Patterson and R. Thompson, Biometrika 58, 1971).

    Args:
        problem: the logs.
        exact: their prediction, as if nothing disturbed it.
        decades: between which it is sought, per squared scale of the base.
        within: how many decades it may be off.
    """
    best = minimize_scalar(
        lambda decade: restricted(_under(problem, exact, float(decade))),
        bounds=decades,
        method="bounded",
        options={"xatol": within},
    )
    return _under(problem, exact, float(best.x))


def _strays(problem: Problem, exact: Innovations) -> bool:
    """Whether a torque of any intensity may be worthwhile in logs that were predicted without one.

    A tenth of what is there gains a fifth as much; far more does harm, and far less nothing.
    Between these two it is looked for by halves.
    """
    none, (low, high) = restricted(exact), DECADES
    threshold = HARDLY * WORTHWHILE
    while high - low > CLOSE:
        middle = 0.5 * (low + high)
        worse = restricted(_under(problem, exact, middle)) - none
        if worse < -threshold:
            return True
        low, high = (middle, high) if worse < HARDLY * threshold else (low, middle)
    return False


def _under(problem: Problem, exact: Innovations, decade: float) -> Innovations:
    """Under a torque of that intensity, per squared scale of the base."""
    size = float(np.max(problem.base.scale)) ** 2
    return problem.whiten(exact.at, exact.exact, NoiseProcess(size * 10.0**decade))


def restricted(innovations: Innovations) -> float:
    """-2 log of the restricted likelihood, up to a constant."""
    size = np.linalg.norm(innovations.columns, axis=0)
    triangle = np.linalg.qr(innovations.columns / size, mode="r")
    return innovations.cost + 2.0 * float(np.log(np.abs(np.diag(triangle)) * size).sum())
