"""`twin check` finds what acts in the MJCF and stands in no platform.toml."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from twin.check import Finding, check_platform
from twin.check.motion import check_foreign, passive_terms
from twin.library import library
from twin.platform import Platform, load_platform
from twin.platform.mjcf import load_mjcf

JOINT_W1 = '<joint name="w1" axis="1 0 0"/>'
BEARING = '<joint name="bearing" type="ball"/>'

FOREIGN = {
    "a fluid": (
        'integrator="RK4" ',
        'integrator="RK4" density="1.2" wind="1 0 0" ',
        "no fluid",
        "density and wind",
    ),
    "two wheels that are tied": (
        "<actuator>",
        '<equality><joint joint1="w1" joint2="w2"/></equality><actuator>',
        "nothing ties parts together",
        "<equality> joint on w1 and w2",
    ),
    "a body without weight": (
        '<body name="w3"',
        '<body name="w3" gravcomp="1"',
        "every body has its weight",
        "gravcomp: w3 1;",
    ),
    "gravity switched off": (
        "<worldbody>",
        '<option><flag gravity="disable"/></option><worldbody>',
        "no physics switched off",
        "gravity: disabled by <flag>",
    ),
    "a spring on a wheel": (
        JOINT_W1,
        '<joint name="w1" axis="1 0 0" stiffness="1"/>',
        "wheels turn freely",
        "w1 by stiffness",
    ),
    "a stop on a wheel": (
        JOINT_W1,
        '<joint name="w1" axis="1 0 0" range="-1 1"/>',
        "wheels turn freely",
        "w1 by range",
    ),
}


@pytest.fixture
def sads_with(tmp_path: Path) -> Callable[..., Platform]:
    """The machine, with pieces of its MJCF exchanged."""

    def changed(*changes: tuple[str, str]) -> Platform:
        folder = tmp_path / "machine"
        shutil.copytree(library("models") / "sads", folder)
        file = folder / "platform.xml"
        text = file.read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, f"{old!r} is not in the MJCF: mend the test"
            text = text.replace(old, new, 1)
        file.write_text(text, encoding="utf-8")
        return load_platform(folder)

    return changed


def wrong(findings: list[Finding]) -> list[Finding]:
    return [finding for finding in findings if not finding.ok]


@pytest.mark.parametrize("what", FOREIGN)
def test_what_belongs_to_no_machine_is_named_with_what_would_do(
    sads_with: Callable[..., Platform], what: str
):
    old, new, check, said = FOREIGN[what]
    platform = sads_with((old, new))
    (finding,) = wrong(check_foreign(platform, load_mjcf(platform.model_path)))
    assert finding.check == check
    assert said in finding.sentence
    assert "take " in finding.sentence


@pytest.mark.usefixtures("brief_check")
def test_what_belongs_to_no_machine_is_not_told_as_a_step_that_is_too_long(
    sads_with: Callable[..., Platform],
):
    stiff = sads_with((JOINT_W1, '<joint name="w1" axis="1 0 0" stiffness="1e4"/>'))
    (finding,) = wrong(check_platform(stiff))
    assert finding.check == "wheels turn freely"


def test_what_brakes_a_joint_is_shown_as_part_of_the_machine(sads_with: Callable[..., Platform]):
    platform = sads_with(
        (JOINT_W1, '<joint name="w1" axis="1 0 0" damping="1e-5 2e-6"/>'),
        (BEARING, BEARING.replace("/>", ' frictionloss="1e-4" stiffness="0.02"/>')),
    )
    shown = passive_terms(platform, load_mjcf(platform.model_path))
    assert shown.ok
    assert shown.found == (
        "bearing stiffness 0.02 N m, dry friction 0.0001 N m; "
        "w1 damping 1e-05 N m s, quadratic damping 2e-06 N m s^2"
    )


def test_what_brakes_a_stage_is_not_shown_for_its_drive_moves_it_all_the_same():
    sads = load_platform("sads")
    assert passive_terms(sads, load_mjcf(sads.model_path)).found == "none"
