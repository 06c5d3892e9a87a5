"""How sure a fit is of its parameters when its residual is not white noise."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from twin.predict.linear import Linear
from twin.predict.rollout import Predictor

Array = NDArray[np.float64]

NORMAL = 1.96
"""95 % of a normal distribution lie within this many standard deviations."""


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


def covariance_of(
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
