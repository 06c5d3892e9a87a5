"""A campaign is gone on with where what its results depend on is still the same, and only there."""

import json
import re
import shutil
from pathlib import Path

import pytest

from tests.campaigns.conftest import GOOD, silent
from tests.conftest import FAN
from twin.campaigns.execute import execute
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.campaigns.results import read_results
from twin.errors import CampaignError
from twin.files import trust_folders
from twin.library import library


def go_on(file: Path, folder: Folder) -> None:
    """Begin a campaign, or resume it, and fly nothing."""
    with folder.owned():
        folder.begin(read_spec(file), resume=True)


def test_a_campaign_whose_effect_has_changed_is_not_gone_on_with(tmp_path):
    fan, file, folder = tmp_path / "fan.py", tmp_path / "spec.toml", Folder(tmp_path / "out")
    trust_folders(tmp_path)
    fan.write_text(FAN)
    file.write_text(GOOD.replace("duration = 1.0", "duration = 0.1") + f"[effects.'{fan}']\n")
    assert execute(read_spec(file), folder, workers=1, tell=silent).flown == 24
    go_on(file, folder)
    fan.write_text(FAN.replace("self.size, 0.0", "0.0, self.size"))
    with pytest.raises(CampaignError, match=rf"begun with another effect {re.escape(str(fan))}, "):
        go_on(file, folder)
    fan.write_text(FAN)
    go_on(file, folder)
    names = json.loads((tmp_path / "out" / "campaign.json").read_text())["files"]
    effects = [name for name in names if name.startswith("effect ")]
    assert effects == [f"effect {fan}"], "those built in are told by the package's version"


def test_a_comment_or_more_to_keep_makes_no_other_campaign(tmp_path):
    file, folder = tmp_path / "spec.toml", Folder(tmp_path / "out")
    file.write_text(GOOD.replace("duration = 1.0", "duration = 0.1"))
    assert execute(read_spec(file), folder, workers=1, tell=silent).flown == 24
    keep = '[keep]\nworst = 2\nby = "tilt_rms"\n'
    file.write_text("# a note\n" + file.read_text() + keep)
    assert execute(read_spec(file), folder, workers=1, tell=silent, resume=True).flown == 0
    assert read_results(folder.path).spec.keep.worst == 2


def test_a_copy_that_somebody_changed_is_not_reported_as_what_was_flown(tmp_path):
    file, folder = tmp_path / "spec.toml", Folder(tmp_path / "out")
    file.write_text(GOOD.replace("duration = 1.0", "duration = 0.1"))
    execute(read_spec(file), folder, workers=1, tell=silent)
    folder.spec.write_text(file.read_text().replace("seed = 3", "seed = 4"))
    with pytest.raises(CampaignError, match="was changed since"):
        read_results(folder.path)
    go_on(file, folder)
    assert read_results(folder.path).spec.seed == 3
    folder.spec.unlink()
    with pytest.raises(CampaignError, match="there is no such file"):
        read_results(folder.path)
    go_on(file, folder)
    assert read_results(folder.path).spec.seed == 3


ARMS = """[[arms]]
name = "a"
controller = "a/mine.py"
platform = "a/table"

[[arms]]
name = "b"
controller = "b/mine.py"
platform = "b/table"

[effects.stage_backlash]"""


@pytest.mark.parametrize("arm", ["a", "b"])
@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ("mine.py", "controller {}/mine.py"),
        ("table/platform.toml", "platform {}/table: platform.toml"),
    ],
)
def test_laws_and_machines_of_the_same_name_are_told_apart(
    tmp_path, monkeypatch, arm, changed, named
):
    for place in (tmp_path / "a", tmp_path / "b"):
        shutil.copytree(library("models") / "cubesat", place / "table")
        shutil.copy(library("controllers") / "mass_magnetic_pid.py", place / "mine.py")
    monkeypatch.chdir(tmp_path)
    trust_folders(tmp_path)
    file, folder = tmp_path / "spec.toml", Folder(tmp_path / "out")
    file.write_text(GOOD.replace("[effects.stage_backlash]", ARMS))
    go_on(file, folder)
    go_on(file, folder)
    with (tmp_path / arm / changed).open("a") as text:
        text.write("\n")
    with pytest.raises(CampaignError, match=f"begun with another {named.format(arm)}, so"):
        go_on(file, folder)


@pytest.fixture
def own(tmp_path) -> Path:
    """A specification of somebody's own machine, with a mesh in a folder below its own."""
    machine = tmp_path / "machine"
    shutil.copytree(library("models") / "cubesat", machine, ignore=shutil.ignore_patterns("logs"))
    (machine / "assets").mkdir()
    (machine / "assets" / "bus.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    mjcf = machine / "platform.xml"
    mesh = '<asset><mesh file="assets/bus.obj"/></asset><worldbody>'
    mjcf.write_text(mjcf.read_text().replace("<worldbody>", mesh, 1))
    file = tmp_path / "spec.toml"
    file.write_text(GOOD.replace('"cubesat"', f'"{machine}"'))
    return file


def test_a_mesh_that_has_changed_makes_another_machine(own, tmp_path):
    go_on(own, folder := Folder(tmp_path / "out"))
    mesh = tmp_path / "machine" / "assets" / "bus.obj"
    mesh.write_text(mesh.read_text().replace("v 1 0 0", "v 2 0 0"))
    with pytest.raises(CampaignError, match=r"begun with another platform .*: assets/bus.obj, so"):
        go_on(own, folder)


def test_what_no_simulation_reads_may_change(own, tmp_path):
    go_on(own, folder := Folder(tmp_path / "out"))
    for name in ("README.md", "cubesat.png", "todo.txt"):
        with (tmp_path / "machine" / name).open("a") as text:
            text.write("a typo mended")
    go_on(own, folder)


def test_a_folder_that_moved_with_its_files_is_gone_on_with(tmp_path, monkeypatch):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    shutil.copy(library("controllers") / "mass_magnetic_pid.py", here / "law.py")
    (here / "spec.toml").write_text(GOOD.replace('"mass_magnetic_pid"', '"law.py"'))
    trust_folders(tmp_path)
    monkeypatch.chdir(here)
    go_on(Path("spec.toml"), Folder(Path("out")))
    here.rename(there)
    monkeypatch.chdir(there)
    go_on(Path("spec.toml"), Folder(Path("out")))
