"""A value that passed its protocol's check is still held against what its sensor can measure."""

import math

from twin.plant.devices.sensor import Believable


def test_where_steps_are_bounded_a_first_value_that_nothing_supports_is_not_believed():
    checks = Believable(limit=20.0, frozen_after=0, largest_step=0.1)
    assert checks.doubt((0.0, 0.0, 5.6e-37)).startswith("the first")
    assert checks.doubt((0.0, 0.0, 9.81)).startswith("leapt by 9.81")
    assert checks.doubt((0.0, 0.0, 9.82)) == ""


def test_where_steps_are_not_bounded_the_first_value_is_believed():
    assert Believable(limit=20.0, frozen_after=0).doubt((0.0, 0.0, 9.81)) == ""


def test_what_is_no_number_or_at_full_scale_is_not_believed():
    checks = Believable(limit=20.0, frozen_after=0)
    assert checks.doubt((math.nan,)) == "not a number"
    assert checks.doubt((20.0,)).startswith("saturated")


def test_the_value_that_is_the_nth_alike_is_doubted_whether_it_is_one_object_or_several():
    one = (1.0, 2.0)
    for values in ([one] * 4, [(1.0, 2.0), (1.0, 2.0), (1.0, 2.0), (1.0, 2.0)]):
        checks = Believable(limit=20.0, frozen_after=3)
        doubts = [checks.doubt(value) for value in values]
        assert doubts[:2] == ["", ""]
        assert "the same for 3 samples" in doubts[2]
        assert checks.doubt((1.0, 2.5)) == ""
