"""What a gyro may get wrong, as the effects of these names say it (docs/design.md 4.4):

    shown(t) = (1 + e + s) R(phi)^T w(t - tau) + b

with e on the diagonal and s symmetric off it: axes that are not square to each other, which no
mounting explains.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fault:
    """Some of the numbers of a gyro's error."""

    name: str
    unit: str
    columns: tuple[str, ...]
    words: str


FAULTS = (
    Fault("gyro_bias", "rad/s", ("x", "y", "z"), "it shows too much by"),
    Fault("gyro_scale_factor", "1", ("x", "y", "z"), "it shows too much in proportion to the rate"),
    Fault(
        "gyro_misalignment", "rad", ("x", "y", "z"), "its axes are turned from the attitude's by"
    ),
    Fault("gyro_axes_not_square", "rad", ("xy", "xz", "yz"), "its axes are not square by"),
    Fault("clock_lag", "s", ("",), "it is late by"),
)
NAMES = tuple((fault, column) for fault in FAULTS for column in fault.columns)
"""Of every parameter, in order."""
PAIRS = ((0, 1), (0, 2), (1, 2))


def corrected(time: Array, shown: Array, theta: Array) -> tuple[Array, Array]:
    """Times and rates (m, 3) of the body, of a gyro with these errors (13,)."""
    bias, scale, turn, skew, lag = np.split(theta, [3, 6, 9, 12])
    gain = np.diag(1.0 + scale)
    for (i, j), value in zip(PAIRS, skew, strict=True):
        gain[i, j] = gain[j, i] = value
    body_from_gyro = rotation.matrix(rotation.from_rotation_vector(turn)) @ np.linalg.inv(gain)
    return time - lag[0], (shown - bias) @ body_from_gyro.T


def columns(rate: Array, acceleration: Array) -> Array:
    """(m, 3, 13) by how much more is shown a parameter, at body rates (m, 3)."""
    shown = np.zeros((len(rate), 3, len(NAMES)))
    shown[:, :, 0:3] = np.eye(3)
    x, y, z = rate.T
    zero = np.zeros_like(x)
    for axis in range(3):
        shown[:, axis, 3 + axis] = rate[:, axis]
    cross = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]  # w x phi
    shown[:, :, 6:9] = np.moveaxis(np.array(cross), 2, 0)
    for place, (i, j) in enumerate(PAIRS):
        shown[:, i, 9 + place] = rate[:, j]
        shown[:, j, 9 + place] = rate[:, i]
    shown[:, :, 12] = -acceleration
    return shown
