"""The noise that is put into a stream is the noise that is found in it."""

import dataclasses

import numpy as np
import pytest

from twin.noise import measure_noise, noise_left, noise_of
from twin.noise.stream import white_noise
from twin.recording import Series
from twin.rotation import from_rotation_vector, multiply

SEED = 3

GRADES = [
    ({"gyro": 1e-4, "attitude": 1e-4, "wheel_speed": 0.02}, {}),
    ({"gyro": 1e-3, "attitude": 1e-3, "wheel_speed": 0.1}, {}),
    ({"gyro": 4.4e-3, "attitude": 3.5e-2, "wheel_speed": 0.3}, {}),
    ({"gyro": 1e-4, "attitude": 1e-4, "wheel_speed": 0.02}, {"gyro": 20.0, "attitude": 20.0}),
    ({"gyro": 4.4e-3, "attitude": 3.5e-2, "wheel_speed": 0.3}, {"gyro": 41.0, "attitude": 100.0}),
    ({"gyro": 1e-3, "attitude": 1e-3, "wheel_speed": 0.02}, {"gyro": 50.0, "wheel_speed": 100.0}),
]


@pytest.mark.parametrize(("noise", "rate"), GRADES)
def test_the_noise_of_a_moving_platform_is_found_within_a_tenth(flown, noise, rate):
    recording = flown(noise, rate, SEED)
    for name, sigma in noise.items():
        found = noise_of(recording[name])
        assert found.shape == (3,)
        np.testing.assert_allclose(found, sigma, rtol=0.1, err_msg=name)


def test_a_random_walk_is_not_taken_for_white_noise():
    draw = np.random.default_rng(SEED)
    print("seed", SEED)
    walk = np.cumsum(0.03 * draw.standard_normal((20000, 2)), axis=0)
    value = walk + 0.02 * draw.standard_normal((20000, 2))
    series = Series(np.arange(20000) * 0.05, value, ("a", "b"), "rad/s")
    np.testing.assert_allclose(noise_of(series), 0.02, rtol=0.1)


def test_uneven_stamps_and_lost_samples_do_no_harm(swing):
    draw = np.random.default_rng(SEED)
    print("seed", SEED)
    even = swing(draw, 0.0, count=24000)
    kept = np.sort(draw.permutation(24000)[:8000])
    value = even.value[kept] + 1e-4 * draw.standard_normal((8000, 3))
    series = Series(even.time[kept], value, even.columns, even.unit)
    np.testing.assert_allclose(noise_of(series), 1e-4, rtol=0.1)


def test_bumps_and_spikes_are_not_taken_for_noise(swing):
    draw = np.random.default_rng(SEED)
    series = swing(draw, 1e-3)
    value = series.value.copy()
    value[2000:2400] += np.where(np.arange(400) % 7 < 3, 0.2, -0.2)[:, None]
    spikes = np.arange(100, 5900, 97)
    value[spikes, 1] += 0.5
    noise = measure_noise(dataclasses.replace(series, value=value))
    np.testing.assert_allclose(noise.white, 1e-3, rtol=0.1)
    quiet = (spikes < 1990) | (spikes > 2410)
    assert noise.outliers[spikes[quiet]].all()


def test_gaussian_noise_has_no_outliers(swing):
    draw = np.random.default_rng(SEED)
    assert not measure_noise(swing(draw, 1e-3, count=100_000)).outliers.any()


def test_an_attitude_scatters_about_body_axes_whatever_the_attitude():
    draw = np.random.default_rng(SEED)
    sigma = np.array([1e-3, 2e-3, 4e-3])
    time = np.arange(5000) * 0.02
    turning = from_rotation_vector(0.3 * time[:, None] * np.array([0.1, -0.2, 1.0]))
    value = multiply(turning, from_rotation_vector(sigma * draw.standard_normal((5000, 3))))
    value[2500:] *= -1.0  # q and -q are one attitude
    series = Series(time, value, ("w", "x", "y", "z"), "1")
    np.testing.assert_allclose(noise_of(series), sigma, rtol=0.1)


@pytest.mark.parametrize("missing", [0.0, np.nan])
@pytest.mark.parametrize("step", [1e-3, 0.25 * np.pi / 180.0, 0.061])
def test_a_coarse_grid_makes_the_noise(step, missing):
    time = np.arange(4000) * 0.01
    value = np.round(np.sin(0.2 * time)[:, None] * 40.0 * step / step) * step
    value[2000] = missing
    noise = measure_noise(Series(time, value, ("joint",), "rad"))
    assert noise.resolution[0] == pytest.approx(step, rel=1e-6)
    assert noise.quantised.all()
    assert noise.white[0] == pytest.approx(step / np.sqrt(12.0), rel=0.2)


