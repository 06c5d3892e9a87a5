"""Tilt and rate from an inclinometer alone."""

import dataclasses

import numpy as np
import pytest

from twin.errors import UsageError
from twin.estimators import InclinometerDifferences, load_estimator
from twin.platform import load_platform
from twin.rotation import conjugate, from_euler_zyx, multiply, tilt, to_rotation_vector
from twin.signals import POSITIONS, Reading, Samples


@pytest.fixture(scope="module")
def machine():
    """`astros`, whose stages and gimbals no sensor shows."""
    shipped = load_platform("astros")
    sensors = {name: one for name, one in shipped.sensors.items() if name not in POSITIONS}
    return dataclasses.replace(shipped, sensors=sensors)


def shown(attitude):
    """(n, 2) what an inclinometer at rest shows: elevations of two body axes."""
    w, x, y, z = np.moveaxis(attitude, -1, 0)
    up = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x)], axis=-1)
    return np.stack([np.arcsin(up[:, 1]), -np.arcsin(up[:, 0])], axis=-1)


def reading(time, tilts, valid=True):
    ones = np.full((len(tilts), 1), valid)
    return Reading(
        time, {"inclinometer": Samples(tilts[:, None], np.full((len(tilts), 1), time), ones)}
    )


def test_attitude_has_the_tilt_that_was_shown_and_no_yaw(machine):
    draw = np.random.default_rng(1)
    attitude = from_euler_zyx(*draw.uniform(-0.5, 0.5, (3, 50)))
    law = InclinometerDifferences()
    estimate = law.update(law.init(machine, 50), reading(0.05, shown(attitude)))
    np.testing.assert_allclose(shown(estimate.attitude), shown(attitude), atol=1e-12)
    np.testing.assert_allclose(tilt(estimate.attitude), tilt(attitude), atol=1e-12)
    assert estimate.valid.all()
    assert not estimate.rate_body.any(), "one tilt tells no rate"


def test_rate_is_the_turn_between_two_tilts_over_their_time(machine):
    law, zero = InclinometerDifferences(), np.zeros(2)
    before = from_euler_zyx(zero, np.array([0.02, -0.1]), np.array([0.01, 0.3]))
    after = from_euler_zyx(zero, np.array([0.021, -0.1]), np.array([0.01, 0.302]))
    estimate = law.update(law.init(machine, 2), reading(0.05, shown(before)))
    estimate = law.update(estimate, reading(0.10, shown(after)))
    wanted = to_rotation_vector(multiply(conjugate(before), after)) / 0.05
    np.testing.assert_allclose(estimate.rate_body, wanted, atol=1e-12)


def test_lost_tilt_holds_attitude_and_rate_and_the_next_rate_spans_the_gap(machine):
    law = InclinometerDifferences()
    estimate = law.init(machine, 1)
    for time, roll, valid in ((0.05, 0.0, True), (0.10, 9.0, False), (0.15, 0.002, True)):
        estimate = law.update(estimate, reading(time, np.array([[roll, 0.0]]), valid))
        if not valid:
            assert not estimate.rate_body.any()
    np.testing.assert_allclose(estimate.rate_body[0], [0.02, 0.0, 0.0], atol=1e-9)


def test_machine_without_an_inclinometer_is_told_what_would_do(machine):
    sensors = {name: sensor for name, sensor in machine.sensors.items() if name != "inclinometer"}
    bare = dataclasses.replace(machine, sensors=sensors)
    with pytest.raises(UsageError, match="astros has none; use the estimator 'passthrough'"):
        load_estimator("inclinometer").init(bare, 1)
    blind = dataclasses.replace(machine, sensors={"gyro": machine.sensors["gyro"]})
    with pytest.raises(UsageError, match=r"none; no estimator .* give it \[sensors\.attitude\]"):
        load_estimator("inclinometer").init(blind, 1)


@pytest.mark.parametrize("name", ["filter", "vertical_offset"])
def test_machine_without_attitude_is_told_of_an_estimator_that_becomes_valid(machine, name):
    sensors = {stream: sensor for stream, sensor in machine.sensors.items() if stream != "attitude"}
    tilted = dataclasses.replace(machine, sensors=sensors)
    with pytest.raises(
        UsageError, match="astros has no attitude; use the estimator 'inclinometer'"
    ):
        load_estimator(name).init(tilted, 1)
