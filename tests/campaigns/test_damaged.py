"""A campaign's folder with a damaged file is refused by whoever reads it, in a sentence."""

import shutil
from pathlib import Path

import pytest

from tests.campaigns.conftest import GOOD
from twin.cli.main import main

VERBS = {
    "fly on": ["campaign", "spec.toml", "out", "--resume", "--workers", "1"],
    "report": ["report", "out"],
    "replay": ["replay", "out", "0"],
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a campaign with a recording was flown."""
    place = tmp_path_factory.mktemp("whole")
    keep = '\n[keep]\nworst = 1\nby = "in_plane_rms"\n'
    spec = GOOD.replace("duration = 1.0", "duration = 0.1") + keep
    (place / "spec.toml").write_text(spec, encoding="utf-8")
    with pytest.MonkeyPatch.context() as here:
        here.chdir(place)
        assert main(VERBS["fly on"]) == 0
    return place


@pytest.fixture
def flown(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of its folder, for one test."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "out"


@pytest.mark.parametrize("verb", VERBS)
def test_a_shard_that_was_cut_short_is_named(flown, capsys, verb):
    shard = min((flown / "metrics").iterdir())
    shard.write_bytes(shard.read_bytes()[:-100])
    assert main(VERBS[verb]) == 1
    told = capsys.readouterr().err
    assert f"{shard.name}: cannot be read" in told
    assert "remove it and --resume" in told


def test_facts_that_were_lost_are_named(flown, capsys):
    (flown / "campaign.json").write_text("")
    assert main(VERBS["fly on"]) == 1
    assert "campaign.json: cannot be read" in capsys.readouterr().err
