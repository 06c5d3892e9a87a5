"""A fit as whitened rows, for least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """residual + columns u is white, variance 1, for changes u of base, biases and strengths."""

    residual: Array
    """(m,)."""
    columns: Array
    """(m, u)."""
    cluster: NDArray[np.intp]
    """(m,) which segment of which log each comes from; -1: what was known beforehand."""

    @property
    def covariance(self) -> Array:
        """(u, u) of all that has a column."""
        size = 1.0 / np.maximum(np.linalg.norm(self.columns, axis=0), 1e-300)
        triangle = np.asarray(np.linalg.qr(self.columns * size, mode="r"))
        inverse = np.linalg.pinv(triangle, rcond=1e-12)
        return inverse @ inverse.T * np.outer(size, size)
