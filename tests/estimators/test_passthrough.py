"""Pass-through: the newest valid sample, and nothing else."""

import dataclasses

import numpy as np
import pytest

from twin.errors import UnknownName
from twin.estimators import AttitudeFilter, Passthrough, load_estimator
from twin.signals import Reading, Samples


def samples(value, valid=None):
    value = np.array(value, dtype=float)
    n, m = value.shape[:2]
    valid = np.ones((n, m), dtype=bool) if valid is None else np.array(valid)
    return Samples(value, np.tile(0.01 * np.arange(m), (n, 1)), valid)


def test_newest_valid_sample_of_each_run_is_the_estimate(platform):
    law = Passthrough()
    value = np.arange(36.0).reshape(3, 4, 3)
    valid = [[True] * 4, [True, True, False, False], [False] * 4]
    first = law.update(law.init(platform, 3), Reading(0.05, {"gyro": samples(value, valid)}))
    np.testing.assert_array_equal(first.rate_body, [value[0, 3], value[1, 1], [0.0, 0.0, 0.0]])
    assert first.time == 0.05


def test_what_no_sample_came_for_is_held(platform):
    law = Passthrough()
    speeds = Reading(0.05, {"wheel_speed": samples([[[1.0, 2.0, 3.0]]])})
    estimate = law.update(law.init(platform, 1), speeds)
    estimate = law.update(estimate, Reading(0.10, {}))
    np.testing.assert_array_equal(estimate.wheel_speed, [[1.0, 2.0, 3.0]])
    assert estimate.time == 0.10


def test_run_is_valid_from_its_first_attitude(platform):
    law = Passthrough()
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (2, 2, 1))
    estimate = law.init(platform, 2)
    seen = []
    for valid in ([[False, False], [False, False]], [[True, False], [False, False]], None):
        reading = Reading(0.0, {"attitude": samples(attitude, valid)})
        estimate = law.update(estimate, reading)
        seen.append(estimate.valid.tolist())
    assert seen == [[False, False], [True, False], [True, True]]


def test_hinge_is_seen_by_its_angle(platform):
    hinge = dataclasses.replace(platform, base=dataclasses.replace(platform.base, kind="hinge"))
    law = Passthrough()
    reading = Reading(0.0, {"joint_angle": samples([[[0.3]]]), "joint_rate": samples([[[0.1]]])})
    estimate = law.update(law.init(hinge, 1), reading)
    assert estimate.valid.all()
    assert (estimate.joint_angle, estimate.joint_rate) == (0.3, 0.1)


def test_estimators_load_by_name():
    assert load_estimator("filter") == AttitudeFilter()
    assert load_estimator("passthrough") == Passthrough()
    with pytest.raises(UnknownName, match="did you mean 'filter'"):
        load_estimator("fliter")
