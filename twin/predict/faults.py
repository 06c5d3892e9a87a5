"""Faults of a sensor, as perturbations: what its stream shows in place of the truth, and when.

Each acts along the predicted path, so none needs another rollout.
"""

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.predict.forces import Perturbation
from twin.predict.sensors import Output

Array = NDArray[np.float64]


def bias(stream: str, column: int, unit: str) -> Perturbation:
    """A constant error of one column; of an attitude, a turn about a body axis."""
    return Perturbation(
        f"{stream}_bias", unit, stream=stream, shown=lambda output, _: _only(output, column)
    )


def drift(stream: str, column: int, unit: str) -> Perturbation:
    """An error of one column that grows with time, 0 at the log's first instant."""

    def shown(output: Output, _: Array) -> Array:
        return _only(output, column) * (output.time - output.time[0])[:, None]

    return Perturbation(f"{stream}_drift", f"{unit}/s", stream=stream, shown=shown)


def scale_factor(stream: str, column: int) -> Perturbation:
    """One column shows (1 + strength) of the truth."""

    def shown(output: Output, truth: Array) -> Array:
        return truth * _only(output, column)

    return Perturbation(f"{stream}_scale_factor", "1", stream=stream, shown=shown)


def misalignment(stream: str, axis: int) -> Perturbation:
    """A vector's sensor is turned about a body axis: it shows R(strength)^T of the truth."""
    unit = np.eye(3)[axis]

    def shown(_: Output, truth: Array) -> Array:
        return rotation.cross(truth, unit)

    return Perturbation(f"{stream}_misalignment", "rad", stream=stream, shown=shown)


def clock_lag(stream: str) -> Perturbation:
    """A value stamped t was true at t - strength."""
    return Perturbation(
        "clock_lag", "s", stream=stream, late=lambda output: np.ones(len(output.time))
    )


def clock_drift(stream: str) -> Perturbation:
    """A value true at t, counted from the log's first instant, is stamped t (1 + strength)."""
    return Perturbation(
        "clock_drift", "s/s", stream=stream, late=lambda output: output.time - output.time[0]
    )


def _only(output: Output, column: int) -> Array:
    """(1, m, k) of ones in a column."""
    shown = np.zeros((1, *output.slot.shape))
    shown[..., column] = 1.0
    return shown
