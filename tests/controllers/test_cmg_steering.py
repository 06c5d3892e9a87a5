"""Gimbal rates for a torque: inverse, singularity-robust, and with wheels and null motion."""

from dataclasses import replace

import numpy as np
import pytest

from papers.flown import perfect
from tests.controllers.flight import simulate
from twin.controller import load_controller
from twin.controller.exchange import Gyros
from twin.errors import ControllerError
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.reference import Hold
from twin.rotation import from_rotation_vector, to_rotation_vector
from twin.signals import Estimate


@pytest.fixture(scope="module")
def tas2():
    return perfect(load_platform("tas2"))


@pytest.fixture(scope="module")
def astros():
    return perfect(load_platform("astros"))


def standing(platform, angles=None, speeds=None, rate=(0.0, 0.0, 0.0)):
    """An estimate at rest and level, gimbals and wheels at home unless given."""
    home = np.array([gimbal.home for gimbal in platform.gimbals])
    turning = np.array([wheel.home for wheel in platform.wheels])
    angle = np.atleast_2d(home if angles is None else angles)
    n = len(angle)
    return Estimate(
        time=0.0,
        attitude=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        rate_body=np.tile(rate, (n, 1)),
        wheel_speed=np.tile(turning if speeds is None else speeds, (n, 1)),
        stage_position=np.zeros((n, len(platform.stages))),
        joint_angle=np.zeros((n, 0)),
        joint_rate=np.zeros((n, 0)),
        gyro_bias=np.zeros((n, 3)),
        valid=np.ones(n, dtype=bool),
        gimbal_angle=angle,
    )


def momenta(platform, run):
    """(m, 3) of the gyros [N m s, body]."""
    speeds = run.true.get("wheel_speed", np.zeros((len(run.time), 0)))
    estimate = replace(standing(platform, run.true["gimbal_angle"]), wheel_speed=speeds)
    return Gyros.of(platform, "test").momentum(estimate)


@pytest.mark.parametrize(
    ("variant", "angles", "expected"),
    [
        ("tas2", (-30.0, 90.0, -30.0), -np.sqrt(0.75)),
        ("tas2", (0.0, 0.0, 0.0), 0.0),
        # At a skew of beta: det A of eq. 41, sin(beta) = sin 70 deg, cos(beta) = cos 70 deg
        ("tas2:skew70", (-30.0, 90.0, -30.0), None),
    ],
)
def test_determinant_of_the_printed_array(variant, angles, expected):
    """000 eq. 41, H = 1 each; at home -0.866 with a skew of 90 deg."""
    platform = load_platform(variant)
    gyros, delta = Gyros.of(platform, "test"), np.radians(angles)
    columns = gyros.columns(standing(platform, delta))[0] / 20.0
    beta = np.radians(90.0) if expected is not None else np.radians(70.0)
    (c1, c2, c3), (s1, s2, s3) = np.cos(delta), np.sin(delta)
    sine, cosine = np.sin(beta), np.cos(beta)
    printed = [
        [-cosine * c1, s2, cosine * c3],
        [-s1, -cosine * c2, s3],
        [sine * c1, sine * c2, sine * c3],
    ]
    assert np.linalg.det(columns.T) == pytest.approx(np.linalg.det(printed), abs=1e-9)
    if expected is not None:
        assert np.linalg.det(columns.T) == pytest.approx(expected, abs=1e-9)
    regularity = gyros.regularity(standing(platform, delta))[0]
    assert regularity == pytest.approx(np.linalg.det(printed) ** 2 / 27.0, abs=1e-12)


@pytest.mark.parametrize("name", ["tas2", "astros"])
def test_columns_are_the_slope_of_the_momentum(name):
    platform = load_platform(name)
    gyros = Gyros.of(platform, "test")
    angle = np.random.default_rng(5).uniform(-3.0, 3.0, len(platform.gimbals))
    step = 1e-6 * np.eye(len(angle))
    up, down = (gyros.momentum(standing(platform, angle + sign * step)) for sign in (1.0, -1.0))
    columns = gyros.columns(standing(platform, angle))[0]
    np.testing.assert_allclose(columns, (up - down) / 2e-6, atol=1e-6)


@pytest.mark.parametrize("name", ["tas2", "astros"])
def test_steering_is_exact_at_home(name):
    platform = load_platform(name)
    gyros, home = Gyros.of(platform, "test"), standing(platform)
    change = np.array([[0.3, -0.2, 0.5]])
    given = np.einsum(
        "ngi,ng->ni", gyros.columns(home), gyros.rates(change, home, 0.3, regularity=1e-4)
    )
    np.testing.assert_allclose(given, change, rtol=1e-9)


