"""No code of a folder that somebody shared runs without being asked for by name."""

from pathlib import Path

import pytest

from tests.campaigns.conftest import GOOD
from twin.api import results
from twin.campaigns.folder import Folder
from twin.cli.main import main
from twin.errors import CampaignError, UsageError
from twin.files import trust_folders
from twin.library import library

HOSTILE = """
from pathlib import Path
Path({mark!r}).touch()
"""
EFFECT = """
from dataclasses import dataclass
from twin.effects.sensors.gyro_bias import GyroBias as Base
from twin.effects import parameter

@dataclass(frozen=True)
class Mine(Base):
    name = "mine"
"""


@pytest.fixture
def shared(tmp_path: Path) -> Path:
    """A colleague's folder: a specification, and a law that leaves a mark when it is imported."""
    folder = tmp_path / "shared"
    folder.mkdir()
    code = HOSTILE.format(mark=str(tmp_path / "ran"))
    law = (library("controllers") / "mass_magnetic_pid.py").read_text() + code
    (folder / "law.py").write_text(law)
    text = GOOD.replace('"mass_magnetic_pid"', f'"{folder / "law.py"}"')
    (folder / "spec.toml").write_text(text.replace("runs = 24", "runs = 2"))
    return folder


def ran(folder: Path) -> bool:
    return (folder.parent / "ran").exists()


@pytest.mark.parametrize("words", [["--dry-run"], ["OUT"]], ids=["dry run", "flown"])
def test_a_campaign_runs_no_law_that_only_its_file_names(shared, words, capsys):
    words = [str(shared / "out") if word == "OUT" else word for word in words]
    assert main(["campaign", str(shared / "spec.toml"), *words]) == 1
    told = capsys.readouterr().err
    assert "Python code that would run with your rights" in told
    assert f"say --trust {shared}" in told
    assert "spec.toml:4: controller is" in told
    assert not ran(shared)


def test_neither_report_nor_replay_runs_the_law_that_a_folder_names(shared, capsys):
    out = shared / "out"
    words = ["campaign", str(shared / "spec.toml"), str(out), "--workers", "1"]
    assert main([*words, "--trust", str(shared)]) == 0
    (shared.parent / "ran").unlink()
    moved = shared.parent / "received"
    shared.rename(moved)
    spec = Folder(moved / "out").spec
    spec.write_text(spec.read_text().replace(str(shared), str(moved)))
    code = (moved / "law.py").read_text()
    (moved / "law.py").write_text(code + "\n")
    for words in (["report", str(moved / "out")], ["replay", str(moved / "out"), "0"]):
        assert main(words) == 1
        assert f"say --trust {moved}" in capsys.readouterr().err
    with pytest.raises(CampaignError, match="Python code that would run"):
        results(moved / "out")
    assert not ran(shared)


def test_trust_in_one_folder_is_none_in_what_a_link_in_it_points_to(shared, tmp_path, capsys):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "law.py").symlink_to(shared / "law.py")
    spec = shared / "spec.toml"
    spec.write_text(spec.read_text().replace(str(shared / "law.py"), str(mine / "law.py")))
    assert main(["campaign", str(spec), "--dry-run", "--trust", str(mine)]) == 1
    assert "Python code" in capsys.readouterr().err
    assert not ran(shared)


def test_an_effect_that_only_a_campaign_names_does_not_run_either(shared, capsys):
    effect = shared / "effect.py"
    effect.write_text(EFFECT + HOSTILE.format(mark=str(shared.parent / "ran")))
    spec = shared / "spec.toml"
    text = spec.read_text().replace(f'"{shared / "law.py"}"', '"mass_magnetic_pid"')
    spec.write_text(text.replace("[effects.gyro_bias]", f'[effects."{effect}"]'))
    assert main(["campaign", str(spec), "--dry-run"]) == 1
    assert "Python code" in capsys.readouterr().err
    assert not ran(shared)


def test_a_folder_that_is_trusted_must_be_there(tmp_path):
    with pytest.raises(UsageError, match="there is no such folder; check the path"):
        trust_folders(tmp_path / "nowhere")