def test_a_fine_grid_is_found_and_does_no_harm(swing):
    draw = np.random.default_rng(SEED)
    series = swing(draw, 1e-3)
    printed = dataclasses.replace(series, value=np.round(series.value, 6))
    noise = measure_noise(printed)
    np.testing.assert_allclose(noise.resolution, 1e-6, rtol=1e-6)
    assert not noise.quantised.any()
    np.testing.assert_allclose(noise.white, 1e-3, rtol=0.1)
    assert not measure_noise(series).resolution.any()


def test_a_sensor_slower_than_its_log_is_judged_by_its_own_samples(swing):
    draw = np.random.default_rng(SEED)
    series = swing(draw, 1e-3)
    held = dataclasses.replace(series, value=np.repeat(series.value[::5], 5, axis=0))
    noise = measure_noise(held)
    assert noise.clock.repeated == pytest.approx(0.8, abs=0.01)
    np.testing.assert_allclose(noise.white, 1e-3, rtol=0.1)


def test_a_constant_and_a_single_row_have_next_to_no_noise():
    still = Series(np.arange(10.0), np.full((10, 1), 3.0), ("a",), "V")
    assert 0.0 < noise_of(still)[0] < 1e-9
    assert 0.0 < noise_of(still.between(0.0, 0.5))[0] < 1e-9
    assert measure_noise(still.between(0.0, 0.0)).slow is None


def test_the_clock_counts_jitter_gaps_and_what_was_lost():
    draw = np.random.default_rng(SEED)
    time = np.arange(10000) * 0.01
    kept = np.ones(10000, dtype=bool)
    kept[3000:3050] = kept[7000] = False
    stamps = (time + 2e-4 * draw.standard_normal(10000))[kept]
    value = draw.standard_normal((len(stamps), 1))
    clock = measure_noise(Series(stamps, value, ("a",), "V")).clock
    assert (clock.gaps, clock.lost) == (2, 51)
    assert clock.longest_gap == pytest.approx(0.51, abs=1e-3)
    assert clock.period == pytest.approx(0.01, rel=1e-2)
    assert clock.jitter == pytest.approx(2e-4 * np.sqrt(2.0), rel=0.05)


def test_rows_without_a_number_are_left_out():
    draw = np.random.default_rng(SEED)
    time = np.arange(3000) * 0.02
    value = from_rotation_vector(1e-3 * draw.standard_normal((3000, 3)))
    value[1000:1010] = np.nan
    noise = measure_noise(Series(time, value, ("w", "x", "y", "z"), "1"))
    np.testing.assert_allclose(noise.white, 1e-3, rtol=0.1)
    assert noise.outliers.sum() == 10


def test_noise_is_neither_over_nor_underestimated_and_known_as_well_as_is_said():
    seed, count = 9, 4000
    print("seed", seed)
    rng = np.random.default_rng(seed)
    ratio, spread = [], []
    for _ in range(20):
        value = rng.normal(size=(count, 10))
        sigma, worth = white_noise(0.01 * np.arange(count), value)
        ratio.append(np.mean(np.square(value), axis=0) / np.square(sigma) - 1.0)
        spread.append(np.sqrt(2.0 / count * (1.0 / worth - 1.0)))
    off = np.array(ratio) / np.array(spread)
    # of 200: the mean is known to 0.07, the scatter to 5 %
    assert abs(off.mean()) < 0.25
    assert 0.8 < off.std() < 1.2


def test_what_a_law_makes_of_noise_is_none_once_it_is_predicted():
    draw = np.random.default_rng(SEED)
    time = np.arange(10000) * 0.01
    moved = 0.4 * np.repeat(draw.standard_normal((5000, 1)), 2, axis=0)
    measured = moved + draw.standard_normal((10000, 1))
    raw = white_noise(time, measured)[0]
    noise, _ = noise_left(time, measured, measured - moved)
    assert raw > 1.03
    np.testing.assert_allclose(noise, 1.0, rtol=0.02)


def test_noise_is_never_less_than_rounding():
    time = np.arange(4000) * 0.05
    true = 0.002 * np.sin(0.1 * time)[:, None]
    counted = 1e-4 * np.round(true / 1e-4)
    noise, _ = noise_left(time, counted, counted - true)
    np.testing.assert_allclose(noise, 1e-4 / np.sqrt(12.0), rtol=0.02)


def test_what_a_law_makes_of_the_noise_is_not_taken_for_noise():
    """A control law that answers a sensor shakes the machine by two percent of its noise."""
    draw = np.random.default_rng(SEED)
    time = np.arange(10000) * 0.01
    shaken = 0.15 * np.repeat(draw.standard_normal((2000, 60)), 5, axis=0)
    white = draw.standard_normal((10000, 60))
    variance = np.square(white_noise(time, white + shaken)[0]) / white.var(axis=0)
    assert variance.mean() == pytest.approx(1.0, abs=0.008)
