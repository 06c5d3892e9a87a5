"""003: what the indexes of the paper measure, and its rows."""

import numpy as np
import pytest

from papers import paper_003
from papers.flown import flown, perfect
from papers.paper_003 import (
    ALL_MOTORS,
    OFFSET,
    TABLES_PARTS,
    fly_tests,
    mechanical,
    mixed,
    momentum_change,
    ratio,
    table,
)
from papers.rows import Agreement, judge, paper_named, read_papers
from twin.controller import load_controller
from twin.plant.initial import InitialState, hanging
from twin.rotation import conjugate, from_rotation_vector, rotate, vertical_body
from twin.signals import Estimate, Target


@pytest.mark.parametrize("moment", [(1e-3, 2e-3, -5e-3), (0.0, 0.0, -1.0), (-3e-3, 0.0, -1e-3)])
def test_a_hanging_body_has_its_mass_moment_along_gravity(moment):
    down = -vertical_body(hanging(np.array(moment))[None])[0]
    np.testing.assert_allclose(down, np.array(moment) / np.linalg.norm(moment), atol=1e-12)


def test_a_table_that_would_lie_on_its_stop_starts_just_before_it():
    attitude = hanging(np.array([1e-3, 0.0, -1e-4]), largest_tilt=0.5)
    assert vertical_body(attitude[None])[0, 2] == pytest.approx(np.cos(0.5))


def test_the_tables_start_with_their_masses_half_a_millimetre_off():
    for side in (-1.0, 1.0):
        machine = table(side)
        added = machine.center_of_mass_offset[:2]
        np.testing.assert_allclose(added, side * OFFSET * ALL_MOTORS)
        assert machine.center_of_mass_offset[2] < 0.0, "the CM must hang below the CR"


def test_masses_alone_ask_for_the_torque_of_the_printed_law_at_small_tilts():
    """Eq. 3 for a small tilt and rate: -K_p sin - K_d w across gravity."""
    machine = perfect(table(-1.0))
    law, tilt, rate = mechanical(), np.array([1e-3, -2e-3, 0.0]), np.array([3e-4, 1e-4, 0.0])
    attitude = from_rotation_vector(tilt)[None]
    estimate = Estimate(
        0.0, attitude, rate[None], np.zeros((1, 0)), np.zeros((1, 3)), np.zeros((1, 0)),
        np.zeros((1, 0)), np.zeros((1, 3)), np.ones(1, dtype=bool),
    )  # fmt: skip
    level = Target(np.array([1.0, 0.0, 0.0, 0.0]))
    command, _ = law.update(law.init(machine, 1), estimate, level, 0.0)
    slides = np.array([stage.mass * stage.axis for stage in machine.stages])
    moment = command["command_stage_position"][0] @ slides
    gravity = rotate(conjugate(attitude), np.array([[0.0, 0.0, -machine.gravity]]))[0]
    wanted = -1e-3 * tilt - 1.8e-3 * rate
    np.testing.assert_allclose(np.cross(moment, gravity), wanted, rtol=2e-2, atol=1e-8)


def test_the_change_of_momentum_of_a_swinging_table_is_gravitys_torque():
    machine = perfect(table(-1.0))
    rest = InitialState(attitude=from_rotation_vector(np.array([0.05, 0.0, 0.0])))
    law = load_controller("free_float")
    swing = flown(machine, law, 60.0, start=rest, estimator="passthrough")
    seen = np.linalg.norm(momentum_change(swing), axis=2)[:, 0]
    down = -vertical_body(swing.true["attitude"][:, 0]) * machine.gravity
    felt = np.linalg.norm(np.cross(machine.center_of_mass_offset, down), axis=1)
    assert np.percentile(seen, 95.0) == pytest.approx(np.percentile(felt, 95.0), rel=0.1)


def test_a_ratio_of_equal_scatter_has_one_inside_its_interval():
    draw = np.random.default_rng(1).normal(10.0, 1.0, (2, 4))
    value, low, high = ratio(*draw)
    assert low < 1.0 < high
    assert low < value < high


def test_coils_move_the_masses_less_than_a_derivative_term_on_them_does():
    """Fig. 3 in short: half a minute of each law."""
    machine = table(-1.0)
    alone, both = (fly_tests(machine, law, 30.0) for law in (mechanical(), mixed()))
    assert both.path.mean() < alone.path.mean()


@pytest.mark.slow
def test_a_table_of_the_paper_comes_out(monkeypatch):
    """Of tests of 360 s; those of 1200 s and the other rows take minutes: `twin reproduce 003`."""
    monkeypatch.setattr(paper_003, "fly_tests", lambda *args: fly_tests(*args, 360.0))
    (part,) = (one for one in TABLES_PARTS if "003.table2.torque" in one.ids)
    found = part.compute(print)
    assert set(found.rows) == set(part.ids)
    rows = {row.id: row for row in paper_named(read_papers(), "003").rows}
    torque = judge(rows["003.table2.torque"], found.rows["003.table2.torque"])
    print(torque)
    assert torque.status is Agreement.agrees
