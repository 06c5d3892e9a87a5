"""The torque that nobody accounts for, smoothed from what the fitted base leaves."""

import numpy as np
from numpy.typing import NDArray

from twin.compare.comparison import Comparison
from twin.identify.prediction_error import most_likely
from twin.predict.whitening.innovations import Problem
from twin.predict.whitening.unexplained import Unexplained, unexplained_torque

Array = NDArray[np.float64]


def missing_torque(comparison: Comparison, mean: float) -> Unexplained:
    """A white torque of the likeliest intensity, smoothed beside the best base without its laws.

    Args:
        comparison: whose best model's base is taken.
        mean: over which the torque is averaged [s]; what chatters faster is no matter of a law.
    """
    side = comparison.best if comparison.best.strengths else comparison.as_built
    account = side.explained
    problem = Problem([comparison.body], comparison.base, held=True)
    at = problem.start(account.theta, account.at.biases)
    found = unexplained_torque(problem, most_likely(problem, problem.innovations(at)), 0)
    count = max(round(mean / float(found.time[1] - found.time[0])), 1)
    whole = len(found.time) // count * count

    def averaged(values: Array) -> Array:
        return values[:whole].reshape(-1, count, *values.shape[1:]).mean(axis=1)

    return Unexplained(averaged(found.time), averaged(found.rate), averaged(found.torque))
