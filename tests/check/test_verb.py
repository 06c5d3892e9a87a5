"""`twin check` by name: a machine, a control law, or neither."""

import json
from pathlib import Path

import pytest

from twin.cli.main import main
from twin.library import model_names
from twin.platform import load_platform


def test_a_name_that_is_not_there_is_wrong_use(capsys: pytest.CaptureFixture[str]):
    assert main(["check", "sadz"]) == 2
    assert "no platform named 'sadz' (did you mean 'sads'?)" in capsys.readouterr().err


def test_a_control_law_is_checked_by_the_same_verb(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["check", "quaternion_pd"]) == 0
    told = capsys.readouterr().out
    assert "keeps the contract on sads" in told, "who reads it should know what it holds for"
    assert "1 check, all ok" in told
    law = tmp_path / "empty.py"
    law.write_text('"""Nothing."""\n')
    assert main(["check", str(law), "--json"]) == 1
    (finding,) = json.loads(capsys.readouterr().out)
    assert str(law) in finding["sentence"]


FOUR_WHEELS = '''
"""A damper for a machine of four wheels."""

from dataclasses import dataclass

import numpy as np

from twin.controller import Controller


@dataclass(frozen=True)
class Damper(Controller[None]):
    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        return {"command_wheel_torque": np.zeros((len(estimate.valid), 4))}, state
'''


@pytest.mark.parametrize("columns", [3, 4])
def test_a_control_law_is_judged_on_the_machine_that_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], columns: int
):
    law = tmp_path / "damper.py"
    law.write_text(FOUR_WHEELS.replace("4)", f"{columns})"))
    four = next(
        name
        for name in model_names()
        if load_platform(name).commands.get("command_wheel_torque") == 4
    )
    assert main(["check", str(law)]) == int(columns != 3), "sads has three"
    capsys.readouterr()
    assert main(["check", str(law), "--platform", four]) == int(columns != 4)
    told = capsys.readouterr().out
    assert f"keeps the contract on {four}" in told
    assert columns == 4 or f"has 3 columns, and {four} has 4 wheels" in told


def test_a_machine_is_judged_on_no_other(capsys: pytest.CaptureFixture[str]):
    assert main(["check", "sads", "--platform", "astros"]) == 2
    assert "sads is none" in capsys.readouterr().err
    assert main(["check", "quaternion_pd", "--platform", "sadz"]) == 2
    assert "no platform named 'sadz'" in capsys.readouterr().err


def test_a_control_law_has_no_picture(capsys: pytest.CaptureFixture[str]):
    assert main(["check", "quaternion_pd", "--picture", "out.png"]) == 2
    assert "--picture draws platforms" in capsys.readouterr().err
