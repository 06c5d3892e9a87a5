"""Lags that are one clock's are told as one."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from twin.effects import effect_named
from twin.report.diagnosed import common_clock_sentences

TURNING, AT_REST = np.array([[0.0], [1.0]]), np.zeros((2, 1))


def found(lags: Mapping[str, float], half: float = 0.01) -> Any:
    """Of a table whose wheels are driven, its masses at rest."""
    streams = {
        name: SimpleNamespace(value=TURNING)
        for name in ("gyro", "attitude", "wheel_speed", "command_wheel_torque")
    }
    streams["command_stage_position"] = SimpleNamespace(value=AT_REST)
    body = SimpleNamespace(
        recording=streams,
        inputs=SimpleNamespace(used=("command_wheel_torque", "command_stage_position")),
        outputs=[SimpleNamespace(stream=name) for name in ("gyro", "attitude", "wheel_speed")],
    )
    causes = [
        SimpleNamespace(
            effect=effect_named("clock_lag")(lag, target=name), half_widths=np.array([half])
        )
        for name, lag in lags.items()
    ]
    return SimpleNamespace(causes=causes, explained=SimpleNamespace(bodies=[body]))


def test_sensors_that_are_early_by_one_time_are_told_as_commands_that_are_late():
    (said,) = common_clock_sentences(
        found({"gyro": -0.5, "attitude": -0.505, "wheel_speed": -0.495})
    )
    assert said == (
        "gyro, attitude and wheel_speed are early by the same time, 0.5 s: rather than 3 clocks "
        "it is one that is off, theirs, or that of command_wheel_torque, late by 0.5 s."
    )


def test_two_sensors_on_one_late_computer_are_told_beside_what_is_not_late():
    (said,) = common_clock_sentences(found({"gyro": 0.1, "attitude": 0.1}))
    assert "gyro and attitude are late by the same time" in said
    assert "that of command_wheel_torque and wheel_speed, early" in said


def test_lags_that_differ_by_more_than_their_intervals_are_two_clocks():
    assert common_clock_sentences(found({"gyro": 0.1, "attitude": 0.15})) == []


def test_one_late_stream_is_told_by_its_own_sentence():
    assert common_clock_sentences(found({"gyro": 0.1})) == []
