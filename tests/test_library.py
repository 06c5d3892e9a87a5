"""What an installed package brings is found by its name."""

import sys
from pathlib import Path

import pytest

import twin
from twin.effects import effect_named, effect_names
from twin.library import controller_names, find_controller
from twin.plant.devices.kinds import KINDS
from twin.procedures import WAYS, usual_target
from twin.procedures.setup import balancing

ROOT = Path(__file__).parents[1]
POINTS = """
[twin.controllers]
gliding = lab.gliding:Gliding
lost = lab.gone:Law

[twin.effects]
swell = lab.swell:Swell
no_effect = lab.gliding:Gliding

[twin.devices]
no_device = lab.swell:Swell

[twin.procedures]
gently = lab.ways:GENTLY
direct = lab.ways:GENTLY
"""
EFFECT = '''
from dataclasses import dataclass

import numpy as np

from twin.effects import BodyEffect, Domain, parameter


@dataclass(frozen=True)
class Swell(BodyEffect):
    """A constant torque."""

    name = "swell"
    domain = Domain.torque
    observable = "a constant torque"
    streams = ("gyro",)

    size: float = parameter("size", "N m", 1e-3, source="ASSUMED", low=-1.0, high=1.0)

    def torque(self, platform):
        return lambda state: np.full_like(state.rate, self.size)
'''


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with one of each, as an installer leaves it."""
    package = tmp_path / "lab"
    package.mkdir()
    law = (ROOT / "controllers" / "free_float.py").read_text()
    (package / "__init__.py").write_text("")
    (package / "gliding.py").write_text(law.replace("FreeFloat", "Gliding"))
    (package / "swell.py").write_text(EFFECT)
    (package / "ways.py").write_text(
        "from twin.procedures import Way\nGENTLY = Way('by a law of the lab', 'mass_pid', 16.0)\n"
    )
    facts = tmp_path / "lab-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(tmp_path)
    yield package
    for name in [name for name in sys.modules if name.split(".")[0] == "lab"]:
        del sys.modules[name]


def test_a_law_of_an_installed_package_flies_by_its_name(installed: Path):
    assert "gliding" in controller_names()
    assert find_controller("gliding") == (installed / "gliding.py").resolve()
    run = twin.fly("sads", "gliding", duration=1.0)
    assert run.ended == "done"


def test_an_entry_point_that_names_nothing_is_told_with_its_value(installed: Path):
    with pytest.raises(twin.TwinError, match=r"'lost' of 'twin.controllers' \(lab.gone:Law\)"):
        twin.fly("sads", "lost", duration=1.0)


def test_an_effect_of_an_installed_package_is_stated_by_its_name(installed: Path):
    assert effect_names()[-2:] == ["no_effect", "swell"]
    assert effect_named("swell").__module__ == "lab.swell"
    run = twin.fly("sads", effects="swell=2e-3", duration=1.0)
    assert [effect.name for effect in run.platform.effects] == ["swell"]


def test_an_entry_point_of_another_kind_is_refused_by_its_name(installed: Path):
    with pytest.raises(twin.TwinError, match="'no_effect' of 'twin.effects'.*names no object"):
        effect_named("no_effect")
    with pytest.raises(twin.TwinError, match="'no_device' of 'twin.devices'.*names no object"):
        KINDS["no_device"]


def test_a_procedure_of_an_installed_package_balances_by_its_name(installed: Path):
    assert list(WAYS)[-1] == "gently"
    machine = twin.load("cubesat")
    procedure = balancing(machine, 1, way="gently", target=usual_target(machine))
    procedure.lab.fits.close()
    assert WAYS["gently"].law == "mass_pid"
    with pytest.raises(twin.TwinError, match="did you mean 'gently'"):
        twin.balance(machine, procedure="gentle")


def test_a_name_that_is_built_in_stays_what_it_is(installed: Path):
    assert WAYS["direct"].law is None
    assert list(WAYS).count("direct") == 1


def test_a_name_that_nobody_has_is_in_no_registry(installed: Path):
    assert "nothing" not in KINDS
    with pytest.raises(KeyError):
        KINDS["nothing"]
