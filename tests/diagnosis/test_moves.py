"""What is known of an effect's numbers that no log shows."""

from dataclasses import replace

import numpy as np

from twin.contrast import moved
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.explanation import largest, usual
from twin.diagnosis.starts import fitted
from twin.effects import effect_named, parse_effects
from twin.platform import load_platform


def test_numbers_of_two_units_are_as_large_as_each_other_by_what_each_is_usually_like():
    (friction,) = parse_effects("wheel_friction:w1=2e-5/0")
    kind = effect_named("wheel_friction")
    viscous, _ = kind.typical("w1").values
    seen = np.array([True, False])
    assert largest(friction, seen) == 2e-5 / viscous
    np.testing.assert_array_equal(usual(friction), kind.scale())


def test_of_a_vector_each_is_as_large_as_the_largest():
    (bias,) = parse_effects("gyro_bias=1e-3/0/0")
    assert len(set(usual(bias).tolist())) == 1
    assert largest(bias, np.array([True, False, False])) * usual(bias)[1] == 1e-3


def test_a_fit_that_begins_at_a_base_of_no_such_machine_begins_again_at_the_stated_one():
    sads = load_platform("sads")
    cable = parse_effects("harness_stiffness=0.05")
    baseline = baseline_of([moved(sads, cable, 20.0, seed=3).without_truth()], sads)
    theta = baseline.base.as_stated.copy()
    theta[-1] = -0.6  # of m r_z, which is -0.003 kg m
    away = baseline.problem.innovations(replace(baseline.at, theta=theta))
    found = fitted(replace(baseline, prediction=away), cable)
    assert found is not None
    assert found.converged
    assert abs(found.effects[0].values[0] - 0.05) < 3.0 * np.sqrt(found.covariances[0][0, 0])
    assert abs(found.at.theta[-1] - baseline.base.as_stated[-1]) < 1e-4
