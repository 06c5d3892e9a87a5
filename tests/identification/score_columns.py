"""How a prediction's residual depends on a sensor's clock and scale: columns for a score test."""

import numpy as np
from numpy.typing import NDArray

from twin.predict.body import Body
from twin.predict.states import States

Array = NDArray[np.float64]

_LAG = 1e-4
"""Of the central difference [s]."""


def clock_lag(body: Body, path: States, stream: str) -> Array:
    """(S, N, 1) d residual / d lag [1/s]: a value stamped t was true at t - lag."""
    parts = [
        (output.residual(path, step, _LAG) - output.residual(path, step, -_LAG)) / (2.0 * _LAG)
        if output.stream == stream
        else np.zeros((1, *output.slot.shape))
        for output in body.outputs
        for step in [body.grid.step]
    ]
    return body.cells.scatter(parts)[0][..., None]


def scale_factor(body: Body, path: States, stream: str) -> Array:
    """(S, N, k) d residual / d error of each column's scale: it shows (1 + error) of the truth."""
    columns: list[Array] = []
    for index, output in enumerate(body.outputs):
        if output.stream != stream:
            continue
        shown = -output.predicted(path, body.grid.step) / output.sigma
        for column in range(shown.shape[-1]):
            parts = [np.zeros((1, *o.slot.shape)) for o in body.outputs]
            parts[index][..., column] = shown[..., column]
            columns.append(body.cells.scatter(parts)[0])
    return np.stack(columns, axis=-1)
