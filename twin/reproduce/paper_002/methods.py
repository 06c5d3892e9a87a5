"""The paper's methods on a log, and their errors as its tables print them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.identification import Settings, identify
from twin.platform import Platform
from twin.recording import Recording
from twin.reproduce.inertia import entries_of

Array = NDArray[np.float64]

METHODS: Mapping[str, tuple[str, Settings]] = {
    "torque": ("torque", Settings()),
    "momentum_1": ("momentum", Settings(shift=1)),
    "momentum_2": ("momentum", Settings(shift=2)),
    "momentum_3": ("momentum", Settings(shift=3)),
}
"""Columns of Tables 2 and 3: TM, MI(1), MI(2), MI(3), all integrated."""


def errors(log: Recording, platform: Platform, method: str) -> Array:
    """(9,) errors of a method of the paper [%]; J xx yy zz xy xz yz, then m r."""
    name, settings = METHODS[method]
    truth = entries_of(platform)
    return 100.0 * (identify([log], platform, name, settings).theta[:9] - truth) / truth


def largest(percent: Array) -> float:
    """Of the errors of nine parameters, whatever their sign [%]."""
    return float(np.abs(percent).max())
