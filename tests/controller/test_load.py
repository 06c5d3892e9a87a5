"""A law is a file: what loading it promises, and what it says when the file is no law."""

import sys

import pytest

from twin.controller import Controller, load_controller
from twin.errors import ControllerError, UnknownName

LAW = """
from dataclasses import dataclass, field
import numpy as np
from twin.controller import Controller

@dataclass(frozen=True)
class Rest(Controller[None]):
    gain: float = field(default=2.0, metadata={"unit": "N m s"})

    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        return {"command_wheel_torque": self.gain * estimate.rate_body}, state
"""


@pytest.fixture
def write(tmp_path):
    def write(text, name="law.py"):
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return write


@pytest.mark.parametrize("name", ["quaternion_pd", "mass_pid"])
def test_shipped_law_loads_by_name(name):
    assert isinstance(load_controller(name), Controller)


def test_law_loads_by_path_with_its_gains(write):
    path = write(LAW)
    assert load_controller(path).gain == 2.0
    assert load_controller(path, {"gain": 3.0}).gain == 3.0


def test_two_files_of_one_name_do_not_meet_and_no_public_module_appears(write, tmp_path):
    (tmp_path / "other").mkdir()
    here, there = write(LAW), write(LAW.replace("2.0", "7.0"), "other/law.py")
    laws = load_controller(here), load_controller(there)
    assert [law.gain for law in laws] == [2.0, 7.0]
    assert type(laws[0]).__module__ != type(laws[1]).__module__
    assert "law" not in sys.modules


def test_unknown_law_and_unknown_gain_say_what_was_probably_meant(write):
    with pytest.raises(UnknownName, match="did you mean 'quaternion_pd'"):
        load_controller("quaternion_pid")
    with pytest.raises(UnknownName, match="no gain named 'gian' .did you mean 'gain'"):
        load_controller(write(LAW), {"gian": 1.0})


@pytest.mark.parametrize("value", ["5", True, float("nan"), float("inf"), [1.0], None])
def test_gain_that_is_no_number_is_refused_with_its_unit(write, value):
    with pytest.raises(ControllerError, match=": gain is .*; give a finite number in N m s"):
        load_controller(write(LAW), {"gain": value})


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", r"defines 0 subclasses .* \(none\)"),
        (LAW + "\nclass Second(Rest): pass\n", r"defines 2 subclasses .* \(Rest, Second\)"),
        ("import numpy\n\n1 / 0\n", "line 3: ZeroDivisionError: division by zero"),
        ("x = (\n", "line 1: SyntaxError: '.' was never closed"),
        ("import no_such_module\n", "line 1: ModuleNotFoundError: No module named"),
        ("import sys\nsys.exit(3)\n", "line 2: SystemExit: 3"),
        (LAW.replace("@dataclass(frozen=True)", ""), "Rest is no dataclass"),
        (LAW.replace("def update", "def step"), "Rest lacks update; add it"),
        (LAW.replace("default=2.0, ", ""), ": gain has no default; give it a value"),
        (
            LAW + "\n    def __post_init__(self):\n        raise ValueError('too soft')\n",
            "line 17: ValueError: too soft",
        ),
    ],
    ids=lambda value: value if "\n" not in value else "",
)
def test_file_that_is_no_law_is_told_so(write, text, sentence):
    with pytest.raises(ControllerError, match=sentence):
        load_controller(write(text))


def test_law_that_cannot_be_imported_leaves_no_module_behind(write):
    before = set(sys.modules)
    with pytest.raises(ControllerError):
        load_controller(write("1 / 0\n"))
    assert set(sys.modules) == before