@pytest.mark.parametrize("damping", [0.05, 0.0], ids=["robust", "plain inverse"])
def test_without_dither_a_lost_direction_stays_lost(damping):
    """At delta = 0 and a skew of 90 deg all three gyros of tas2 turn it about z alone."""
    platform = load_platform("tas2:singular")
    gyros, home = Gyros.of(platform, "test"), standing(platform)
    _, sizes, rows = np.linalg.svd(gyros.columns(home)[0])
    assert sizes[-1] < 1e-9 * sizes[0]
    lost = rows[-1:]
    stuck = gyros.rates(lost, home, 0.3, damping=damping, dither=0.0)
    assert np.abs(stuck).max() < 1e-6, "rad/s for 1 N m"
    if damping:
        assert np.abs(gyros.rates(lost, home, 0.3, damping=damping)).max() > 1e-3


def off(run):
    return np.linalg.norm(to_rotation_vector(run.true["attitude"]), axis=1)


@pytest.mark.parametrize("dither", [0.0, 0.1])
def test_gyros_leave_a_singular_state_by_dither_alone(tas2, dither):
    """det A = sin(d_2) sin(d_1 + d_3): at (-30, 0, -30) deg torque about x alone is lost."""
    law = load_controller("cmg_pd", {"dither": dither, "damping": 0.01})
    balanced = replace(tas2, center_of_mass_offset=np.zeros(3))
    angle = np.radians(3.0)
    start = InitialState(
        attitude=from_rotation_vector(np.array([angle, 0.0, 0.0])),
        gimbal_angle=np.radians([-30.0, 0.0, -30.0]),
    )
    run = simulate(law, balanced, 50.0, start=start)
    if dither:
        assert off(run)[-1] < 0.5 * angle, "lambda still errs this near to the singular state"
    else:
        assert off(run)[-1] == pytest.approx(angle, rel=1e-3)


def test_wheels_give_at_a_singular_state_what_gimbals_cannot(astros):
    """All four gyros turned so that their columns lie in a plane; the torque is exact there too."""
    gyros = Gyros.of(astros, "test")
    direction = np.array([0.0, 0.0, 1.0])
    # Largest momentum along z: then no column has a part along it.
    angle = np.arctan2(gyros.across @ direction, gyros.spin @ direction)
    there = standing(astros, angle)
    assert gyros.regularity(there)[0] < 1e-12
    law = load_controller("vscmg_pd", {"derivative": 1.0, "proportional": 0.0, "homing": 0.0})
    rate = 0.05 * direction
    estimate = replace(there, rate_body=rate[None])
    command, _ = law.update(law.init(astros, 1), estimate, Hold().at(0.0), 0.0)
    change = command["command_gimbal_rate"] @ gyros.columns(estimate)[0]
    change = change + command["command_wheel_torque"] @ gyros.along(estimate)[0]
    np.testing.assert_allclose(change[0], rate, atol=1e-9)  # and w x h = 0 along z
    gimbals_alone = gyros.rates(rate[None], estimate, 0.0, dither=0.0)
    assert np.abs(gimbals_alone).max() < 1e-6


def test_null_motion_brings_gyros_home_and_leaves_the_body_alone(astros):
    """From where internal motion alone led: the same momentum, none, at other angles and speeds."""
    law = load_controller("vscmg_pd")
    level = replace(astros, center_of_mass_offset=np.zeros(3))
    home = np.array([wheel.home for wheel in astros.wheels])
    start = InitialState(gimbal_angle=np.array([0.6, -0.6, 0.6, -0.6]), wheel_speed=1.2 * home)
    run = simulate(law, level, 60.0, start=start)
    first = np.linalg.norm(momenta(level, run)[0])
    speed = np.array([wheel.speed_limit for wheel in astros.wheels])
    away = np.hypot(
        np.linalg.norm(run.true["gimbal_angle"], axis=1),
        np.linalg.norm((run.true["wheel_speed"] - home) / speed, axis=1),
    )
    print(f"away from home {away[0]:.2f} to {away[-1]:.3f}; body off by {off(run).max():.1e} rad")
    assert first < 1e-9
    assert away[-1] < 0.1 * away[0]
    assert np.diff(away).max() < 1e-3 * away[0]
    assert off(run).max() < np.radians(0.1)


def test_slew_ends_with_the_gyros_home_which_the_inverse_alone_forgets(astros):
    level = replace(astros, center_of_mass_offset=np.zeros(3))
    start = InitialState(attitude=from_rotation_vector(np.radians([4.0, -3.0, 25.0])))
    run = simulate(load_controller("vscmg_pd"), level, 80.0, start=start)
    assert off(run)[-1] < np.radians(0.1)
    assert np.abs(run.true["gimbal_angle"][-1]).max() < 0.05


def test_rotors_at_constant_speed_are_refused(tas2, sads):
    with pytest.raises(ControllerError, match="tas2 has 0 wheels on gimbals of 0"):
        load_controller("vscmg_pd").init(tas2, 1)
    with pytest.raises(ControllerError, match="sads has 0: choose a platform with control moment"):
        load_controller("cmg_pd").init(sads, 1)
