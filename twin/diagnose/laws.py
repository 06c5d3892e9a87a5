"""All laws without a name that logs can be asked for: torques, and errors of sensors."""

from collections.abc import Sequence

from twin.diagnose.law import Law
from twin.diagnose.sensor_laws import sensor_laws
from twin.diagnose.torque_laws import torque_laws
from twin.predict.body import Body


def laws_of(bodies: Sequence[Body]) -> tuple[Law, ...]:
    """Of what these logs hold."""
    return (*torque_laws(bodies), *sensor_laws(bodies))
