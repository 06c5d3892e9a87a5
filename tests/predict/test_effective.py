"""A torque held over each step moves a body along the path of the torque to the fourth order."""

import numpy as np
import pytest

from twin.predict.forces import _effective


def departure(step: float) -> float:
    """Of the second differences of the path of x'' = cos t, held step by step, relative."""
    time = step * np.arange(200)
    held = _effective(np.cos(time)[None, :, None])[0, :, 0]
    forced = 0.5 * step**2 * (held[1:] + held[:-1])
    exact = -np.diff(np.cos(time), 2)
    # the first and the last step extrapolate the curvature
    return float(np.abs(forced - exact)[2:-2].max() / np.abs(exact).max())


def test_half_the_step_leaves_a_sixteenth_of_the_departure():
    assert departure(0.2) / departure(0.1) == pytest.approx(16.0, rel=0.05)


def test_two_ends_alone_give_their_average():
    assert _effective(np.array([[[1.0], [3.0]]])) == pytest.approx(2.0)
