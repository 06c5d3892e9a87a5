"""One axis that is stuck is told from one that is at rest, coarse, slow or out of its range."""

from dataclasses import replace

import numpy as np
import pytest

from twin.noise.cleaning import cleaned
from twin.noise.stuck import dead_axes, range_ends, stuck_rows
from twin.recording import Recording, Series


def stuck_at(series: Series, column: int, rows: slice, value: float | None = None) -> Series:
    """An axis keeps a value, or the one it has at the first row."""
    changed = series.value.copy()
    changed[rows, column] = changed[rows, column][0] if value is None else value
    return replace(series, value=changed)


@pytest.mark.parametrize("value", [None, 0.0])
@pytest.mark.parametrize("grid", [0.0, 1e-3])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.8])
def test_the_rows_in_which_one_axis_is_stuck_are_found(swing, draw, value, grid, share):
    whole = swing(draw, 1e-3)
    column, first = int(draw.integers(3)), int(draw.integers(1, 1000))
    rows = slice(first, first + int(share * 6000))
    bad = stuck_at(whole, column, rows, value)
    if grid:
        bad = replace(bad, value=grid * np.round(bad.value / grid))
    found = stuck_rows(bad)
    expected = np.zeros((6000, 3), dtype=np.bool_)
    expected[rows, column] = True
    # on a grid the rows next to the stretch may hold its value too
    assert np.count_nonzero(found != expected) <= (4 if grid else 0)
    assert dead_axes(bad) == ()


def test_such_rows_are_left_out_and_said(swing, draw):
    bad = stuck_at(swing(draw, 1e-3), 1, slice(1000, 2000))
    log = cleaned(Recording({"gyro": bad}, {}))
    assert len(log["gyro"]) == 5000
    assert log.repairs == (
        "1000 of 6000 samples of gyro, from 10 to 19.99 s, have y stuck at one value while the "
        "other axes scatter, and are not used",
    )


def test_an_axis_that_is_stuck_at_its_largest_value_is_not_at_the_end_of_its_range(swing, draw):
    whole = swing(draw, 1e-3)
    # the noise makes the largest of the rows near the top of the swing the one that stays
    first = 500 + int(whole.value[500:3000, 1].argmax())
    bad = stuck_at(whole, 1, slice(first, first + 500))
    assert bad.value[:, 1].max() > bad.value[first + 500, 1]
    assert not range_ends(bad).rows.any()
    (sentence,) = cleaned(Recording({"gyro": bad}, {})).repairs
    assert "have y stuck at one value" in sentence


@pytest.mark.parametrize("rows", [slice(0, 6000), slice(300, 6000)])
def test_a_sensor_with_a_dead_axis_is_not_used_beside_an_attitude(swing, draw, rows):
    bad = stuck_at(swing(draw, 1e-3), 2, rows, 0.0)
    assert dead_axes(bad) == ("z",)
    attitude = Series(bad.time[:2], np.eye(4)[:2], ("w", "x", "y", "z"), "1")
    log = cleaned(Recording({"gyro": bad, "attitude": attitude}, {}))
    assert "gyro" not in log
    assert log.repairs == (
        "gyro z keeps one value in nearly all rows while other axes scatter: gyro is not used",
    )
    # where the body turns about one axis, or nothing else shows the motion, it stays
    both = Recording({"gyro": bad, "attitude": attitude}, {})
    assert "gyro" in cleaned(both, all_axes=False)
    assert "gyro" in cleaned(Recording({"gyro": bad}, {}))


def test_a_sensor_that_hung_in_all_axes_has_no_stuck_axis(swing, draw):
    whole = swing(draw, 1e-3)
    value = whole.value.copy()
    value[1000:2000] = value[1000]
    assert not stuck_rows(replace(whole, value=value)).any()


@pytest.mark.parametrize("grid", [0.0, 1e-4, 1e-3, 0.01, 0.03])
@pytest.mark.parametrize(
    ("noise", "held"), [(0.0, 1), (1e-4, 1), (1e-3, 1), (1e-4, 10), (1e-3, 10)]
)
def test_an_axis_at_rest_a_coarse_one_and_a_slow_one_are_not_stuck(swing, draw, grid, noise, held):
    whole = swing(draw, noise)
    value = whole.value.copy()
    value[:, 2] = 0.02 + noise * draw.standard_normal(6000)
    value[:3000, 1] = noise * draw.standard_normal(3000)
    value = value[::held].repeat(held, axis=0)
    value = grid * np.round(value / grid) if grid else value
    assert not stuck_rows(replace(whole, value=value)).any()
    assert dead_axes(replace(whole, value=value)) == ()
