"""Momentum budgets: when gyros come next to a singular state, foretold and as flown."""

from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.budget import gyro_budget, leaning, singularity_free_radius
from twin.platform import load_platform
from twin.reference import Hold, parse_reference
from twin.rotation import cross, from_rotation_vector, multiply, vertical_body


@pytest.fixture(scope="module")
def eq43():
    said: list[str] = []
    run = twin.fly("tas2:eq43", "cmg_pd", duration=130.0, keep=False, say=said.append)
    return run, said


def test_gyros_that_fill_are_warned_of_within_5_percent_of_when_they_do(eq43):
    run, _ = eq43
    (warning,) = run.warnings
    assert "the gyros will fill" in warning
    foretold = run.document()["forecast"]
    assert foretold["of"] == "gyros"
    assert foretold["used_up_at_s"] == pytest.approx(110.0, rel=0.05)
    assert run.metrics["gyro_near_singular_at_s"] == pytest.approx(
        foretold["used_up_at_s"], rel=0.05
    )


def test_gyros_that_fill_are_warned_of_while_they_fly_and_in_time(eq43):
    run, said = eq43
    (warning,) = (line for line in said if line.startswith("warning: at"))
    at = float(warning.split("at ")[1].split(" s")[0])
    left = float(warning.split("pace in ")[1].split(" s")[0])
    near = run.metrics["gyro_near_singular_at_s"]
    assert at < near - 10.0
    assert at + left == pytest.approx(near, rel=0.05)


def test_what_a_level_array_has_to_hold_is_the_integral_of_gravitys_torque():
    machine = load_platform("tas2:eq43")
    home = np.array([gimbal.home for gimbal in machine.gimbals])
    budget = gyro_budget(machine, Hold(), 60.0, home)
    torque = machine.gravity * np.hypot(*machine.center_of_mass_offset[:2])
    np.testing.assert_allclose(
        np.linalg.norm(budget.momentum, axis=1), torque * budget.time, rtol=1e-9, atol=1e-9
    )
    assert budget.singular_at is None
    assert budget.radius == pytest.approx(20.0, rel=1e-6)


def test_at_the_lean_of_a_law_its_torque_and_gravitys_cancel():
    rng = np.random.default_rng(4)
    machine = replace(load_platform("tas2"), center_of_mass_offset=np.array([0.02, -0.03, -0.4]))
    attitude = from_rotation_vector(rng.uniform(-0.2, 0.2, (20, 3)))
    stiffness = -6.0 * np.eye(3)
    phi = leaning(machine, attitude, stiffness)
    assert np.abs(phi).max() > 0.01
    down = -machine.gravity * vertical_body(multiply(attitude, from_rotation_vector(phi)))
    pull = cross(np.broadcast_to(machine.center_of_mass_offset, down.shape), down)
    np.testing.assert_allclose(pull + phi @ stiffness, 0.0, atol=1e-9)


def test_a_body_that_no_law_holds_is_said_to_stand_on_its_reference():
    machine = load_platform("tas2")
    attitude = from_rotation_vector(np.zeros((3, 3)))
    np.testing.assert_array_equal(leaning(machine, attitude, np.zeros((3, 3))), 0.0)


def test_gyros_in_pairs_have_a_sphere_by_their_sizes():
    axes = np.eye(3)
    assert singularity_free_radius(axes, 20.0 * np.ones(3)) == pytest.approx(
        20.0 * singularity_free_radius(axes)
    )


def test_a_fast_turn_is_foretold_by_what_the_body_takes():
    machine = load_platform("tas2")
    machine = replace(machine, center_of_mass_offset=np.zeros(3))
    home = np.array([gimbal.home for gimbal in machine.gimbals])
    slew = parse_reference("slew:0,0,60@5")
    budget = gyro_budget(machine, slew, 40.0, home)
    rate = slew.at(budget.time).rate_body
    np.testing.assert_allclose(budget.momentum, -rate @ machine.inertia, atol=1e-9)
