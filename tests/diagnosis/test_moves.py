"""What is known of an effect's numbers that no log shows."""

import numpy as np

from twin.diagnosis.explanation import largest, usual
from twin.effects import effect_named, parse_effects


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
