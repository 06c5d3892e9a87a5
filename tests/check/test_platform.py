"""`twin check` names, in a sentence, each way in which a machine's two files can disagree."""

import dataclasses
import functools
import json
import re
import shutil
from pathlib import Path

import pytest

from twin.check import Finding, check_platform
from twin.check.motion import check_step
from twin.cli.main import main
from twin.library import model_names
from twin.platform import load_platform

SADS = Path(__file__).parents[2] / "models" / "sads"


@pytest.fixture
def folder(tmp_path: Path, brief_check: None) -> Path:
    """A machine to make mistakes in, of which none is in the step."""
    copy = tmp_path / "machine"
    shutil.copytree(SADS, copy)
    return copy


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text, f"{old!r} is not in {file.name}: mend the test"
    file.write_text(text.replace(old, new, 1))


@functools.cache
def found_in(name: str) -> list[Finding]:
    """Of a shipped machine, by all checks in their full length."""
    return check_platform(load_platform(name))


def wrong(folder: Path) -> list[Finding]:
    return [finding for finding in check_platform(load_platform(folder)) if not finding.ok]


JOINT_W1 = '<joint name="w1" axis="1 0 0"/>'
JOINT_S1 = '<joint name="s1" axis="1 0 0" range="-0.1 0.1"/>'

