"""Stages are moved within the rules, read back, and a wrong sign is found before anything flies."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from twin.errors import SafetyError, UnknownName, UsageError
from twin.plant.guard.guarded import Held
from twin.plant.hardware_setup import read_hardware
from twin.service.jog import jog
from twin.service.stages import gather, home, parked
from twin.service.status import status

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")

STEP = 2e-6
PLAY = 1e-5
"""[m]: of the CubeSat table's screws."""


def test_a_floating_table_that_turns_as_predicted_tells_that_its_stage_has_the_right_sign(table):
    with table(Held.floating) as bench:
        told = jog(bench, "s1", 5e-4)
    assert "s1 was sent from 0 mm to 0.5 mm and reads 0.49" in told[0]
    found = re.search(r"turned the right way: (\S+) \+- (\S+) of what", told[1])
    assert found is not None, told
    share, width = map(float, found.groups())
    assert abs(share - 1.0) < 1.5 * width < 0.3


def test_a_stage_that_turns_the_table_the_other_way_is_refused_for_flying(cubesat, table):
    stages = (replace(cubesat.stages[0], axis=-cubesat.stages[0].axis), *cubesat.stages[1:])
    turned_round = replace(cubesat, stages=stages)
    with (
        table(Held.floating, modelled=turned_round) as bench,
        pytest.raises(SafetyError, match="the table turned the wrong way: -1"),
    ):
        jog(bench, "s1", 5e-4)


def test_an_upright_stage_turns_nothing_that_could_be_seen_and_says_so(table):
    with table(Held.floating) as bench:
        told = jog(bench, "s3", -5e-4)
    assert "does not tell the sign" in told[1]


def test_a_stage_that_runs_against_its_command_is_stopped_after_a_short_way(cubesat, table):
    setup = read_hardware(cubesat)
    commanded = tuple(
        replace(route, scale=-1.0) if "stage" in route.stream else route
        for route in setup.commanded
    )
    with table(Held.captured, believed=replace(setup, commanded=commanded)) as bench:
        with pytest.raises(SafetyError, match="s2 was sent .* and went the other way"):
            jog(bench, "s2", 1e-2)
        place = bench.guard.seen.stage_position
    assert abs(place[1]) < 1e-3


def test_a_captured_table_lets_a_stage_go_far(table):
    with table(Held.captured) as bench:
        told = jog(bench, "s2", -1e-2)
        assert bench.guard.seen.stage_position[1] == pytest.approx(-1e-2, abs=PLAY + STEP)
    assert "captured" in told[1]


@pytest.mark.parametrize(
    ("held", "stage", "distance", "error", "sentence"),
    [
        (Held.floating, "s1", 2e-3, SafetyError, "go 1.2 mm at most, or capture it"),
        (Held.captured, "s1", 3e-2, SafetyError, "would go from 0 mm to 30 mm; its travel is"),
        (Held.captured, "s4", 1e-3, UnknownName, "no stage named 's4'"),
        (Held.captured, "s1", 0.0, UsageError, "a distance that is not zero"),
        (Held.captured, "s1", float("nan"), UsageError, "a distance that is not zero"),
    ],
)
def test_a_jog_that_cannot_be_is_refused_and_nothing_moves(
    table, held, stage, distance, error, sentence
):
    with table(held) as bench:
        with pytest.raises(error, match=sentence):
            jog(bench, stage, distance)
        place = bench.guard.seen.stage_position
    assert place is None or not place.any()


def test_masses_are_parked_as_low_as_they_go_and_brought_back_to_zero(cubesat, table):
    lowest = parked(cubesat)
    assert lowest.tolist() == [0.0, 0.0, -0.02]
    with table(Held.captured) as bench:
        told = gather(bench, lowest, "park")
        np.testing.assert_allclose(bench.guard.seen.stage_position, lowest, atol=PLAY + STEP)
    assert told == ["park: s1 at 0 mm, s2 at 0 mm, s3 at -20 mm"]


def test_no_table_that_may_float_has_its_masses_gathered(table, cubesat):
    with table(Held.floating) as bench, pytest.raises(SafetyError, match="zero refused"):
        gather(bench, 0.0 * parked(cubesat), "zero")


def test_a_board_that_cannot_seek_a_home_says_what_to_do_instead(table):
    with table(Held.captured) as bench, pytest.raises(UsageError, match="marks by hand"):
        home(bench)


def test_status_tells_devices_streams_and_fitness_and_leaves_all_unarmed(table):
    with table() as bench:
        found = status(bench)
        assert not bench.hardware.armed
    (board,) = found.devices
    assert (board.name, board.identity, board.unfit) == ("feather", "emulated feather", "")
    assert "none wrong" in board.line
    assert "its clock is known to" in board.clock
    assert {stream.name for stream in found.streams} >= {"gyro", "attitude", "stage_position"}
    assert all(stream.age < 0.2 and stream.value for stream in found.streams)
    assert found.floating is None
    assert found.refusals == ()
    assert "it would be armed" in found.words()
