"""The base by prediction error: Gauss-Newton on the whitened innovations of all logs together.

Maximum likelihood under the model: measured joints and sensors with white noise, the states of the
machine exact. L. Ljung, System Identification, 2nd ed. (1999), chapter 7.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from twin.errors import TwinError
from twin.predict.innovations import Innovations, Problem, Unknowns

Array = NDArray[np.float64]

ITERATIONS = 12
HALVINGS = 6
CONVERGED = 0.02
"""Largest step, in standard deviations, at which the iteration ends."""
WORSE = 1.5
"""A step is halved when chi-square grows by more than this factor."""


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

    def covariance(self, is_noise: bool) -> tuple[Array, float]:
        """Covariance (p, p) of the base, and the quantile that makes 95 % intervals of it.

        Where the model leaves only noise, (A^T A)^-1. Where it leaves more, that is no measure: the
        segments' own gradients scatter by what the model lacks, and by how much they do is taken
        instead (sandwich estimate, segments as clusters) wherever it is wider.
        """
        now, p = self.innovations, len(self.at.theta)
        inverse = now.covariance
        if is_noise:
            return inverse[:p, :p], NORMAL
        _, cluster = np.unique(now.cluster, return_inverse=True)
        scores = np.zeros((int(cluster.max()) + 1, len(inverse)))
        np.add.at(scores, cluster, now.columns * now.residual[:, None])
        freedom = max(len(scores) - len(inverse), 1)
        sandwich = inverse @ (scores.T @ scores) @ inverse * len(scores) / freedom
        chi2 = max(now.chi2 / now.samples, 1.0)
        wider = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(inverse), chi2))
        scaled = inverse * np.outer(wider, wider)
        return scaled[:p, :p], float(student.ppf(0.975, freedom))


def fit(problem: Problem, start: Unknowns) -> Fit:
    """Fit the base, the biases and the states.

    Raises:
        TwinError: no rigid body has the base that the iteration starts from.
    """
    now = problem.innovations(start)
    for _ in range(ITERATIONS):
        step = now.step()
        size = float(np.max(np.abs(step) / np.sqrt(np.diag(now.covariance))))
        if size < CONVERGED:
            return Fit(now, converged=True)
        moved = _moved(problem, now, step)
        if moved is None:
            break
        now = moved
    return Fit(now, converged=False)


def _moved(problem: Problem, now: Innovations, step: Array) -> Innovations | None:
    """After the largest part of a step that does not make things worse; None without any."""
    for halving in range(HALVINGS):
        try:
            tried = problem.innovations(now.moved(0.5**halving * step))
        except TwinError:
            continue
        if tried.chi2 <= WORSE * max(now.chi2, float(now.samples)):
            return tried
    return None
