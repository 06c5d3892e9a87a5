"""A control law of an installed package is found by its name."""

import sys
from pathlib import Path

import pytest

import twin
from twin.library import controller_names, find_controller

LAW = (Path(__file__).parents[2] / "controllers" / "free_float.py").read_text()


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with one law, as an installer leaves it."""
    package = tmp_path / "lab_laws"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "gliding.py").write_text(LAW.replace("FreeFloat", "Gliding"))
    facts = tmp_path / "lab_laws-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: lab-laws\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(
        "[twin.controllers]\ngliding = lab_laws.gliding:Gliding\nlost = lab_laws.gone:Law\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield package
    for name in [name for name in sys.modules if name.startswith("lab_laws")]:
        del sys.modules[name]


def test_a_law_of_an_installed_package_flies_by_its_name(installed: Path):
    assert "gliding" in controller_names()
    assert find_controller("gliding") == (installed / "gliding.py").resolve()
    run = twin.fly("sads", "gliding", duration=1.0)
    assert run.ended == "done"


def test_an_entry_point_that_names_nothing_is_told_with_its_value(installed: Path):
    with pytest.raises(twin.TwinError, match=r"'lost' of 'twin.controllers' \(lab_laws.gone:Law\)"):
        twin.fly("sads", "lost", duration=1.0)