# the mistake: (file, old, new), and what is said: the check's name, words of its sentence
HIDDEN = {
    "the integrator is MuJoCo's default": (
        ("platform.xml", 'integrator="RK4" ', ""),
        ("integrator", "RK4"),
    ),
    "the viewer runs at another step": (
        ("platform.xml", 'timestep="0.01"', 'timestep="0.002"'),
        ("step", "simulation.step"),
    ),
    "gravity is tilted": (
        ("platform.xml", 'gravity="0 0 -9.81"', 'gravity="0.1 0 -9.81"'),
        ("gravity", "straight down"),
    ),
    "the base joint is a hinge": (
        ("platform.xml", '<joint name="bearing" type="ball"/>', '<joint name="bearing"/>'),
        ("joint bearing", "is a hinge joint; it must be a ball joint"),
    ),
    "the base carries another body": (
        ("platform.toml", 'body = "bus"', 'body = "w1"'),
        ("joint bearing", "carries another body than 'w1'"),
    ),
    "a wheel slides": (
        ("platform.xml", JOINT_W1, '<joint name="w1" type="slide" axis="1 0 0"/>'),
        ("joint w1", "is a slide joint; it must be a hinge joint"),
    ),
    "a stage turns": (
        ("platform.xml", JOINT_S1, '<joint name="s1" type="hinge" axis="1 0 0"/>'),
        ("joint s1", "is a hinge joint; it must be a slide joint"),
    ),
    "a wheel stands in the room": (
        (
            "platform.xml",
            '<body name="bus"',
            '<body name="fan"><joint name="fan"/><geom size="0.1" mass="1"/></body>'
            '<body name="bus"',
        ),
        ("nothing else moves", "'fan'"),
    ),
    "a joint has no part": (
        ("platform.xml", JOINT_W1, JOINT_W1 + '<joint name="wobble" axis="0 1 0"/>'),
        ("nothing else moves", "'wobble'"),
    ),
    "a joint has neither part nor name": (
        ("platform.xml", JOINT_S1, JOINT_S1 + '<joint type="slide" axis="0 1 0"/>'),
        ("nothing else moves", "unnamed on s1"),
    ),
    "an axis is not unit": (
        ("platform.xml", JOINT_W1, '<joint name="w1" axis="1 0 0.1"/>'),
        ("length of joint axes", "'w1' 1.00499"),
    ),
    "the bus turns about another point": (
        ("platform.xml", 'type="ball"/>', 'type="ball" pos="0 0 0.01"/>'),
        ("bus frame off CR, off level", "origin at the base joint"),
    ),
    "the bus is drawn askew": (
        (
            "platform.xml",
            '<body name="bus" pos="0 0 1.2"',
            '<body name="bus" pos="0 0 1.2" euler="0 0 1"',
        ),
        ("bus frame off CR, off level", "parallel to the room's"),
    ),
    "the MJCF has another travel": (
        ("platform.xml", 'range="-0.15 0.15"/>', 'range="-0.15 0.16"/>'),
        ("s2 travel", "'s2'"),
    ),
    "platform.toml has another travel": (
        ("platform.toml", "travel = [-0.10, 0.10]", "travel = [-0.20, 0.20]"),
        ("s1 travel", "'s1'"),
    ),
    "a stage has no end": (
        ("platform.xml", JOINT_S1, '<joint name="s1" axis="1 0 0"/>'),
        ("s1 travel", "give both the real travel"),
    ),
    "a motor is missing": (
        ("platform.xml", '<motor name="w3" joint="w3" class="wheel"/>', ""),
        ("w3 torque range", "no actuator named 'w3'"),
    ),
    "two motors are crossed": (
        ("platform.xml", '<motor name="w1" joint="w1"', '<motor name="w1" joint="w2"'),
        ("w1 torque range", '<motor joint="w1">'),
    ),
    "a motor is reversed": (
        ("platform.xml", '<motor name="w2" joint="w2"', '<motor name="w2" gear="-1" joint="w2"'),
        ("w2 torque range", "gear 1"),
    ),
    "a motor is a servo": (
        ("platform.xml", '<motor name="w2"', '<velocity name="w2"'),
        ("w2 torque range", "must be <motor"),
    ),
    "a motor is stronger": (
        ("platform.xml", 'ctrlrange="-0.5 0.5"', 'ctrlrange="-0.6 0.6"'),
        ("w1 torque range", "another ctrlrange"),
    ),
    "a motor has no limit": (
        ("platform.xml", 'ctrlrange="-0.5 0.5"', 'gear="1"'),
        ("w1 torque range", "another ctrlrange"),
    ),
    "an actuator has no part": (
        (
            "platform.xml",
            "<actuator>",
            '<actuator><motor name="jet" joint="bearing" gear="0 0 1"/>',
        ),
        ("nothing else drives", "'jet'"),
    ),
    "a stage's servo fights the simulation": (
        ("platform.xml", '<position name="s2"', '<position name="s2" group="0"'),
        ("nothing else drives", "'s2'"),
    ),
    "a sliding mass is heavier": (
        ("platform.xml", 'mass="1.5"', 'mass="1.6"'),
        ("s1 mass that slides", "weighs 1.6 kg"),
    ),
    "something rides on a stage": (
        (
            "platform.xml",
            JOINT_S1,
            JOINT_S1
            + '<body name="nut"><inertial pos="0 0 0" mass="0.1" diaginertia="1 1 1"/></body>',
        ),
        ("s1 mass that slides", "weighs 1.6 kg"),
    ),
    "a wheel has another spin inertia": (
        ("platform.xml", 'diaginertia="0.028 ', 'diaginertia="0.029 '),
        ("w1 spin inertia", "0.029 kg m^2"),
    ),
    "a wheel's inertia lies along another axis": (
        (
            "platform.xml",
            'diaginertia="0.028 0.01453 0.01453"',
            'diaginertia="0.01453 0.028 0.01453"',
        ),
        ("w1 spin inertia", "0.01453 kg m^2"),
    ),
    "a wheel is statically unbalanced": (
        ("platform.xml", '<inertial pos="0 0 0" mass="4"', '<inertial pos="0 0.001 0" mass="4"'),
        ("w1 imbalance, armature", "CM on its axis"),
    ),
    "a wheel is dynamically unbalanced": (
        (
            "platform.xml",
            'diaginertia="0.028 0.01453 0.01453"',
            'diaginertia="0.028 0.0146 0.01453"',
        ),
        ("w1 imbalance, armature", "equal moments across it"),
    ),
    "a wheel's inertia is armature": (
        ("platform.xml", JOINT_W1, '<joint name="w1" axis="1 0 0" armature="0.001"/>'),
        ("w1 imbalance, armature", "no joint armature"),
    ),
    "the bus weighs more": (
        ("platform.xml", 'mass="78.5"', 'mass="78.6"'),
        ("MJCF: floating mass", "95.1 kg"),
    ),
    "the stated mass is another": (
        ("platform.toml", "mass = 95.0", "mass = 95.001"),
        ("MJCF: floating mass", "mass_properties"),
    ),
    "the stated inertia is another": (
        ("platform.toml", "inertia = [3.0, 12.0, 12.0, 0.0", "inertia = [3.0, 12.0, 12.0, 1e-6"),
        ("MJCF: J about the CR", "inertia"),
    ),
    "the stated CM is on the other side": (
        ("platform.toml", "[9.5e-4, -9.5e-4, -2.85e-3]", "[9.5e-4, -9.5e-4, 2.85e-3]"),
        ("MJCF: m r", "mass moment"),
    ),
    "a wheel is mounted elsewhere": (
        ("platform.xml", '<body name="w3" pos="0.3 0 0.12"', '<body name="w3" pos="0.3 0 0.121"'),
        ("MJCF: m r", "mass moment"),
    ),
    "the stop touches elsewhere": (
        ("platform.toml", "angle = 0.5235987755982988", "angle = 0.5"),
        ("tilt stop, any direction", "touches between 30 and 30 deg"),
    ),
    "the stop ring is off centre": (
        (
            "platform.xml",
            'pos="0 0 -0.15" size="0.38 0.008"',
            'pos="0.01 0 -0.15" size="0.38 0.008"',
        ),
        ("tilt stop, any direction", "mend the contact pair"),
    ),
    "the stop is not stated": (
        ("platform.toml", "[tilt_stop]\nangle = 0.5235987755982988", "#"),
        ("no tilt stop", "add [tilt_stop] angle"),
    ),
    "the stop does not touch": (
        ("platform.xml", 'geom2="stop_ring"', 'geom2="ball"'),
        ("tilt stop, any direction", "nothing touches"),
    ),
    "a variant leaves no body for the bus": (
        (
            "platform.toml",
            "[variants.table1]",
            "[variants.light]\nmass = 10.0\n\n[variants.table1]",
        ),
        ("sads:light: can be compiled", "already weigh 16.5 kg of 10 kg"),
    ),
}


