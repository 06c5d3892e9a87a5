"""A prediction's steps keep time with the commands, whichever sensor's clock comes first."""

from dataclasses import replace

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.flight import prepare
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.body import body_of
from twin.predict.logs import motion_of
from twin.recording import Recording
from twin.stream.recorder import MemoryRecorder


def flown(duration: float) -> Recording:
    flight = prepare(
        "whorl1",
        controller="quaternion_pd",
        estimator="filter",
        plant="sim",
        reference="multisine:3",
        duration=duration,
    )
    recorder = MemoryRecorder(flight.platform, {"platform": "whorl1", "source": "whorl1"})
    flight.fly(SimulatedClock(), [recorder])
    return recorder.recording().without_truth()


@pytest.fixture(scope="module")
def log() -> Recording:
    return flown(10.0)


def test_a_wheel_that_is_seen_three_times_is_followed_too():
    platform, log = load_platform("whorl1"), flown(2.5)
    assert 2 <= len(log["wheel_speed"]) < 5
    body = body_of(compile_model(platform), log, motion_of(log, platform))
    assert "wheel_speed" in body.inputs.used


@pytest.mark.parametrize("late", [0.0, 0.004, 0.0137, -0.0021])
def test_no_command_acts_before_it_was_given(log: Recording, late: float):
    attitude = log["attitude"]
    shifted = replace(attitude, time=attitude.time + late)
    log = replace(log, streams={**log.streams, "attitude": shifted})
    platform = load_platform("whorl1")
    grid = body_of(compile_model(platform), log, motion_of(log, platform)).grid
    into = (log["command_wheel_torque"].time - grid.begin) / grid.step
    np.testing.assert_allclose(into, np.rint(into), atol=1e-3)
