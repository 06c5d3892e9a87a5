"""Units of measured files become SI, and numbers are printed as people write them."""

import math

import pytest

from twin.errors import UnknownName
from twin.units import as_precise, printed, unit_named


@pytest.mark.parametrize(
    ("text", "value", "si"),
    [
        ("deg/s", math.pi / 180.0, "rad/s"),
        ("°/s", math.pi / 180.0, "rad/s"),
        ("rpm", 2.0 * math.pi / 60.0, "rad/s"),
        ("mrad/s", 1e-3, "rad/s"),
        ("g", 9.80665, "m/s^2"),
        ("m/s²", 1.0, "m/s^2"),
        ("µT", 1e-6, "T"),
        ("G", 1e-4, "T"),
        ("um", 1e-6, "m"),
        ("mN m", 1e-3, "N m"),
        ("mNm", 1e-3, "N m"),
        ("us", 1e-6, "s"),
        ("V", 1.0, "V"),
    ],
)
def test_one_of_a_unit_is_so_much_in_si(text: str, value: float, si: str):
    unit = unit_named(text)
    assert (unit.si, unit.offset) == (si, 0.0)
    assert unit.factor == pytest.approx(value, rel=1e-15)


def test_degrees_celsius_count_from_freezing():
    unit = unit_named("degC")
    assert unit.factor * 25.0 + unit.offset == pytest.approx(298.15)


def test_an_unknown_unit_names_its_neighbours():
    with pytest.raises(UnknownName, match=r"no unit named 'deg/sx' \(did you mean 'deg/s'"):
        unit_named("deg/sx")


@pytest.mark.parametrize(
    ("value", "si", "text"),
    [
        (0.1523, "N m", "0.152 N m"),
        (0.0152, "N m", "15.2 mN m"),
        (3.2e-6, "N m", "3.2 uN m"),
        (0.5, "rad", "28.6 deg"),
        (0.0071, "s", "7.1 ms"),
        (0.27, "1", "0.27"),
        (12345.0, "N", "12345 N"),
    ],
)
def test_numbers_are_printed_with_three_digits_in_a_fitting_unit(value: float, si: str, text: str):
    assert printed(value, si) == text


def test_a_number_has_as_many_digits_as_its_interval_asks_for():
    assert as_precise(53.0004, 0.0018) == "53.000"
    assert as_precise(0.171234, 0.0034) == "0.171"
    assert as_precise(1234.4, 25.0) == "1234"
    assert as_precise(12.0, math.nan) == "12"
    assert as_precise(-0.00012345, 1e-7) == "-0.0001234"
