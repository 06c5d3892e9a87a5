"""All laws without a name that logs can be asked for: torques, and errors of sensors."""

from collections.abc import Sequence

import numpy as np

from twin.diagnose.law import Law
from twin.diagnose.sensor_laws import sensor_laws
from twin.diagnose.torque_laws import torque_laws
from twin.predict.body import Body

RARE = 6.0
"""-2 log of how probable a law without a name is beforehand, beside all those of the catalogue."""


def laws_of(bodies: Sequence[Body]) -> tuple[Law, ...]:
    """Of what these logs hold."""
    return (*torque_laws(bodies), *sensor_laws(bodies))


def unlikely(laws: Sequence[Law]) -> float:
    """-2 log of how probable each of them is beforehand."""
    return RARE + 2.0 * float(np.log(len(laws)))
