"""Samples off the course of a stream are found; whatever a machine can do is none of them."""

from dataclasses import replace

import numpy as np
import pytest

from twin import rotation
from twin.noise.cleaning import glitches
from twin.recording import Series


@pytest.fixture
def turning(draw) -> Series:
    """An attitude that swings by 20 deg, with noise of 1 mrad."""
    time = np.arange(3000) * 0.02
    turn = 0.35 * np.sin(2.0 * np.pi * np.array([0.1, 0.13, 0.17]) * time[:, None])
    turn += 1e-3 * draw.standard_normal(turn.shape)
    return Series(time, rotation.from_rotation_vector(turn), ("w", "x", "y", "z"), "1")


def test_single_samples_far_off_are_found_in_one_column_or_in_all(swing, draw):
    whole = swing(draw, 1e-3)
    where = np.sort(draw.choice(np.arange(10, 5990, 10), 40, replace=False))
    value = whole.value.copy()
    value[where[:20], 1] += draw.choice([-1.0, 1.0], 20) * draw.uniform(0.1, 100.0, 20)
    value[where[20:]] = draw.uniform(1.0, 100.0, (20, 3))
    assert np.flatnonzero(glitches(replace(whole, value=value))).tolist() == where.tolist()


def test_most_of_what_is_scattered_at_random_over_a_percent_is_found(swing, draw):
    whole = swing(draw, 1e-3)
    where = draw.random(6000) < 0.01
    value = np.where(where[:, None], draw.uniform(-3.0, 3.0, (6000, 3)), whole.value)
    found = glitches(replace(whole, value=value))
    assert np.count_nonzero(found & ~where) == 0
    assert np.count_nonzero(found) >= 0.9 * np.count_nonzero(where)


def test_an_attitude_that_was_another_markers_for_a_tenth_of_a_second_is_found(turning, draw):
    flip = rotation.from_rotation_vector(draw.uniform(0.5, 2.0, 3))
    value = turning.value.copy()
    value[1000:1005] = rotation.multiply(value[1000:1005], flip)
    assert np.flatnonzero(glitches(replace(turning, value=value))).tolist() == [*range(1000, 1005)]


def test_the_two_signs_of_a_quaternion_are_one_attitude(turning):
    value = turning.value.copy()
    value[500:504] *= -1.0
    assert not glitches(replace(turning, value=value)).any()


def test_what_a_machine_does_is_no_glitch(swing, draw):
    whole = swing(draw, 1e-3)
    time = whole.time[:, None]
    pushed = whole.value + 0.5 * (time > 20.0) - 0.8 * (time > 40.0)
    shaken = whole.value + 0.3 * np.sin(60.0 * time) * ((time > 20.0) & (time < 20.6))
    still = np.where(time < 50.0, 1e-3 * draw.standard_normal((6000, 3)), pushed)
    for value in (whole.value, pushed, shaken, still):
        assert not glitches(replace(whole, value=value)).any()


@pytest.mark.parametrize("count", [1, 2, 5, 8, 9, 12])
def test_a_stream_of_a_few_rows_has_none(swing, draw, count):
    assert not glitches(swing(draw, 1e-3, count)).any()
