"""Covariances of predicted readings, taken apart."""

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError

Array = NDArray[np.float64]


def root(covariance: Array) -> Array:
    """Lower triangles L (..., n, n) with L L^T = covariance, of white noise and what is added.

    Raises:
        TwinError: a motion so unstable that its spread exceeds what numbers hold.
    """
    try:
        lower = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        lower = np.full_like(covariance, np.nan)
    if not np.isfinite(lower).all():
        raise TwinError(
            "the motion of a machine with such parameters cannot be followed: what is uncertain"
            " in it grows beyond all bounds; cut the log into shorter ones, or leave out the part"
            " in which the machine reaches a stop"
        )
    return lower