@pytest.mark.parametrize("mistake", HIDDEN)
def test_a_hidden_mistake_is_named_in_a_sentence(folder: Path, mistake: str):
    (file, old, new), (check, said) = HIDDEN[mistake]
    edit(folder / file, old, new)
    found = {finding.check: finding.sentence for finding in wrong(folder)}
    assert check in found, f"only {sorted(found)} were found wrong"
    assert said in found[check]


@pytest.mark.parametrize("name", model_names())
def test_every_shipped_machine_is_right(name: str):
    assert [finding for finding in found_in(name) if not finding.ok] == []


@pytest.mark.parametrize("mass", ["95.5", "95.0"])
def test_the_line_that_is_told_for_the_bus_mends_the_mjcf(folder: Path, mass: str):
    edit(folder / "platform.toml", "mass = 95.0", f"mass = {mass}")
    edit(
        folder / "platform.toml",
        "inertia = [3.0, 12.0, 12.0, 0.0",
        "inertia = [3.1, 12.0, 12.0, 0.2",
    )
    edit(folder / "platform.toml", "[9.5e-4, -9.5e-4, -2.85e-3]", "[9.5e-4, -9.5e-4, -9.5e-3]")
    lines = [line for one in wrong(folder) for line in re.findall(r"<inertial .*/>", one.sentence)]
    assert len(lines) == 1, "told once, where the first number is wrong"
    file = folder / "platform.xml"
    text = file.read_text()
    assert '<inertial mass="78.5"' in text
    file.write_text(re.sub(r'<inertial mass="78.5"[^>]*/>', lines[0], text))
    assert not wrong(folder)


def test_masses_that_no_bus_can_have_are_told_as_such(folder: Path):
    edit(folder / "platform.toml", "mass = 95.0", "mass = 10.0")
    said = next(one.sentence for one in wrong(folder) if one.check == "MJCF: floating mass")
    assert "no <inertial> of 'bus' gives what is stated: the other parts already weigh" in said


