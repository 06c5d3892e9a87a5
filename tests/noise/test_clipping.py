"""The end of a range is found from the data; rest, grids and honest maxima are none."""

from dataclasses import replace

import numpy as np
import pytest

from twin.noise.cleaning import cleaned
from twin.noise.stuck import range_ends
from twin.recording import Recording, Series


def clipped(series: Series, low: float, high: float) -> Series:
    return replace(series, value=np.clip(series.value, low, high))


@pytest.mark.parametrize("end", [0.02, 0.045, 0.049])
@pytest.mark.parametrize("grid", [0.0, 1e-4])
def test_all_rows_at_an_end_and_no_others_are_found(swing, draw, end, grid):
    whole = swing(draw, 1e-3)
    if grid:
        whole = replace(whole, value=grid * np.round(whole.value / grid))
    found = range_ends(clipped(whole, -end, end))
    assert found.rows.tolist() == (np.abs(whole.value) >= end).any(axis=1).tolist()
    assert found.ends == pytest.approx((-end, end))


def test_one_end_of_one_axis_is_found(swing, draw):
    whole = swing(draw, 1e-3)
    value = whole.value.copy()
    value[:, 1] = np.minimum(value[:, 1], 0.03)
    found = range_ends(replace(whole, value=value))
    assert found.rows.tolist() == (whole.value[:, 1] >= 0.03).tolist()
    assert found.ends == (0.03,)


def test_one_long_stretch_at_the_end_is_no_sensor_that_hung(swing, draw):
    whole = swing(draw, 1e-3)
    rate = 4.4 * np.exp(-((whole.time - 20.0) ** 2) / 200.0)[:, None] + whole.value[:, :1]
    joint = Series(whole.time, np.minimum(rate, 3.5), ("axis",), "rad/s")
    log = cleaned(Recording({"joint_rate": joint}, {}))
    count = np.count_nonzero(rate >= 3.5)
    assert log.repairs == (
        f"{count} of 6000 samples of joint_rate ({count / 60.0:.2g} %) are at 201 deg/s, the end "
        "of its range, and are not used, nor are those next to them",
    )
    assert 6000 - len(log["joint_rate"]) == np.count_nonzero(
        np.convolve(rate[:, 0] >= 3.5, np.ones(7), mode="same") > 0.5
    )


def test_a_held_sensor_is_at_its_end_when_it_stays_there(swing, draw):
    whole = swing(draw, 1e-3)
    slow = replace(whole, value=whole.value[::10].repeat(10, axis=0))
    assert not range_ends(slow).rows.any()
    ends = range_ends(clipped(slow, -0.04, 0.04))
    assert ends.rows.tolist() == (np.abs(slow.value) >= 0.04).any(axis=1).tolist()


def test_a_sensor_that_hung_at_its_largest_value_is_not_at_its_end(swing, draw):
    whole = swing(draw, 1e-3)
    first = int(np.argmax(whole.value[:5000, 0]))
    value = whole.value.copy()
    value[first : first + 300] = value[first]
    assert not range_ends(replace(whole, value=value)).rows.any()


@pytest.mark.parametrize("grid", [0.0, 1e-4, 1e-3, 5e-3, 0.03])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3])
def test_a_motion_within_the_range_has_no_end(swing, draw, grid, noise):
    whole = swing(draw, noise)
    rest = np.where(
        whole.time[:, None] < 30.0, noise * draw.standard_normal((6000, 3)), whole.value
    )
    up = np.interp(whole.time, [0.0, 20.0, 30.0, 50.0, 60.0], [0.0, 0.0, 0.2, 0.2, 0.0])
    coasting = up[:, None] + noise * draw.standard_normal((6000, 3))
    away = np.abs(whole.value)
    for value in (whole.value, rest, coasting, away):
        value = grid * np.round(value / grid) if grid else value
        assert range_ends(replace(whole, value=value)).ends == ()
