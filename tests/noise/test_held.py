"""Of a sensor slower than its log only the measurements are used; a coarse one keeps all rows."""

from dataclasses import replace

import numpy as np
import pytest

from twin import rotation
from twin.noise.stuck import slow_sensor
from twin.recording import Series


def held(series: Series, lengths: np.ndarray) -> tuple[Series, np.ndarray]:
    """Each value is held for so many rows; with the rows (m,) that are measurements."""
    first = np.r_[0, np.cumsum(lengths)]
    first = first[first < len(series)]
    measured = np.zeros(len(series), dtype=np.bool_)
    measured[first] = True
    return replace(series, value=series.value[first[np.cumsum(measured) - 1]]), measured


def joined(series: Series, every: float, digits: int = 10) -> tuple[Series, np.ndarray]:
    """Straight lines between measurements `every` so many rows; with the instants of those."""
    rows = np.arange(len(series))
    knots = np.arange(0.0, len(series) - 1, every)
    columns = [np.interp(rows, knots, column[knots.astype(int)]) for column in series.value.T]
    value = np.round(np.stack(columns, axis=1), digits)
    return replace(series, value=value), knots * 0.01


@pytest.mark.parametrize("k", [2, 3, 10, 50])
def test_held_rows_are_found_whatever_the_rate_of_the_sensor(swing, draw, k):
    log, measured = held(swing(draw, 1e-3), np.full(6000 // k + 1, k))
    found = slow_sensor(log)
    assert found is not None
    assert not found.interpolated
    assert found.measured.tolist() == measured.tolist()
    assert found.rate == pytest.approx(100.0 / k, rel=1e-6)


def test_rows_held_for_a_time_that_varies_are_found(swing, draw):
    for lengths in (
        draw.integers(9, 12, 700),
        np.diff(np.ceil(np.arange(4900) * 1.25).astype(int)),
    ):
        log, measured = held(swing(draw, 1e-3), lengths)
        found = slow_sensor(log)
        assert found is not None
        assert found.measured.tolist() == measured.tolist()
        assert found.rate == pytest.approx(100.0 / lengths.mean(), rel=0.02)


def test_a_held_sensor_with_a_grid_below_its_motion_is_found(swing, draw):
    log, measured = held(swing(draw, 1e-3), np.full(601, 10))
    found = slow_sensor(replace(log, value=5e-4 * np.round(log.value / 5e-4)))
    assert found is not None
    assert np.count_nonzero(found.measured != measured) <= 2


@pytest.mark.parametrize("step", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3])
def test_a_coarse_sensor_is_not_slow_at_rest_nor_in_motion(swing, draw, step, noise):
    whole = swing(draw, noise)
    still = np.array([0.1, 0.2, -0.3]) + noise * draw.standard_normal((6000, 3))
    steady = 0.1 * whole.time[:, None] * np.ones(3) + noise * draw.standard_normal((6000, 3))
    for value in (whole.value, still, steady, np.r_[still[:3000], whole.value[3000:]]):
        for columns in (value, value[:, :1]):
            names = whole.columns[: columns.shape[1]]
            coarse = Series(whole.time, step * np.round(columns / step), names, "rad/s")
            assert slow_sensor(coarse) is None


def test_smooth_and_noisy_rows_are_measurements(swing, draw):
    for noise in (0.0, 1e-6, 1e-3):
        whole = swing(draw, noise)
        rest = np.where(whole.time[:, None] < 30.0, 0.0, whole.value)
        for value in (whole.value, rest, np.round(whole.value, 6)):
            assert slow_sensor(replace(whole, value=value)) is None


@pytest.mark.parametrize("every", [2.0, 5.0, 10.0, 7.3, 12.5])
def test_the_measurements_between_straight_lines_are_found(swing, draw, every):
    log, knots = joined(swing(draw, 1e-3), every)
    found = slow_sensor(log)
    assert found is not None
    assert found.interpolated
    assert found.rate == pytest.approx(100.0 / every, rel=0.01)
    instants = log.time[found.measured][1:-1]
    apart = np.abs(instants[:, None] - knots).min(axis=1)
    assert apart.max() <= 0.005 + 1e-9
    assert len(instants) >= 0.98 * (len(knots) - 2)


@pytest.mark.parametrize("along", ["components", "turn"])
def test_an_attitude_interpolated_either_way_is_found(draw, along):
    time = np.arange(3000) * 0.01
    turn = 0.3 * np.sin(2.0 * np.pi * np.array([0.1, 0.13, 0.17]) * time[::10, None])
    slow = rotation.from_rotation_vector(turn + 1e-3 * draw.standard_normal(turn.shape))
    part = (np.arange(2990) % 10 / 10.0)[:, None]
    before, after = slow[:-1].repeat(10, axis=0), slow[1:].repeat(10, axis=0)
    if along == "turn":
        step = rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(before), after))
        value = rotation.multiply(before, rotation.from_rotation_vector(part * step))
    else:
        value = (1.0 - part) * before + part * after
    found = slow_sensor(Series(time[:2990], value, ("w", "x", "y", "z"), "1"))
    assert found is not None
    assert np.flatnonzero(found.measured)[:-1].tolist() == list(range(0, 2990, 10))
