"""Euler angles of an attitude as they stand in a file, and back."""

import warnings

import numpy as np
from numpy.typing import NDArray

from twin import rotation

Array = NDArray[np.float64]


def angles_of(value: Array, sequence: str, *, world_to_body: bool) -> Array:
    """(n, 3) [rad] that stand in the file for attitudes (n, 4), which turn body to world."""
    from scipy.spatial.transform import Rotation

    turned = rotation.conjugate(value) if world_to_body else value
    with warnings.catch_warnings():
        # a gimbal lock: one of the angles is free there, and taken as 0
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(Rotation.from_quat(turned, scalar_first=True).as_euler(sequence))


def attitude_of(angles: Array, sequence: str, *, world_to_body: bool) -> Array:
    """(n, 4) body to world of angles (n, 3) [rad] as they stand in the file."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler(sequence, angles).as_quat(scalar_first=True)
    return rotation.continuous(rotation.conjugate(turned) if world_to_body else turned)
