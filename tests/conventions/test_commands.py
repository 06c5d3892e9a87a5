"""A command of the wrong sign is named by what it does to its wheel, whatever turns the body."""

from dataclasses import replace

import numpy as np
import pytest

from papers.flown import flown
from twin.controller import load_controller
from twin.conventions import check_conventions
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.reference import Multisine

HANGS = -0.5
"""m r along z [kg m]: gravity turns the body as much as its wheels do."""


@pytest.fixture(scope="module")
def flight() -> tuple[Recording, Platform]:
    """A log of a table that hangs, and the machine as somebody states it who does not know so."""
    shipped = load_platform("sads")
    hanging = replace(shipped, center_of_mass_offset=np.array([0.05, -0.03, HANGS]))
    law = load_controller("quaternion_pd")
    run = flown(hanging, law, 40.0, reference=Multisine(), seed=6, record=True)
    return run.recordings[0].without_truth(), shipped


def with_command(log: Recording, factors: list[float]) -> Recording:
    series = log["command_wheel_torque"]
    told = replace(series, value=series.value * factors)
    return replace(log, streams={**log.streams, "command_wheel_torque": told})


def test_commands_that_their_wheels_follow_are_not_accused(flight):
    log, platform = flight
    assert check_conventions(log, platform) == []


@pytest.mark.parametrize(
    ("factors", "words"),
    [([1.0, -1.0, 1.0], "w2 axis points the other way"), ([-1.0] * 3, "every axis of command")],
)
def test_a_command_of_the_wrong_sign_is_named(flight, factors, words):
    log, platform = flight
    found = check_conventions(with_command(log, factors), platform)
    assert any(words.lower() in finding.sentence.lower() for finding in found), found
