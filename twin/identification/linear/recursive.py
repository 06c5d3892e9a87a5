"""Recursive least squares with forgetting, over the integrated balance.

K = P A^T (lambda I + A P A^T)^-1,  x += K (B - A x),  P = (P - K A P) / lambda

from where platform.toml states the base, three rows at a time. Source: G. Sharifi, M. Mirshams,
H. Shahmohamadi Ousaloo, Mass properties identification and automatic mass balancing system, 2019,
eq. 9 to 11; their lambda is 0.95 or 0.99 a step of 0.2 s.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.identification.linear.equations import integrated
from twin.identification.linear.least_squares import Estimate, based
from twin.identification.prediction_error import NORMAL
from twin.identification.track import Track
from twin.predict.base import BaseParameters

Array = NDArray[np.float64]

STEP = 0.2
"""Between updates [s]."""
DOUBT = 1e3
"""Of what is stated, in parts of a parameter's scale."""


def recursive(tracks: Sequence[Track], base: BaseParameters, forgetting: float) -> Estimate:
    """One log after the other.

    Args:
        tracks: of the logs.
        base: the parameters sought.
        forgetting: lambda, the weight that a step of 0.2 s leaves to what came before it.
    """
    theta, p = base.as_stated.copy(), np.diag(np.square(DOUBT * base.scale))
    squares, weight = 0.0, 0.0
    for track in tracks:
        stride = max(round(STEP / track.step), 1)
        equations = integrated(track).about(track.axis).every(stride)
        rows, target = based(equations, base)
        k = equations.target.shape[1]
        pairs = zip(rows.reshape(-1, k, len(theta)), target.reshape(-1, k), strict=True)
        for a, b in pairs:
            across = p @ a.T
            gain = np.linalg.solve(forgetting * np.eye(k) + a @ across, across.T).T
            theta = theta + gain @ (b - a @ theta)
            p = (p - gain @ across.T) / forgetting
            p = 0.5 * (p + p.T)
            left = b - a @ theta
            squares = forgetting * squares + float(left @ left)
            weight = forgetting * weight + k
    return Estimate(theta, p * squares / max(weight, 1.0), NORMAL)
