"""What a person reads of an identification: every parameter, how well excited, what is open."""

from dataclasses import replace

import numpy as np
import pytest

from twin.errors import UsageError
from twin.identification import identify
from twin.identification.excitation import excitation_of
from twin.identification.track import raw_motion
from twin.model import compile_model
from twin.platform import taken_as_at_rest
from twin.predict.base import base_parameters
from twin.predict.logs import motion_of
from twin.recording import Recording
from twin.report import compared, identified


@pytest.fixture(scope="module")
def lines(campaign) -> list[str]:
    return identified(identify(campaign.logs, campaign.stated, "momentum"))


def test_the_nine_parameters_stand_with_their_intervals(lines):
    names = ("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz", "m r_x", "m r_y", "m r_z")
    for name in names:
        (line,) = [line for line in lines if line.strip().startswith(name)]
        assert " +- " in line


def test_the_excitation_is_said_and_what_no_log_can_tell(lines):
    text = "\n".join(lines)
    assert "deg/s rms about x, y, z; tilt up to" in text
    assert "Least known of J: " in text
    assert "Not identifiable: one common scale" in text


def test_wheels_of_which_no_log_says_anything_are_said_to_be_taken_as_at_rest(campaign):
    found = identify(campaign.logs[:1], campaign.stated, "momentum")
    (log,) = found.recordings
    seen = {name: log[name] for name in ("gyro", "attitude")}
    found = replace(found, recordings=(Recording(seen, {"kind": "log"}),))
    said = [line for line in identified(found) if "taken as at rest" in line]
    assert [line.strip() for line in said] == found.document()["taken_as_at_rest"][:1]


def test_wheels_whose_drive_nobody_recorded_are_said_to_be_taken_as_driven_by_noise(campaign):
    found = identify(campaign.logs[:1], campaign.stated, "momentum")
    (log,) = found.recordings
    driven = Recording(dict(log.items()), {"kind": "log"})
    undriven = Recording({n: log[n] for n in ("gyro", "attitude", "wheel_speed")}, {"kind": "log"})
    said = [taken_as_at_rest([one], campaign.stated) for one in (driven, undriven)]
    assert not any("white noise" in line for line in said[0])
    (line,) = [line for line in said[1] if "white noise" in line]
    assert "Add command_wheel_torque or command_wheel_duty" in line


def test_what_several_methods_lack_is_said_once_with_both_streams(campaign):
    seen = Recording({"gyro": campaign.logs[0]["gyro"]}, {"kind": "log"})
    with pytest.raises(UsageError) as problem:
        raw_motion(seen, "ball")
    assert "no 'attitude': " in str(problem.value)
    assert "both 'gyro' and 'attitude', of which prediction-error needs one" in str(problem.value)
    found = identify(campaign.logs[:1], campaign.stated, "momentum")
    other = UsageError("another sentence")
    lines = compared({"a": found, "b": problem.value, "c": problem.value, "d": other})
    assert f"b, c: {problem.value}." in lines
    assert "d: another sentence." in lines


def test_the_combination_of_moments_that_is_known_worst_is_named(campaign):
    base = base_parameters(compile_model(campaign.stated))
    motions = [motion_of(campaign.logs[0], campaign.stated)]
    # of Jxx and Jyy the sum is known ten times worse than the rest
    sum_of_two = np.array([1.0, 1.0, 0, 0, 0, 0, 0, 0, 0]) / np.sqrt(2.0)
    covariance = 1e-4 * np.eye(9) + 99e-4 * np.outer(sum_of_two, sum_of_two)
    found = excitation_of(motions, base, covariance, 2.0)
    assert found.least_known == pytest.approx({"Jxx": np.sqrt(0.5), "Jyy": np.sqrt(0.5)})
    assert found.condition == pytest.approx(10.0)
    # 27 kg m2 in all
    assert found.half_width == pytest.approx(2.0 * 0.1 / 9.0)
