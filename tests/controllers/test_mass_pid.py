"""The sliding masses' law against an independent rigid body."""

import dataclasses

import numpy as np
import pytest

from twin.controller import load_controller
from twin.errors import ControllerError
from twin.reference import Hold
from twin.rotation import from_rotation_vector, matrix, tilt
from twin.signals import Estimate

FIVE = np.radians(5.0)


@pytest.fixture(scope="module")
def law():
    return load_controller("mass_pid")


def moment(platform, positions):
    slides = np.array([stage.mass * stage.axis for stage in platform.stages])
    return platform.center_of_mass_offset + positions @ slides


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_masses_level_the_body_from_five_degrees(law, sads, fly, axis, sign):
    start = tuple(sign * FIVE * np.eye(3)[axis])
    flight = fly(law, sads, start=start, duration=150.0)
    assert tilt(flight.attitude[-1]) < 2e-3 * FIVE


@pytest.mark.parametrize("offset", [(2e-3, -1e-3), (-9e-3, 9e-3)])
def test_masses_balance_an_offset_in_the_plane(law, sads, fly, offset):
    below = dataclasses.replace(sads, center_of_mass_offset=np.array([*offset, -3e-3]))
    flight = fly(law, below, duration=200.0)
    assert np.abs(moment(below, flight.stage[-1])[:2]).max() < 1e-6, "in kg m"
    assert abs(flight.stage[-1, 2]) < 1e-6, "the vertical stage has no part in it"


def test_balance_holds_however_the_body_points(law, sads, fly):
    start = (0.0, 0.0, np.radians(150.0))
    flight = fly(law, sads, start=start, duration=200.0)
    assert np.abs(moment(sads, flight.stage[-1])[:2]).max() < 1e-6


def test_gain_beyond_the_routh_bound_diverges_and_one_below_it_settles(law, sads, fly):
    offset = sads.center_of_mass_offset * [0.0, 0.0, 1.0]
    platform, start = dataclasses.replace(sads, center_of_mass_offset=offset), np.radians(0.5)
    restoring = -offset[2] * sads.gravity
    bound = law.derivative * (law.proportional + 2.0 * restoring) / sads.inertia[1, 1]
    late = {}
    for factor in (0.7, 1.4):
        tuned = dataclasses.replace(law, integral=factor * bound)
        flight = fly(tuned, platform, start=(0.0, start, 0.0), duration=100.0)
        late[factor] = tilt(flight.attitude[-400:]).max()
    assert late[0.7] < 0.5 * start
    assert late[1.4] > 2.0 * start


def estimate_of(attitude, rate):
    n = len(attitude)
    return Estimate(
        time=0.0,
        attitude=attitude,
        rate_body=rate,
        wheel_speed=np.zeros((n, 3)),
        stage_position=np.zeros((n, 3)),
        joint_angle=np.zeros((n, 0)),
        joint_rate=np.zeros((n, 0)),
        gyro_bias=np.zeros((n, 3)),
        valid=np.ones(n, dtype=bool),
    )


def test_positions_give_the_horizontal_part_of_the_torque_asked_for(sads):
    """Equation 19 put into equation 18, on tilted bodies; the derivative term asks."""
    law = load_controller("mass_pid", {"proportional": 0.0, "integral": 0.0, "derivative": 1.0})
    draw = np.random.default_rng(3)
    attitude = from_rotation_vector(0.2 * draw.normal(size=(5, 3)))
    up, torque = matrix(attitude)[:, 2], 0.2 * draw.normal(size=(5, 3))
    estimate, level = estimate_of(attitude, -torque), Hold().at(0.0)
    command, _ = law.update(law.init(sads, 5), estimate, level, 0.0)
    slides = np.array([stage.mass * stage.axis for stage in sads.stages])
    given = np.cross(command["command_stage_position"] @ slides, -sads.gravity * up)
    horizontal = torque - np.sum(torque * up, axis=1, keepdims=True) * up
    np.testing.assert_allclose(given, horizontal, atol=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_stage_leaves_its_end_as_soon_as_the_tilt_turns(law, sads, sign):
    short = dataclasses.replace(
        sads, stages=tuple(dataclasses.replace(s, travel=(-2e-3, 2e-3)) for s in sads.stages)
    )
    state, level = law.init(short, 1), Hold().at(0.0)
    tilted, back = (
        estimate_of(from_rotation_vector(np.array([[0.0, angle, 0.0]])), np.zeros((1, 3)))
        for angle in np.radians([sign, -sign])
    )
    for _ in range(2000):
        command, state = law.update(state, tilted, level, 0.0)
    end = command["command_stage_position"][0, 0]
    assert abs(end) == pytest.approx(2e-3, rel=0.01), "100 s of a degree should drive it there"
    command, state = law.update(state, back, level, 0.0)
    assert command["command_stage_position"][0, 0] / end < 0.5


@pytest.mark.parametrize("count", [0, 1])
def test_platform_without_two_horizontal_stages_is_refused(law, sads, count):
    platform = dataclasses.replace(sads, stages=sads.stages[:count])
    with pytest.raises(ControllerError, match=f"the {count} stages of sads do not"):
        law.init(platform, 1)
