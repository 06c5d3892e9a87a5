"""Where a mass was, between what its counter tells of it."""

from dataclasses import replace

import numpy as np
import pytest

from twin.effects.stages.stage_backlash import StageBacklash
from twin.effects.stages.stage_scale import StageScale
from twin.model import Machine, compile_model
from twin.platform import load_platform
from twin.predict.drive import Inputs
from twin.predict.profiles import profile
from twin.recording import Recording, Series

TOLD = "command_stage_position"
DIGIT = 1e-6
"""[m] of the counter."""
PLAY = StageBacklash(target="s2", width=25.7e-6)
"""Half of it is no whole number of digits, and a command that is one leaves the mass between."""


@pytest.fixture
def machine() -> Machine:
    return compile_model(load_platform("whorl2"))


@pytest.fixture
def truth(machine: Machine) -> Series:
    """With the play."""
    return profile(replace(machine, effects=(PLAY,)), TOLD, command(machine))[0]


def command(machine: Machine) -> Series:
    time = np.arange(0.0, 40.0, machine.platform.tick)
    told = np.zeros((len(time), 3))
    told[:, 1] = DIGIT * np.round(300.0 * np.sin(0.3 * time))
    return Series(time, told, ("s1", "s2", "s3"), "m")


def inputs(machine: Machine, truth: Series) -> Inputs:
    told = command(machine)
    seen = DIGIT * np.round(truth.interpolated_at(told.time[::2]) / DIGIT)
    counted = Series(told.time[::2], seen, told.columns, "m")
    return Inputs(machine, Recording({TOLD: told, "stage_position": counted}))


def off(found: Inputs, truth: Series) -> float:
    """[m] at most."""
    place = found.joint_states(truth.time)[0][:, found.machine.stage_qpos]
    return float(np.abs(place - truth.value).max())


@pytest.mark.parametrize(
    "fault",
    [PLAY, StageScale(target="s2", error=0.0069), StageScale(target="s2", error=-0.0069)],
    ids=["play", "too far", "not far enough"],
)
def test_a_fault_is_sized_by_counters_to_less_than_their_digit(machine, fault):
    truth = profile(replace(machine, effects=(fault,)), TOLD, command(machine))[0]
    found = inputs(machine, truth)
    usual = fault.typical("s2")
    sized = found.stage_course.sized(usual, found.stage_seen)
    assert found.counted_with(sized)
    assert not found.counted_with(usual)
    off_by = np.abs(found.stage_course.less(sized, truth.time) - (truth.value - told(found).value))
    assert np.ptp(off_by) < 0.5 * DIGIT


def told(found: Inputs) -> Series:
    """Where the mass should be."""
    return found.stage_course.place


def test_a_counter_alone_leaves_a_mass_off_by_its_digit(machine, truth):
    assert 0.3 * DIGIT < off(inputs(machine, truth), truth) < 5.0 * DIGIT


def test_with_its_play_a_mass_is_where_that_takes_it(machine, truth):
    assert off(inputs(machine, truth).with_stages(PLAY), truth) < 1e-3 * DIGIT


def test_with_a_play_that_is_not_there_it_is_where_it_was_counted(machine, truth):
    wrong = replace(PLAY, width=3.0 * PLAY.width)
    assert off(inputs(machine, truth).with_stages(wrong), truth) < 5.0 * DIGIT
