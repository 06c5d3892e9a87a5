"""Faults of a sensor, as perturbations: what its stream shows in place of the truth.

Each acts along the predicted path, so none needs another rollout.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.predict.body import Body
from twin.predict.outputs import Output
from twin.predict.perturbation import Perturbation
from twin.predict.states import States

Array = NDArray[np.float64]

Shown = Callable[[Output, States, float], Array]
"""Stream, path (1, S, ...), step [s] -> what it shows beyond the truth (1, m, k), at strength 1."""


def bias(stream: str, column: int) -> Perturbation:
    """A constant error of one column; of an attitude, a turn about a body axis."""
    return _linear("bias", _unit(stream), stream, lambda o, p, h: _only(o, column))


def drift(stream: str, column: int) -> Perturbation:
    """An error of one column that grows with time, 0 at the log's first instant."""

    def shown(output: Output, path: States, step: float) -> Array:
        return _only(output, column) * (output.time - output.time[0])[:, None]

    return _linear("drift", f"{_unit(stream)}/s", stream, shown)


def scale_factor(stream: str, column: int) -> Perturbation:
    """One column shows (1 + strength) of the truth."""
    return _linear(
        "scale_factor",
        "1",
        stream,
        lambda o, p, h: o.predicted(p, h) * _only(o, column),
    )


def misalignment(stream: str, axis: int) -> Perturbation:
    """A vector's sensor is turned about a body axis: it shows R(strength)^T of the truth."""
    unit = np.eye(3)[axis]
    return _linear(
        "misalignment", "rad", stream, lambda o, p, h: rotation.cross(o.predicted(p, h), unit)
    )


def clock_lag(stream: str, typical: float = 0.01) -> Perturbation:
    """A value stamped t was true at t - strength."""
    return _late("clock_lag", "s", stream, lambda o: np.ones(len(o.time)), typical)


def clock_drift(stream: str, typical: float = 1e-4) -> Perturbation:
    """A value true at t, counted from the log's first instant, is stamped t (1 + strength)."""
    return _late("clock_drift", "s/s", stream, lambda o: o.time - o.time[0], typical)


def _linear(kind: str, unit: str, stream: str, shown: Shown) -> Perturbation:
    def reading(body: Body, path: States, strength: float) -> Array:
        def change(output: Output) -> Array:
            return -strength * shown(output, path, body.grid.step) / output.noise

        return _of_stream(body, stream, change)

    return Perturbation(f"{stream}_{kind}", unit, reading=reading)


def _late(
    kind: str, unit: str, stream: str, growth: Callable[[Output], Array], typical: float
) -> Perturbation:
    def reading(body: Body, path: States, strength: float) -> Array:
        def change(output: Output) -> Array:
            step = body.grid.step
            late = output.residual(path, step, strength * growth(output))
            return late - output.residual(path, step)

        return _of_stream(body, stream, change)

    return Perturbation(f"{kind}:{stream}", unit, reading=reading, typical=typical)


def _of_stream(body: Body, stream: str, change: Callable[[Output], Array]) -> Array:
    """(S, N) rows that are 0 but for one stream's."""
    return body.scatter(
        [
            change(output) if output.stream == stream else np.zeros((1, *output.slot.shape))
            for output in body.outputs
        ]
    )[0]


def _only(output: Output, column: int) -> Array:
    """(1, m, k) of ones in a column."""
    shown = np.zeros((1, *output.slot.shape))
    shown[..., column] = 1.0
    return shown


def _unit(stream: str) -> str:
    return {"attitude": "rad", "joint_angle": "rad"}.get(stream, "rad/s")
