"""`twin check` by name: a machine, a control law, or neither."""

import json
from pathlib import Path

import pytest

from twin.cli.main import main


def test_a_name_that_is_not_there_is_wrong_use(capsys: pytest.CaptureFixture[str]):
    assert main(["check", "sadz"]) == 2
    assert "no platform named 'sadz' (did you mean 'sads'?)" in capsys.readouterr().err


def test_a_control_law_is_checked_by_the_same_verb(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["check", "quaternion_pd"]) == 0
    assert "1 check, all ok" in capsys.readouterr().out
    law = tmp_path / "empty.py"
    law.write_text('"""Nothing."""\n')
    assert main(["check", str(law), "--json"]) == 1
    (finding,) = json.loads(capsys.readouterr().out)
    assert str(law) in finding["sentence"]


def test_a_control_law_has_no_picture(capsys: pytest.CaptureFixture[str]):
    assert main(["check", "quaternion_pd", "--picture", "out.png"]) == 2
    assert "--picture draws platforms" in capsys.readouterr().err
