"""What a log's commands say where their record begins late, or has a single row."""

import numpy as np
import pytest

from twin.platform import load_platform, taken_as_at_rest
from twin.predict.inputs import as_commanded
from twin.recording import Recording, Series

SADS = load_platform("sads")


def log(*told: float) -> Recording:
    """Of a gyro from 5 to 65 s, and wheels' torques that were recorded at these times [s]."""
    time, stamps = np.arange(5.0, 65.0, 0.01), np.array(told)
    torque = 0.1 * np.ones((len(stamps), 3))
    return Recording(
        {
            "gyro": Series(time, np.zeros((len(time), 3)), ("x", "y", "z"), "rad/s"),
            "command_wheel_torque": Series(stamps, torque, ("w1", "w2", "w3"), "N m"),
        },
        {"kind": "log", "source": "monday"},
    )


def test_nothing_is_commanded_before_the_first_command_and_that_is_said():
    late = log(15.0, 30.0)
    told = as_commanded(late, "command_wheel_torque")
    np.testing.assert_allclose(told.held_at(np.array([5.0, 14.9, 15.0]))[:, 0], [0.0, 0.0, 0.1])
    said = [line for line in taken_as_at_rest([late], SADS) if "command_wheel_torque" in line]
    assert said == [
        "command_wheel_torque of this log begins 10 s after the motion: taken as nothing until "
        "then. If its recorder only started late, cut the log there."
    ]


@pytest.mark.parametrize("first", [4.0, 5.0, 5.3])
def test_a_command_that_holds_from_the_start_or_nearly_is_taken_as_it_is(first: float):
    usual = log(first, 30.0)
    assert as_commanded(usual, "command_wheel_torque") is usual["command_wheel_torque"]
    assert not [line for line in taken_as_at_rest([usual], SADS) if "begins" in line]


def test_a_single_command_holds_to_the_end():
    told = as_commanded(log(20.0), "command_wheel_torque")
    np.testing.assert_allclose(told.held_at(np.array([10.0, 20.0, 64.0]))[:, 0], [0.0, 0.1, 0.1])
    assert told.time[-1] == log(20.0).stop
