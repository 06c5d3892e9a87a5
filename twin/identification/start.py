"""What logs can show of a machine, and where a fit of it starts."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.identification.linear.least_squares import Estimate
from twin.identification.track import gyro_bias
from twin.model import Machine
from twin.predict.base import BaseParameters, base_parameters, joint_parameters
from twin.predict.body import Body
from twin.recording import Recording

Array = NDArray[np.float64]

SURE = 0.2
"""Of a parameter's scale: half an interval with which the momentum's answer is worth starting from.
"""


WHEEL_COMMANDS = ("command_wheel_torque", "command_wheel_duty")


def base_of(machine: Machine, logs: Sequence[Recording]) -> tuple[BaseParameters, BaseParameters]:
    """J and m r as these logs can show them, and with what the MJCF states of its joints."""
    base = base_parameters(
        machine,
        torque=any(drives(log, machine) for log in logs),
        angle=any("joint_angle" in log for log in logs),
    )
    wheels = any(name in log for log in logs for name in WHEEL_COMMANDS)
    return base, base.with_joints(joint_parameters(machine, wheels))


def drives(recording: Recording, machine: Machine) -> bool:
    """Whether a log has a torque of known size, or a momentum or mass that moves.

    A stream that is zero throughout drives nothing.
    """
    known = (*machine.platform.commands, "command_wheel_duty", "wheel_speed", "stage_position")
    return any(bool(np.any(recording[name].value)) for name in known if name in recording)


def first_theta(base: BaseParameters, first: Estimate) -> Array:
    """The momentum's answer where it is sure, if some rigid body has it, else as stated."""
    known = first.half_widths < SURE * base.scale
    theta = np.where(known, first.theta, base.as_stated)
    try:
        base.model(theta)
    except TwinError:
        return base.as_stated
    return theta


def first_biases(body: Body) -> Array:
    """(b,) first guess of the sensors' constant errors."""
    guess = gyro_bias(body.recording)
    return np.concatenate(
        [
            guess[o.bias > 0.0] if o.stream == "gyro" else np.zeros(np.count_nonzero(o.bias))
            for o in body.outputs
        ]
    )
