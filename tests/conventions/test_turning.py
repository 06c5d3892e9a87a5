"""Gyro and attitude of a fast swing are one motion but for their noise, and evidence is weighed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from twin import rotation
from twin.conventions import check_conventions
from twin.conventions.evidence import inflation
from twin.conventions.room_vectors import room_vector
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


@pytest.mark.parametrize("stream", ["attitude", "gyro"])
def test_what_a_gap_hides_is_no_evidence_against_the_right_reading(stream: str):
    log = swinging(3)
    series = log[stream]
    seen = np.mod(series.time, 8.0) < 7.3  # half a period is gone, again and again
    log = replace(log, streams={**log.streams, stream: series.only(seen)})
    turning = turning_of(log)
    assert turning is not None
    left = turning.residual(np.eye(4), np.eye(3), LATE)
    assert np.mean(np.square(left)) < 1.2, "more than noise is left"
    assert check_conventions(log) == []


def test_a_right_log_of_one_swing_is_not_taken_for_one_that_is_a_period_late():
    for seed in range(3):
        assert check_conventions(swinging(seed)) == []


def test_a_magnetometer_on_a_fast_swing_leaves_little_and_tells_the_lag():
    log = swinging(2)
    attitude = log["attitude"]
    room = np.broadcast_to([0.5, 0.2, -0.8], (len(attitude), 3))
    field = rotation.rotate(rotation.conjugate(attitude.value), room)
    series = Series(attitude.time + LATE, field, ("x", "y", "z"), "T")
    log = replace(log, streams={**log.streams, "magnetometer": series})
    for source, late in (("attitude", -LATE), ("gyro", 0.0)):
        vector = room_vector(log, "magnetometer", source)
        assert vector is not None
        left, lag = vector.polished(np.eye(3), 0.0)
        assert lag == pytest.approx(late, abs=1e-3)
        # what moves a vector beside the rates is taken for larger than it is here
        assert left < 0.5 * vector.movement.size < 0.01 * np.sum(np.square(vector.movement))


def test_two_slow_motions_of_a_minute_are_not_one():
    time = np.arange(0.0, 60.0, 0.05)
    tones = np.linspace(0.02, 0.2, 12)
    for seed in range(4):
        draw = np.random.default_rng(seed)
        phase = draw.uniform(0.0, 2.0 * np.pi, (2, len(tones), 3))
        angle, other = (
            np.sin(2.0 * np.pi * tones[:, None] * time[:, None, None, None] + phase)
            .sum(axis=2)
            .transpose(1, 0, 2)
        )
        attitude = rotation.from_rotation_vector(0.03 * angle)
        gyro = 0.03 * np.gradient(other, time, axis=0) + draw.normal(0.0, 1e-4, other.shape)
        shaken = rotation.from_rotation_vector(draw.normal(0.0, 1e-4, other.shape))
        noisy = rotation.multiply(attitude, shaken)
        streams = {
            "gyro": Series(time, gyro, ("x", "y", "z"), "rad/s"),
            "attitude": Series(time, noisy, ("w", "x", "y", "z"), "1"),
        }
        (said,) = check_conventions(Recording(streams, {"kind": "log"}))
        assert said.kind == "no_fit"


def test_a_small_residual_hides_nothing_however_slow_it_is():
    slow = np.sin(np.linspace(0.0, 3.0, 200))[:, None]
    assert inflation(0.01 * slow) == 1.0
    assert inflation(slow) > 10.0


@pytest.mark.parametrize("cutoff", [0.5, 0.7])
def test_eight_seconds_of_a_smoothed_attitude_are_one_motion_with_the_gyro(cutoff: float):
    """The two go together at a third of a hertz alone: 15 sums over four cells are all that shows
    it, fewer than what else is asked for."""
    draw = np.random.default_rng(2)
    time = np.arange(0.0, 8.0, 0.01)
    tones = np.array([[0.21, 0.47, 1.1], [0.27, 0.53, 1.2], [0.19, 0.43, 1.0]])
    phase = draw.uniform(0.0, 2.0 * np.pi, (3, 3))
    waves = np.sin(2.0 * np.pi * tones * time[:, None, None] + phase)
    angle = (np.array([0.12, 0.08, 0.12]) * waves).sum(axis=2)
    attitude = rotation.from_rotation_vector(angle)
    turn = rotation.multiply(rotation.conjugate(attitude[:-1]), attitude[1:])
    rate = rotation.to_rotation_vector(turn) / 0.01
    gyro = np.vstack([rate, rate[-1:]]) + draw.normal(0.0, 1e-3, angle.shape)
    smooth = rotation.from_rotation_vector(filtfilt(*butter(2, cutoff, fs=100.0), angle, axis=0))
    shaken = rotation.from_rotation_vector(draw.normal(0.0, 1e-3, angle.shape))
    streams = {
        "gyro": Series(time, gyro, ("x", "y", "z"), "rad/s"),
        "attitude": Series(
            time + 0.005, rotation.multiply(smooth, shaken), ("w", "x", "y", "z"), "1"
        ),
    }
    assert check_conventions(Recording(streams, {"kind": "log"})) == []
