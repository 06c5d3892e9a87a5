"""Where a mass was, between what its counter tells of it."""

from dataclasses import replace

import numpy as np
import pytest

from twin.effects.actuators import StageBacklash, StageScale
from twin.model import Machine, compile_model
from twin.platform import load_platform
from twin.predict.inputs import Inputs
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


def test_what_accelerates_a_mass_adds_up_to_its_rate(machine, truth):
    found, step = inputs(machine, truth), machine.platform.step
    rate = found.joint_states(truth.time)[1][:, machine.stage_dof]
    kick = found.joint_states(truth.time[:-1] + 0.5 * step)[2][:, machine.stage_dof]
    assert np.abs(rate).max() > 0.0
    assert np.cumsum(step * kick, axis=0) == pytest.approx(rate[1:] - rate[0], abs=1e-12)


def moved(machine: Machine, seed: int) -> tuple[Inputs, Series]:
    """A mass that is sent there and back, half a millimetre and later than it was told, and where
    it was: read now and then, the readings' stamps as they come."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, machine.platform.tick)
    sent = np.zeros((len(time), 3))
    sent[:, 1] = 5e-4 * (np.floor(time / 4.0) % 2.0)
    late = round(rng.uniform(0.05, 0.3) / machine.platform.tick)
    command = Series(time, sent, ("s1", "s2", "s3"), "m")
    later = replace(command, value=np.concatenate([sent[:1].repeat(late, axis=0), sent[:-late]]))
    truth = profile(machine, TOLD, later)[0]
    stamps = np.cumsum(rng.uniform(0.03, 0.09, 340))
    stamps = stamps[stamps < 20.0]
    seen = DIGIT * np.round(truth.interpolated_at(stamps) / DIGIT)
    read = Series(stamps, seen, command.columns, "m")
    return Inputs(machine, Recording({TOLD: command, "stage_position": read})), truth


def at_rest(time: np.ndarray) -> np.ndarray:
    """Ten readings after a move and before the next: a spline has forgotten both."""
    return (time % 4.0 > 1.8) & (time % 4.0 < 3.2)


def test_a_mass_that_rests_after_a_move_is_where_uneven_readings_have_it(machine):
    found, truth = moved(machine, 5)
    place = found.joint_states(truth.time)[0][:, machine.stage_qpos]
    resting = at_rest(truth.time)
    assert np.abs(place - truth.value)[resting].max() < DIGIT


def test_where_a_late_mass_was_is_doubted_while_it_moves_and_not_while_it_rests(machine):
    found, truth = moved(machine, 6)
    doubt = found.stage_doubt.held_at(truth.time)
    resting = at_rest(truth.time)
    place = found.joint_states(truth.time)[0][:, machine.stage_qpos]
    astray = np.abs(place - truth.value)
    assert not doubt[resting].any()
    assert not doubt[:, [0, 2]].any()
    # a reading lasts 0.06 s
    assert np.sqrt(np.mean(doubt / 0.06)) > np.sqrt(np.mean(np.square(astray)))


def test_of_a_mass_that_went_as_it_was_told_nothing_is_doubted(machine):
    there = profile(machine, TOLD, command(machine))[0]
    assert inputs(machine, there).stage_doubt is None


def test_beside_a_late_move_a_play_that_is_stated_still_says_where_a_mass_rests(machine):
    """What a counter rounds, the drive's own profile knows better."""
    stated = replace(machine, effects=(PLAY,))
    found, truth = moved(stated, 7)
    place = found.joint_states(truth.time)[0][:, machine.stage_qpos]
    assert found.stage_doubt is not None
    assert np.abs(place - truth.value)[at_rest(truth.time)].max() < 1e-3 * DIGIT
