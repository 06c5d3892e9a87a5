"""A pulse a turn is read as the passages of a mark, not as an angle on a grid of 360 deg."""

import numpy as np
import pytest

from twin.noise import measure_noise
from twin.noise.cleaning import cleaned
from twin.recording import Recording, Series

TURN = 2.0 * np.pi


def course(draw: np.random.Generator, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Time and angle of a hinge that turns round and round for 60 s."""
    time = np.linspace(0.0, 60.0, 600_001)
    rate = draw.uniform(4.0, 9.0)
    if kind == "steady":
        return time, rate * time
    if kind == "slowing down":
        return time, rate * time - 0.4 * rate / 60.0 * time**2
    return time, rate * 25.0 * np.sin(time / 12.0)  # and back


@pytest.mark.parametrize("kind", ["steady", "slowing down", "back again"])
@pytest.mark.parametrize("at", ["a clock", "the pulses"])
def test_the_angle_is_known_where_the_count_changes(kind: str, at: str, draw):
    fine, angle = course(draw, kind)
    count = np.floor(angle / TURN)
    if at == "a clock":
        rows = np.arange(0, len(fine), 100)  # 100 Hz
    else:
        rows = np.r_[0, np.flatnonzero(np.diff(count)) + 1]
    value = (TURN * count[rows])[:, None]
    series = Series(fine[rows], value, ("axle",), "rad")
    found = cleaned(Recording({"joint_angle": series}, {"kind": "log"}), all_axes=False)
    passages = found["joint_angle"]
    assert len(passages) == np.count_nonzero(np.diff(count[rows]))
    assert any("counts whole turns" in said for said in found.repairs)
    true = np.interp(passages.time, fine, angle)
    fastest = np.abs(np.gradient(angle, fine)).max()
    interval = 0.01 if at == "a clock" else 1e-4
    assert np.abs(passages.value[:, 0] - true).max() < fastest * interval
    noise = measure_noise(passages)
    assert not noise.quantised.any()
    assert noise.white[0] < 0.1 * TURN / np.sqrt(12.0)


@pytest.mark.parametrize("step", [TURN / 4096.0, TURN / 360.0, TURN / 4.0])
def test_an_encoder_with_steps_within_a_turn_keeps_its_grid(step: float, draw):
    fine, angle = course(draw, "slowing down")
    rows = np.arange(0, len(fine), 100)
    value = step * np.round(angle[rows] / step)
    series = Series(fine[rows], value[:, None], ("axle",), "rad")
    found = cleaned(Recording({"joint_angle": series}, {"kind": "log"}), all_axes=False)
    assert not [said for said in found.repairs if "counts whole turns" in said]
    np.testing.assert_array_equal(found["joint_angle"].value, value[:, None])
