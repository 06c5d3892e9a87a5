"""The catalogue has the effects that the design promises, with their numbers and units.

Each of them is found again where it is hidden, to within its interval:
`pytest -m "slow or not slow" -s tests/predict/test_effect_columns.py tests/effects/test_refit.py
tests/effects/test_floor.py` prints truth, estimate and interval of every component.
"""

import re
from pathlib import Path

import pytest

from tests.effects import test_floor as floor
from tests.effects import test_refit as anew
from tests.predict import test_effect_columns as columns
from twin.effects import catalogue, parse_effects

DESIGN = (Path(__file__).parents[2] / "docs" / "design.md").read_text(encoding="utf-8")
TABLE = DESIGN[DESIGN.index("### 4.4") : DESIGN.index("### 4.5")]
ENTRY = re.compile(r"`(?P<name>\w+)`(?P<rest>[^`|]*)")
PROMISED = {
    found["name"]: found["rest"]
    for row in re.findall(r"^\| (`.*?) \|", TABLE, re.MULTILINE)
    for found in ENTRY.finditer(row)
}
BUILT = {kind.name: kind for kind in catalogue()}
IN_WORDS = {
    "stage_vibration": ["(rad/s)/(m/s)"],
    "structural_sag": ["kg m/(m/s2)"],
    "wheel_imbalance": ["kg m", "kg m2"],
}
"""Units that the table puts another way."""


def test_the_table_is_found():
    assert len(PROMISED) > 40


def test_the_catalogue_holds_what_the_design_names_and_nothing_else():
    assert set(BUILT) == set(PROMISED)


@pytest.mark.parametrize("name", BUILT)
def test_an_effect_of_the_design_has_its_size_and_units(name):
    kind, rest = BUILT[name], PROMISED[name]
    units = [known.unit.replace("^", "") for known in kind.parameters()]
    count = re.search(r"\((\d)\)", rest)
    if count:
        assert [known.size for known in kind.parameters()] == [int(count[1])]
    stated = re.search(r"\[([^\]]+)\]", rest)
    if name in IN_WORDS:
        assert units == IN_WORDS[name]
    elif stated:
        named = [part.split(",")[0].strip() for part in [stated[1]]]
        wanted = stated[1].split(", ") if len(units) > 1 else named
        assert units == ["1" if unit == "-" else unit for unit in wanted]


def test_every_effect_is_hidden_and_found_in_a_recovery_test():
    by_columns = [*columns.HIDDEN, *columns.ON_PARTS, *columns.RINGING]
    hidden = [*by_columns, *anew.HIDDEN, *anew.SCATTERED, *floor.HIDDEN.values()]
    found = {effect.name for text in hidden for effect in parse_effects(text)}
    # a frequency is found at a line of the residual, and not from nearby values
    at_lines = {"gyro_vibration", "joint_rate_vibration"}  # tests/diagnosis: lines, dry_friction
    assert found | at_lines == set(BUILT)


def test_a_lag_is_called_lag():
    assert [known.name for known in BUILT["clock_lag"].parameters()] == ["lag"]
