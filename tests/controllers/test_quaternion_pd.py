"""The wheels' law against an independent rigid body."""

import dataclasses

import numpy as np
import pytest

from twin.controller import load_controller
from twin.errors import ControllerError
from twin.platform import Wheel, load_platform
from twin.reference import Hold, Multisine, Slew
from twin.rotation import conjugate, multiply, tilt, to_rotation_vector

FIVE = np.radians(5.0)


@pytest.fixture(scope="module")
def law():
    return load_controller("quaternion_pd")


@pytest.fixture(scope="module")
def balanced(sads):
    return dataclasses.replace(sads, center_of_mass_offset=np.zeros(3))


def error_angle(flight, reference):
    target = reference.at(flight.time).attitude
    return np.linalg.norm(to_rotation_vector(multiply(conjugate(target), flight.attitude)), axis=1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_wheels_bring_the_body_back_from_five_degrees(law, balanced, fly, axis, sign):
    start = tuple(sign * FIVE * np.eye(3)[axis])
    error = error_angle(fly(law, balanced, start=start, duration=40.0), Hold())
    assert error[-1] < 1e-3 * FIVE
    assert error.max() <= FIVE * (1.0 + 1e-9), "it set out in the wrong direction"


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_wheels_stop_a_turning_body_and_take_over_its_momentum(law, balanced, fly, axis):
    rate = tuple(0.05 * np.eye(3)[axis])
    flight = fly(law, balanced, rate=rate, duration=60.0)
    assert error_angle(flight, Hold())[-1] < 1e-4
    taken = balanced.inertia @ rate
    np.testing.assert_allclose(flight.momentum[-1], taken, atol=2e-3)


def test_shorter_way_round_is_taken_from_either_sign_of_the_quaternion(law, balanced, fly):
    flight = fly(law, balanced, start=(0.0, 0.0, np.radians(200.0)), duration=80.0)
    yaw = to_rotation_vector(flight.attitude)[:, 2]
    assert abs(yaw[-1]) < 1e-2
    assert np.all(np.diff(yaw)[:200] >= 0.0), "200 deg is -160 deg: the way back is upwards"


def test_gravity_tilts_the_body_by_what_the_gain_gives_way(law, sads, fly):
    flight = fly(law, sads, duration=60.0)
    torque = np.hypot(*sads.center_of_mass_offset[:2]) * sads.gravity
    assert tilt(flight.attitude[-1]) == pytest.approx(2.0 * torque / law.proportional, rel=0.05)


def test_multisine_is_tracked_within_a_degree_and_four_fifths_of_the_momentum(law, sads, fly):
    flight = fly(law, sads, duration=300.0, reference=Multisine())
    error = error_angle(flight, Multisine())[flight.time > 30.0]
    assert np.degrees(np.sqrt(np.mean(error**2))) < 1.0
    assert np.abs(flight.momentum).max() < 4.0


def test_slew_is_followed(law, balanced, fly):
    slew = Slew(0.0, 0.0, np.radians(30.0))
    error = error_angle(fly(law, balanced, duration=100.0, reference=slew), slew)
    assert error.max() < np.radians(0.5)
    assert error[-1] < 1e-4


def test_torque_on_the_body_is_the_same_with_three_wheels_and_with_a_pyramid(law, sads):
    angles = np.radians([0.0, 90.0, 180.0, 270.0])
    axes = np.stack([np.cos(angles), np.sin(angles), np.full(4, 0.7)], axis=1)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    pyramid = dataclasses.replace(
        sads, wheels=tuple(Wheel(f"w{i}", 0.03, 5.0, 0.5, axis) for i, axis in enumerate(axes))
    )
    torque = np.array([0.1, -0.2, 0.3])
    for platform in (sads, pyramid):
        allocation = law.init(platform, 1)
        on_body = -np.array([wheel.axis for wheel in platform.wheels]).T @ (allocation @ torque)
        np.testing.assert_allclose(on_body, torque, atol=1e-15)


@pytest.mark.parametrize("count", [0, 2])
def test_platform_without_three_wheel_axes_is_refused(law, sads, count):
    platform = dataclasses.replace(sads, wheels=sads.wheels[:count])
    with pytest.raises(ControllerError, match=f"the {count} wheels of sads do not"):
        law.init(platform, 1)


@pytest.mark.parametrize("name", ["quaternion_pd", "mrp_tracking", "momentum_tracking"])
def test_a_wheel_in_a_gimbal_beside_those_on_the_body_is_refused(sads, name):
    gimballed = dataclasses.replace(sads.wheels[0], name="w4", gimbal="g1")
    platform = dataclasses.replace(sads, wheels=(*sads.wheels, gimballed))
    with pytest.raises(ControllerError, match=f"{name} .* but w4 of sads turn with a gimbal"):
        load_controller(name).init(platform, 1)


def test_wheels_in_gimbals_alone_are_refused(law):
    with pytest.raises(ControllerError, match="the 0 wheels of astros do not"):
        law.init(load_platform("astros"), 1)
