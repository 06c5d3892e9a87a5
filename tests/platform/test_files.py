"""What a simulation reads is told from what else lies in a machine's folder."""

import shutil
from pathlib import Path

import pytest

from twin.library import library, model_names
from twin.platform import Platform, files_of, load_platform
from twin.platform.mjcf import load_mjcf

TETRAHEDRON = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def machine(tmp_path: Path) -> Platform:
    """The SADS table with a mesh in a folder, named by a file that its MJCF includes."""
    folder = tmp_path / "machine"
    shutil.copytree(library("models") / "sads", folder, ignore=shutil.ignore_patterns("logs"))
    (folder / "assets").mkdir()
    (folder / "assets" / "bus.obj").write_text(TETRAHEDRON)
    (folder / "shapes.xml").write_text(
        '<mujoco><compiler meshdir="assets"/><asset><mesh file="bus.obj"/></asset></mujoco>'
    )
    mjcf = folder / "platform.xml"
    head, mark, rest = mjcf.read_text().partition("<worldbody>")
    mjcf.write_text(head + '<include file="shapes.xml"/>' + mark + rest)
    return load_platform(folder)


def test_platform_toml_and_what_the_mjcf_names_are_read(machine):
    needed = ["assets/bus.obj", "platform.toml", "platform.xml", "shapes.xml"]
    assert list(files_of(machine)) == needed, "README.md and a picture lie there too"


def test_a_machine_of_these_files_alone_is_the_same(machine, tmp_path):
    for name, path in files_of(machine).items():
        (tmp_path / "copy" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, tmp_path / "copy" / name)
    assert load_mjcf(load_platform(tmp_path / "copy").model_path).nmesh == 1


@pytest.mark.parametrize("name", model_names())
def test_a_shipped_machine_needs_its_pair_alone(name):
    assert list(files_of(load_platform(name))) == ["platform.toml", "platform.xml"]
