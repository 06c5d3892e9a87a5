"""References: what they promise about start, bounds and derivatives."""

import numpy as np
import pytest

from twin.errors import UsageError
from twin.reference import Hold, Move, Multisine, Slew, parse_reference
from twin.rotation import conjugate, multiply, tilt, to_euler_zyx, to_rotation_vector

MOTIONS = ["hold", "hold:3,-2,40", "slew:5,-3,60@2", "slew:0,0,0", "multisine", "multisine:20"]


@pytest.mark.parametrize("text", MOTIONS)
def test_rate_is_the_derivative_of_the_attitude(text):
    reference, h = parse_reference(text), 1e-3
    times = np.linspace(0.01, 120.0, 977)
    before, after = reference.at(times - h).attitude, reference.at(times + h).attitude
    difference = to_rotation_vector(multiply(conjugate(before), after)) / (2.0 * h)
    np.testing.assert_allclose(difference, reference.at(times).rate_body, atol=2e-8)


@pytest.mark.parametrize("text", MOTIONS)
def test_acceleration_is_the_derivative_of_the_rate(text):
    reference, h = parse_reference(text), 1e-3
    times = np.linspace(0.01, 120.0, 977)
    difference = (reference.at(times + h).rate_body - reference.at(times - h).rate_body) / (2.0 * h)
    np.testing.assert_allclose(difference, reference.at(times).acceleration_body, atol=2e-7)


@pytest.mark.parametrize("text", MOTIONS)
def test_many_times_at_once_are_the_same_as_one_by_one(text):
    reference, times = parse_reference(text), np.array([0.0, 0.3, 17.0, 250.0])
    together = reference.at(times)
    for row, time in enumerate(times):
        alone = reference.at(float(time))
        assert alone.attitude.shape == (4,)
        np.testing.assert_allclose(alone.attitude, together.attitude[row], rtol=0, atol=1e-15)
        np.testing.assert_allclose(alone.rate_body, together.rate_body[row], rtol=0, atol=1e-15)
        np.testing.assert_allclose(
            alone.acceleration_body, together.acceleration_body[row], rtol=0, atol=1e-15
        )


@pytest.mark.parametrize("text", ["slew:5,-3,60", "multisine"])
def test_motion_starts_level_and_at_rest_without_a_step(text):
    start = parse_reference(text).at(0.0)
    np.testing.assert_array_equal(start.attitude, [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(start.rate_body, 0.0)
    np.testing.assert_array_equal(start.acceleration_body, 0.0)


def test_multisine_stays_within_its_amplitude_and_uses_it():
    angles = np.abs(to_euler_zyx(Multisine().at(np.arange(0.0, 3000.0, 0.05)).attitude))
    assert angles.max() <= np.radians(5.0)
    assert angles[: 300 * 20].max(axis=0).min() > np.radians(4.0), "an axis is hardly excited"


def test_multisine_asks_little_of_the_wheels_of_sads():
    target = Multisine().at(np.arange(0.0, 3000.0, 0.05))
    inertia = np.array([3.0, 12.0, 12.0])
    assert np.abs(inertia * target.rate_body).max() < 0.2, "momentum, of 5 N m s"
    assert np.abs(inertia * target.acceleration_body).max() < 0.05, "torque, of 0.5 N m"


def test_slew_ends_at_its_attitude_and_keeps_its_rate():
    slew = Slew(0.05, -0.04, 1.0, rate=0.03)
    times = np.linspace(0.0, slew.duration, 4001)
    rates = np.linalg.norm(slew.at(times).rate_body, axis=-1)
    assert rates.max() == pytest.approx(0.03, rel=1e-9)
    end = slew.at(slew.duration + 5.0)
    np.testing.assert_allclose(to_euler_zyx(end.attitude), [1.0, -0.04, 0.05], atol=1e-15)
    np.testing.assert_array_equal(end.rate_body, 0.0)


def test_text_says_roll_pitch_yaw_in_degrees():
    assert parse_reference("hold") == Hold()
    assert parse_reference("hold:0,5,0") == Hold(pitch=np.radians(5.0))
    assert parse_reference("slew:1,2,3@4").rate == pytest.approx(np.radians(4.0))
    assert parse_reference("multisine:2.5") == Multisine(np.radians(2.5))
    assert parse_reference("multisine:10@0.03") == Multisine(np.radians(10.0), 0.03)
    assert tilt(parse_reference("hold:5,0,30").at(0.0).attitude) == pytest.approx(np.radians(5.0))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("sine", "no reference named 'sine'; use hold"),
        ("hold:", "'' should be 3 numbers"),
        ("hold:1,2", "'1,2' should be 3 numbers"),
        ("slew:1,2,x", "'1,2,x' should be 3 numbers"),
        ("slew:1,2,3@0", "the rate must be above 0"),
        ("slew:1,2,3@", "'' should be one number"),
        ("slew", "'' should be 3 numbers"),
        ("multisine:nan", "'nan' should be one number"),
        ("multisine:90", "between 0 and 90 deg"),
        ("multisine:-1", "between 0 and 90 deg"),
        ("multisine:5@0", "above 0 Hz"),
        ("multisine:5@", "'' should be one number"),
        ("place:1", "'1' should be 2 numbers"),
        ("move:1,0@0", "an acceleration above 0"),
        ("move:1,0@1,0", "highest speed above 0"),
        ("place:0,0+move:1,0", "no attitude \\+ one place"),
        ("hold+slew:0,0,1", "no attitude \\+ one place"),
    ],
)
def test_text_that_names_no_reference_is_told_what_would(text, sentence):
    with pytest.raises(UsageError, match=sentence):
        parse_reference(text)


