"""Inertias as papers print them: the tensor of six entries, and whether any body has it."""

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.predict.base import ENTRIES

Array = NDArray[np.float64]


def tensor(entries: Array) -> Array:
    """(3, 3) of xx yy zz xy xz yz."""
    result = np.empty((3, 3))
    for value, (i, j) in zip(entries, ENTRIES, strict=True):
        result[i, j] = result[j, i] = value
    return result


def entries_of(platform: Platform) -> Array:
    """(9,) J and m r as a platform states them, as `ENTRIES` names them."""
    entries = [platform.inertia[i, j] for i, j in ENTRIES]
    return np.concatenate([entries, platform.center_of_mass_offset])


def is_rigid_body(inertia: Array) -> bool:
    """Whether its principal moments are positive and none exceeds the sum of the others."""
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] > 0.0 and moments[2] <= moments[0] + moments[1])