@pytest.mark.usefixtures("brief_check")
@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('kind = "microcontroller"', 'kind = "microcontroler"', "microcontroler"),
        ('stream = "gyro"', 'stream = "gyro"\ncolums = 3', "colums"),
    ],
)
def test_a_mistake_in_the_hardware_is_told_with_file_and_line(
    tmp_path: Path, old: str, new: str, sentence: str
):
    folder = tmp_path / "machine"
    shutil.copytree(SADS.parent / "cubesat", folder)
    edit(folder / "platform.toml", old, new)
    (finding,) = wrong(folder)
    assert finding.check == "[hardware] can be read"
    assert re.match(rf"{re.escape(str(folder / 'platform.toml'))}:\d+: ", finding.sentence)
    assert sentence in finding.sentence


def test_a_wheel_that_stands_in_the_room_is_no_part_of_the_machine(folder: Path):
    edit(
        folder / "platform.xml",
        '<body name="bus"',
        '<body name="fan"><joint name="fan"/><geom size="0.1" mass="1"/></body><body name="bus"',
    )
    edit(
        folder / "platform.toml",
        "[[wheels]]",
        '[[wheels]]\nname = "fan"\ninertia = 0.004\nmomentum_limit = 1.0\ntorque_limit = 0.1\n'
        "[[wheels]]",
    )
    (finding,) = wrong(folder)
    assert finding.check == "joint fan"
    assert "does not hang on 'bus'; put its body inside it" in finding.sentence


def test_a_variant_is_checked_from_its_folder_as_the_base_is():
    whole = found_in("sads")
    assert found_in("sads:table1") == whole
    assert {"sads: m r", "sads:table1: m r", "sads:table3: m r"} < {f.check for f in whole}


def test_a_step_that_costs_accuracy_is_found():
    platform = dataclasses.replace(load_platform("sads"), step=0.5, control_rate=2.0)
    attitude, _ = check_step(platform)
    assert not attitude.ok
    assert "choose a smaller simulation.step" in attitude.sentence


def test_halving_the_step_tells_sixteen_times_less_error_each_time():
    """RK4 is of fourth order; another ratio means that MuJoCo integrates something else."""
    platform = dataclasses.replace(load_platform("sads"), step=0.2, control_rate=5.0)
    coarse = float(check_step(platform)[0].found)
    fine = float(check_step(dataclasses.replace(platform, step=0.1))[0].found)
    assert 10.0 < coarse / fine < 24.0


@pytest.mark.usefixtures("brief_check")
def test_the_command_line_prints_a_table_and_returns_zero(capsys: pytest.CaptureFixture[str]):
    assert main(["check", "sads"]) == 0
    out = capsys.readouterr().out
    assert "WRONG" not in out
    assert out.rstrip().endswith("all ok")
    assert re.search(r"ok +MJCF: J about the CR +3 12 12 0 0 0 kg m\^2", out)


def test_the_command_line_says_wrong_and_returns_one(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    edit(folder / "platform.toml", "travel = [-0.10, 0.10]", "travel = [-0.20, 0.20]")
    assert main(["check", str(folder)]) == 1
    out = capsys.readouterr().out
    assert re.search(r"WRONG +s1 travel +stated -0.2 0.2, found -0.1 0.1 m\n +joint 's1'", out)
    assert out.rstrip().endswith("1 WRONG")


@pytest.mark.usefixtures("brief_check")
def test_json_is_one_list_of_findings(capsys: pytest.CaptureFixture[str]):
    assert main(["check", "sads", "--json"]) == 0
    findings = json.loads(capsys.readouterr().out)
    assert {"check", "ok", "stated", "found", "unit"} <= set(findings[0])
    assert all(finding["ok"] is True for finding in findings)


def test_a_folder_that_cannot_be_loaded_is_a_finding_too(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    edit(folder / "platform.toml", "mass = 95.0", "mass = -95.0")
    assert main(["check", str(folder), "--json"]) == 1
    (finding,) = json.loads(capsys.readouterr().out)
    assert finding["ok"] is False
    assert "platform.toml:21: mass_properties.mass is -95 kg" in finding["sentence"]
