"""A campaign's folder with a damaged file is refused by whoever reads it, in a sentence."""

from pathlib import Path

import pytest

from tests.campaign.conftest import GOOD
from twin.cli.main import main

VERBS = {
    "fly on": ["campaign", "spec.toml", "out", "--resume"],
    "report": ["report", "out"],
    "replay": ["replay", "out", "0"],
}


@pytest.fixture
def flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which a campaign with a recording was flown."""
    monkeypatch.chdir(tmp_path)
    keep = '\n[keep]\nworst = 1\nby = "in_plane_rms"\n'
    Path("spec.toml").write_text(GOOD.replace("duration = 1.0", "duration = 0.1") + keep)
    assert main(VERBS["fly on"]) == 0
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
