"""A sensor that hung is told from one that stands still, is slow, or is coarse."""

from dataclasses import replace

import numpy as np
import pytest

from twin.noise.stuck import stopped
from twin.recording import Series


def hung(series: Series, first: int, count: int) -> Series:
    """It repeats row `first` for so many rows."""
    value = series.value.copy()
    value[first + 1 : first + 1 + count] = value[first]
    return replace(series, value=value)


def test_all_that_a_hung_sensor_repeats_is_found_wherever_it_hung(swing, draw):
    whole = swing(draw, 1e-3)
    first, count = int(draw.integers(0, 5000)), int(draw.integers(10, 900))
    lost = stopped(hung(whole, first, count))
    assert np.flatnonzero(lost).tolist() == list(range(first + 1, first + 1 + count))


def test_a_sensor_that_hung_to_the_end_and_one_that_hung_often_are_found(swing, draw):
    whole = swing(draw, 1e-4)
    assert np.count_nonzero(stopped(hung(whole, 5000, 999))) == 999
    often = whole
    for first in range(100, 5900, 400):
        often = hung(often, first, 60)
    assert np.count_nonzero(stopped(often)) == 60 * len(range(100, 5900, 400))


@pytest.mark.parametrize("step", [0.0, 1e-4, 1e-3, 3e-3, 0.03])
@pytest.mark.parametrize("held", [1, 5])
def test_neither_a_grid_nor_a_sensor_slower_than_its_log_hangs(swing, draw, step, held):
    whole = swing(draw, 1e-3)
    value = np.repeat(whole.value[::held], held, axis=0)
    value[3000:] = value[3000] + 1e-3 * draw.standard_normal((3000, 3)).repeat(held, axis=0)[:3000]
    value = step * np.round(value / step) if step else value
    assert not stopped(replace(whole, value=value)).any()


def test_a_slow_sensor_that_hung_is_found(swing, draw):
    whole = swing(draw, 1e-3)
    slow = replace(whole, value=np.repeat(whole.value[::5], 5, axis=0))
    lost = stopped(hung(slow, 2000, 399))
    assert 390 <= np.count_nonzero(lost) <= 404


def test_wheels_that_coast_at_a_number_have_not_hung_and_those_that_leap_from_it_have(draw):
    time = np.arange(6000) * 0.01
    speed = 100.0 + np.interp(time, [0.0, 20.0, 30.0, 60.0], [0.0, 40.0, 40.0, 100.0])
    noise = 0.05 * draw.standard_normal(6000)
    noise[2000:3000] = 0.0
    wheel = Series(time, (speed + noise)[:, None], ("w1",), "rad/s")
    assert not stopped(wheel, steady=True).any()
    assert np.count_nonzero(stopped(hung(wheel, 4000, 500), steady=True)) == 500
