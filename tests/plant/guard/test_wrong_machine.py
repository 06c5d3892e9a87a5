"""Sensors that show what is not so, and actuators that do what they were not told, end safe.

Flights over the emulated board in lockstep: no test here depends on how busy a computer is.
"""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from twin.bench import open_bench
from twin.controller.load import load_controller
from twin.emulate.emulated import Fault
from twin.estimators.named import load_estimator, usual_estimator
from twin.loop import Ended, Outcome, fly
from twin.plant.guard.guarded import Held
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.reference import Hold
from twin.rotation import from_euler_zyx
from twin.service.answer import BodyAnswer

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")

GYRO, ATTITUDE = 0, 1
"""Channels of the CubeSat table's board."""


LEANING = InitialState(attitude=from_euler_zyx(0.05, 0.03, 0.02))


def flown(
    machine: Platform, *faults: Fault, law: str = "free_float", duration: float = 40.0
) -> Outcome:
    """How it ended."""
    with (
        open_bench(
            machine,
            "pty",
            held=Held.floating,
            faults=faults,
            lockstep=True,
            seed=3,
            initial=LEANING,
        ) as bench,
        BodyAnswer(bench) as answer,
    ):
        clock = bench.begin()
        return fly(
            bench,
            load_estimator(usual_estimator(bench.platform)),
            load_controller(law),
            Hold(),
            clock,
            duration=duration,
            observers=[answer],
        )


def top_heavy() -> Platform:
    """A CubeSat table that falls over within some seconds."""
    return replace(load_platform("cubesat"), center_of_mass_offset=np.array([1e-5, 0.0, 4e-4]))


def test_a_sound_table_that_falls_over_is_stopped_by_its_cut_out():
    outcome = flown(top_heavy())
    assert outcome.ended is Ended.safe_stop
    assert "leans by 32" in outcome.reason


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (Fault("stuck", 2.0, value=100.0), "the same for 1. samples: the sensor has stopped"),
        (Fault("frozen", 2.0, value=ATTITUDE), "attitude the same for"),
        (Fault("frozen", 2.0, value=GYRO), "gyro the same for"),
        (Fault("zero", 2.0, value=ATTITUDE), "attitude a quaternion of length 0"),
    ],
    ids=["all stuck", "attitude frozen", "gyro frozen", "attitude zero"],
)
def test_what_blinds_the_cut_out_stops_a_table_that_falls_over(fault, sentence):
    outcome = flown(top_heavy(), fault)
    assert outcome.ended is Ended.safe_stop
    assert re.search(sentence, outcome.reason), outcome.reason
    assert outcome.duration < 3.0


def test_a_single_wrong_sample_is_left_out_and_the_flight_goes_on():
    outcome = flown(load_platform("cubesat"), Fault("spike", 3.0, value=GYRO), duration=8.0)
    assert outcome.ended is Ended.done, outcome.reason


# ---- actuators

STAGES, COILS = 5, 6


@pytest.mark.parametrize(
    ("law", "fault", "sentence"),
    [
        (
            "mass_magnetic_pid",
            Fault("dead", 4.0, value=STAGES),
            "stage s. does not follow: ",
        ),
        (
            "magnetic_damping",
            Fault("reversed", 4.0, value=COILS),
            "command_dipole acts the wrong way round: in",
        ),
    ],
    ids=["stage stuck", "coils reversed"],
)
@pytest.mark.slow
def test_an_actuator_that_fails_in_flight_ends_it_with_its_name(law, fault, sentence):
    outcome = flown(load_platform("cubesat"), fault, law=law, duration=80.0)
    assert outcome.ended is Ended.safe_stop
    assert re.search(sentence, outcome.reason), outcome.reason
