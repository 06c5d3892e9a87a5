"""One number by which reality may depart from a prediction, as the prediction feels it.

What it does to the motion is a generalised force along the measured motion; what it does to a
sensor is what the sensor shows, and when. `added.py` makes columns of the whitened innovations of
it, so that it can be scored where the model stands, and fitted beside the base.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.effects.on_body import TorqueLaw
from twin.predict.body import Body
from twin.predict.sensors.outputs import Output

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Perturbation:
    """A strength and what it does, in proportion; a strength of 0 does nothing."""

    name: str
    unit: str
    """SI, of the strength."""
    spread: float = np.inf
    """1 sigma of what is known of the strength beforehand, about 0."""
    force: Callable[[Body], Array] | None = None
    """(S, steps, nv) generalised force at strength 1, along a log's measured motion."""
    rest: Callable[[Body], Array] | None = None
    """(S, steps, nv) what it pushes besides, whatever its strength: of what is not proportional,
    `force` is the slope where it was formed. For a fit; a column is of `force` alone."""
    laws: tuple[tuple[float, TorqueLaw], ...] = ()
    """Torques on the base at strength 1, each so many times, that answer to the path that is
    predicted."""
    size: float = 0.0
    """Strength at which they are asked what they do, where there is none yet; 0: a small one. Near
    rest, twice the dry friction does far less than twice as much."""
    stream: str = ""
    """Whose sensor has the fault, if one has."""
    late: Callable[[Output], Array] | None = None
    """(m,) by how much each of its samples was true before its stamp [s], at strength 1."""
    shown: Callable[[Output, Array], Array] | None = None
    """What it shows beyond the truth (1, m, k) or (1, m, 4), at strength 1: (1, m, k)."""
