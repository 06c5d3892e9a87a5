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
    return _held(lower)


def root_of_any(covariance: Array) -> Array:
    """(n, n) C with C C^T = covariance, which may have directions without any spread.

    Raises:
        TwinError: as `root`.
    """
    sizes, directions = np.linalg.eigh(_held(covariance))
    return directions * np.sqrt(np.maximum(sizes, 0.0))


def joined_root(*roots: Array) -> Array:
    """Lower triangle L (n, n), its diagonal positive, with L L^T = the sum of all C C^T, C (n, .).

    Numbers of very different size keep their digits, as they do not where squares are added up.

    Raises:
        TwinError: as `root`.
    """
    upper = np.asarray(np.linalg.qr(_held(np.concatenate(roots, axis=1)).T, mode="r"))
    return upper.T * np.where(np.diag(upper) < 0.0, -1.0, 1.0)


def _held(array: Array) -> Array:
    """As it is, if numbers hold it."""
    if not np.isfinite(array).all():
        raise TwinError(
            "the motion of a machine with such parameters cannot be followed: what is uncertain"
            " in it grows beyond all bounds; cut the log into shorter ones, or leave out the part"
            " in which the machine reaches a stop"
        )
    return array
