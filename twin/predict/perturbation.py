"""One number by which reality may depart from a prediction, as the prediction feels it.

What it does to the motion is a generalised force along the measured motion; what it does to a
sensor is a change of the residual. Either way it is a column of the whitened innovations, so it can
be scored where the model stands, and fitted beside the base.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.predict.body import Body
from twin.predict.states import States

Array = NDArray[np.float64]

SMALL = 1e-3
"""Share of its typical size by which a sensor's fault is differenced."""


@dataclass(frozen=True)
class Perturbation:
    """A strength and what it does; a strength of 0 does nothing."""

    name: str
    unit: str
    """SI, of the strength."""
    force: Callable[[Body], Array] | None = None
    """(S, steps, nv) generalised force at strength 1, along a log's measured motion."""
    reading: Callable[[Body, States, float], Array] | None = None
    """(S, N) change of the residual by a sensor's fault of a strength, along a path (1, S, ...)."""
    typical: float = 1.0
    """A size that labs meet, where the sensor's fault is not linear."""


@dataclass(frozen=True)
class Added:
    """Perturbations of one log, their forces worked out."""

    body: Body
    perturbations: tuple[Perturbation, ...]
    forces: Array
    """(S, steps, nv, a) at strength 1; zero for a sensor's fault."""

    @staticmethod
    def to(body: Body, perturbations: tuple[Perturbation, ...]) -> "Added":
        """Work the forces out."""
        grid = body.grid
        forces = np.zeros((grid.segments, grid.steps, body.machine.model.nv, len(perturbations)))
        for i, one in enumerate(perturbations):
            if one.force is not None:
                forces[..., i] = one.force(body)
        return Added(body, perturbations, forces)

    def push(self, strengths: Array) -> Array:
        """(S, steps, nv) the forces together."""
        return np.asarray(self.forces @ strengths, dtype=np.float64)

    def readings(self, path: States, strengths: Array) -> Array:
        """(S, N) change of the residual by the sensors' faults together."""
        total = np.zeros(self.body.empty_rows.shape)
        for one, strength in zip(self.perturbations, strengths.tolist(), strict=True):
            if one.reading is not None and strength != 0.0:
                total += one.reading(self.body, path, strength)
        return total

    def reading_columns(self, path: States, strengths: Array) -> Array:
        """(S, N, a) d residual / d strength by the sensors' faults."""
        columns = np.zeros((*self.body.empty_rows.shape, len(self.perturbations)))
        for i, (one, strength) in enumerate(
            zip(self.perturbations, strengths.tolist(), strict=True)
        ):
            if one.reading is not None:
                step = SMALL * one.typical
                after = one.reading(self.body, path, strength + step)
                before = one.reading(self.body, path, strength - step)
                columns[..., i] = (after - before) / (2.0 * step)
        return columns
