"""The page of deviations and tolerances is complete, and claims no more than was measured."""

import re
from pathlib import Path

import pytest

from twin.effects import catalogue

PAGE = (Path(__file__).parents[2] / "docs" / "fidelity.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (.+) \| (\d\S+) \| (\d\S+) \|", PAGE, re.MULTILINE)


@pytest.mark.parametrize("name", [kind.name for kind in catalogue()])
def test_every_effect_is_held_to_something_that_is_not_itself(name: str):
    own = [what for what, _, _ in ROWS if re.match(rf"{name}\b", what)]
    assert [what for what in own if what != name], "no closed form, no other code"


def test_no_tolerance_is_looser_than_ten_times_what_is_measured():
    assert len(ROWS) > 100
    loose = [
        what
        for what, deviation, tolerance in ROWS
        if float(tolerance) > max(10.5 * float(deviation), 1e-11)  # both are rounded on the page
    ]
    assert loose == []
    assert [what for what, deviation, limit in ROWS if float(deviation) > float(limit)] == []
