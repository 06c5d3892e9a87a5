"""The Allan deviation of a sensor at rest, taken to its parts."""

import numpy as np
import pytest

from twin.noise import measure_noise
from twin.recording import Series

SEED = 11
PERIOD = 0.01


def at_rest(white: float, walk: float, count: int = 120_000) -> Series:
    """Three columns of white noise [rad/sqrt(s)] and of rate random walk [rad/s/sqrt(s)]."""
    draw = np.random.default_rng(SEED)
    noise = draw.standard_normal((2, count, 3))
    drift = np.cumsum(walk * np.sqrt(PERIOD) * noise[1], axis=0)
    value = white / np.sqrt(PERIOD) * noise[0] + drift
    return Series(np.arange(count) * PERIOD, value, ("x", "y", "z"), "rad/s")


def test_white_noise_is_angle_random_walk_and_nothing_else():
    slow = measure_noise(at_rest(white=1e-4, walk=0.0)).slow
    assert slow is not None
    np.testing.assert_allclose(slow.random_walk, 1e-4, rtol=0.05)
    assert np.isnan(slow.rate_random_walk).sum() >= 2
    np.testing.assert_allclose(slow.deviation[0], 1e-4 / np.sqrt(PERIOD), rtol=0.02)


def test_a_drifting_bias_shows_as_rate_random_walk():
    slow = measure_noise(at_rest(white=1e-4, walk=5e-5)).slow
    assert slow is not None
    np.testing.assert_allclose(slow.random_walk, 1e-4, rtol=0.1)
    np.testing.assert_allclose(slow.rate_random_walk, 5e-5, rtol=0.5)


def test_only_the_stretch_at_rest_is_taken():
    still = at_rest(white=1e-4, walk=0.0, count=20_000)
    value = still.value.copy()
    value[:8000] += 0.05 * np.sin(still.time[:8000, None])
    slow = measure_noise(Series(still.time, value, still.columns, still.unit)).slow
    assert slow is not None
    assert slow.start == pytest.approx(80.0, abs=1.0)
    np.testing.assert_allclose(slow.random_walk, 1e-4, rtol=0.1)


def test_a_platform_that_never_rests_shows_no_slow_noise(flown):
    recording = flown({"gyro": 1e-3, "attitude": 1e-3, "wheel_speed": 0.1}, {})
    assert measure_noise(recording["gyro"]).slow is None
