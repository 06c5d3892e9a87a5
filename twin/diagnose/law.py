"""A law without a name: one term of what the catalogue has no cause for."""

from dataclasses import dataclass

import numpy as np

from twin.diagnose.weighing import Trace
from twin.predict.effects.perturbation import Perturbation

TORQUE = "torque"
"""What is not a sensor's error."""


@dataclass(frozen=True)
class Law:
    """A torque about one axis of the base, or an error of one column of a sensor, in proportion to
    a product."""

    what: str
    """`torque`, or the sensor's stream."""
    column: str
    """Of it."""
    factors: tuple[str, ...]
    unit: str
    """Of its coefficient."""
    perturbation: Perturbation

    @property
    def label(self) -> str:
        """`torque_x ~ rate_x rate_z`, `gyro_x ~ gyro_y`."""
        return self.perturbation.name

    def trace(self, unlikely: float) -> Trace:
        """Of any size and sign."""
        free = np.full(1, np.inf)
        return Trace(self.label, -free, free, unlikely=unlikely)
