"""Gyro and attitude of a fast swing are one motion but for their noise, and evidence is weighed."""

import numpy as np
import pytest

from twin import rotation
from twin.conventions import check_conventions
from twin.conventions.evidence import inflation
from twin.conventions.turning import NEAR, turning_of
from twin.recording import Recording, Series

LATE = 0.013
"""Of the gyro's stamps, less than a cell [s]."""


def swinging(seed: int) -> Recording:
    """A pendulum's period of 1.5 s, about one axis, with the noise of good sensors."""
    draw = np.random.default_rng(seed)
    time, about_x = np.arange(0.0, 40.0, 0.01), np.array([1.0, 0.0, 0.0])
    pace = 2.0 * np.pi / 1.5
    attitude = rotation.from_rotation_vector(0.8 * np.sin(pace * time)[:, None] * about_x)
    shaken = rotation.from_rotation_vector(draw.normal(0.0, 1e-4, (len(time), 3)))
    rate = 0.8 * pace * np.cos(pace * time)[:, None] * about_x
    gyro = rate + draw.normal(0.0, 1e-4, rate.shape)
    streams = {
        "gyro": Series(time + LATE, gyro, ("x", "y", "z"), "rad/s"),
        "attitude": Series(time, rotation.multiply(attitude, shaken), ("w", "x", "y", "z"), "1"),
    }
    return Recording(streams, {"kind": "log"})


def test_a_fast_swing_leaves_nothing_but_noise():
    turning = turning_of(swinging(1))
    assert turning is not None
    match = turning.match(NEAR)
    lag = float(match.lag[0, 0])
    assert lag == pytest.approx(LATE, abs=1e-4)
    left = turning.residual(np.eye(4), np.eye(3), lag)
    # a number of squares that are independent or nearly so
    assert np.mean(np.square(left)) == pytest.approx(1.0, abs=0.2)
    assert match.misfit[0, 0] == pytest.approx(np.sum(np.square(left)), rel=0.02)


def test_a_right_log_of_one_swing_is_not_taken_for_one_that_is_a_period_late():
    for seed in range(3):
        assert check_conventions(swinging(seed)) == []


def test_a_small_residual_hides_nothing_however_slow_it_is():
    slow = np.sin(np.linspace(0.0, 3.0, 200))[:, None]
    assert inflation(0.01 * slow) == 1.0
    assert inflation(slow) > 10.0