def test_a_move_is_the_fastest_from_rest_to_rest_within_its_limits():
    draw = np.random.default_rng(20261130)
    for _ in range(20):
        x, y = draw.normal(size=2)
        acceleration, speed = draw.uniform(0.01, 0.2), draw.uniform(0.05, 1.0)
        move, way = Move(x, y, acceleration, speed), np.hypot(x, y)
        reaches = speed**2 / acceleration < way
        shortest = 2.0 * np.sqrt(way / acceleration)
        cruising = way / speed + speed / acceleration
        assert move.duration == pytest.approx(cruising if reaches else shortest)
        times = np.linspace(-1.0, move.duration + 1.0, 20001)
        target, step = move.at(times), times[1] - times[0]
        assert target.position is not None
        assert target.velocity is not None
        assert target.acceleration is not None
        middle = 0.5 * (target.velocity[1:] + target.velocity[:-1])
        np.testing.assert_allclose(
            np.diff(target.position, axis=0), step * middle, atol=0.3 * acceleration * step**2
        )
        gained = np.linalg.norm(np.diff(target.velocity, axis=0), axis=1)
        assert gained.max() <= acceleration * step * (1.0 + 1e-9)
        assert np.linalg.norm(target.velocity, axis=1).max() <= speed * (1.0 + 1e-9)
        np.testing.assert_allclose(target.position[-1], [x, y, 0.0], atol=1e-12)
        np.testing.assert_array_equal(target.velocity[[0, -1]], 0.0)


def test_a_place_goes_with_any_attitude():
    both = parse_reference("slew:0,0,90@3+move:1,-2@0.1").at(np.array([0.0, 20.0, 100.0]))
    alone = parse_reference("slew:0,0,90@3").at(np.array([0.0, 20.0, 100.0]))
    np.testing.assert_array_equal(both.attitude, alone.attitude)
    assert both.position is not None
    np.testing.assert_allclose(both.position[-1], [1.0, -2.0, 0.0])
    assert alone.position is None
    stay = parse_reference("hold:0,0,1e+1+place:1,2").at(3.0).position
    np.testing.assert_array_equal(stay, [1.0, 2.0, 0.0])
