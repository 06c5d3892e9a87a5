"""Mistakes in gimbals, coils, thrusters, stops and bases: file, line, value and what would do."""

import shutil
from pathlib import Path

import pytest

from twin.check import check_platform
from twin.errors import PlatformError
from twin.library import library
from twin.model import compile_model
from twin.platform import load_platform

# the machine, what is replaced in its platform.toml by what, and what is said at that line
WRONG = {
    "coil has no site": ("cubesat", 'name = "mx"', 'name = "mq"', "no site of the MJCF"),
    "coil is nameless": ("cubesat", 'name = "mx"', 'name = "imu"', 'add <general name="imu"'),
    "dipole is negative": ("cubesat", "dipole_limit = 1.0", "dipole_limit = -1.0", "at least 0 A"),
    "drive answers before": ("cubesat", "response = 0.05", "response = -0.05", "0 and 10 s"),
    "field is a number": ("cubesat", "[0.0, 0.0, 6e-4]", '"up"', "give 3 numbers in T"),
    "no tanks to measure": ("cubesat", "[sensors.gyro]", "[sensors.gas_pressure]", "not have"),
    "no stage floats": ("cubesat", "[sensors.gyro]", "[sensors.position]", "not have; remove it"),
    "noise is missing": ("cubesat", "noise = 4e-4 ", "nois = 4e-4 ", "meant to be 'noise'?"),
    "no such site": ("cubesat", 'site = "imu"', 'site = "sun"', "no site of the MJCF"),
    "gimbal has no joint": ("tas2", 'name = "g1"', 'name = "g9"', "no joint of the MJCF"),
    "gimbal stands still": ("tas2", "rate = 0.5 ", "rate = 0.0 ", "at least 1e-09 rad/s"),
    "gimbal carries none": ("tas2", 'name = "g1"', 'name = "s1"', "which another part has"),
    "rotor has no joint": ("tas2", 'name = "r1"', 'name = "rotor"', "no joint of the MJCF"),
    "rotor has no inertia": ("tas2", "inertia = 0.1 ", "inertia = 0 ", "at least 1e-12"),
    "home is a word": ("tas2", "home = 1.5707963267948966", 'home = "east"', "number in rad"),
    "low-pass is beyond": ("tas2", "cutoff = 2.0 ", "cutoff = 60.0 ", "keep it below 50 Hz"),
    "filter of order 0": ("tas2", "order = 2", "order = 0", "between 1 and 8"),
    "attitude is filtered": (
        "astros",
        "noise = 1.4e-4 ",
        "cutoff = 5.0\nnoise = 1.4e-4 ",
        "filter the gyro instead",
    ),
    "stage has two joints": (
        "astros",
        'planar = ["x", "y", "heading"]',
        'planar = ["x", "y"]',
        "slide along x, slide along y, heading",
    ),
    "locked is unknown": (
        "astros",
        'locked = ["x", "y", "heading"]',
        'locked = ["z"]',
        "it can hold the ball's joint",
    ),
    "locked is no list": (
        "astros",
        'locked = ["x", "y", "heading"]',
        "locked = 1",
        "list of texts",
    ),
    "wheel starts beyond": ("astros", "home = 200.0", "home = 500.0", "beyond the 400 rad/s"),
    "thruster pulls": ("astros", "force_limit = 5.0", "force_limit = -5.0", "at least 0 N"),
    "thruster is nowhere": ("astros", 'name = "x1"', 'name = "q1"', "no site of the MJCF"),
    "tanks are empty": ("astros", "mass = 2.0 ", "mass = 0.0 ", "at least 1e-09 kg"),
    "gas weighs nothing": (
        "astros",
        "specific_impulse = 60.0",
        "specific_impulse = 0.0",
        "at least 0.001 s",
    ),
    "pitch axis is upright": (
        "whorl2",
        "axis = [1.0, 0.0, 0.0]",
        "axis = [0.0, 0.0, 1.0]",
        "horizontal when level",
    ),
    "pitch beyond upright": ("whorl2", "angle = 0.52", "angle = 2.52", "between 0 and 1.5708 rad"),
    "two stops": (
        "whorl2",
        "[pitch_stop]",
        "[tilt_stop]\nangle = 0.5\n[pitch_stop]",
        "keep the one",
    ),
}


@pytest.fixture
def copied(tmp_path: Path):
    def copy(machine: str) -> Path:
        return Path(shutil.copytree(library("models") / machine, tmp_path / machine))

    return copy


def replace(file: Path, old: str, new: str) -> int:
    """The first of them; the number of the line it stood on."""
    before, found, after = file.read_text().partition(old)
    assert found, f"{old!r} is not in the file: mend the test"
    file.write_text(before + new + after)
    return before.count("\n") + 1


@pytest.mark.parametrize("mistake", WRONG)
def test_a_mistake_in_a_part_is_reported_with_its_line(copied, mistake: str):
    machine, old, new, said = WRONG[mistake]
    file = copied(machine) / "platform.toml"
    line = replace(file, old, new)
    with pytest.raises(PlatformError) as caught:
        load_platform(file.parent)
    assert said in str(caught.value)
    assert "; " in str(caught.value), "a remedy follows the problem"
    assert str(caught.value).startswith(f"{file}:")
    assert abs((caught.value.line or 0) - line) <= 2, "said where the part is stated"


@pytest.mark.parametrize(
    ("machine", "old", "new", "said"),
    [
        ("astros", 'gear="0 0 1 0 0 0"', 'gear="0 0 2 0 0 0"', "make it a unit vector"),
        ("tas2", 'name="r1" axis="0 -1 0"', 'name="r1" axis="1 0 0"', "is not perpendicular"),
    ],
)
def test_a_mistake_in_the_mjcf_of_a_part_is_refused(copied, machine, old, new, said):
    folder = copied(machine)
    replace(folder / "platform.xml", old, new)
    with pytest.raises(PlatformError, match=said):
        load_platform(folder)


@pytest.mark.usefixtures("brief_check")
@pytest.mark.parametrize(
    ("machine", "old", "new", "said"),
    [
        ("astros", 'ctrlrange="0 5"', 'ctrlrange="0 6"', "another ctrlrange than platform.toml"),
        ("cubesat", 'gear="0 0 6e-3', 'gear="0 0 5e-3', "must have the magnetic field over"),
        ("whorl2", "1.0720577136594005", "1.06", "mend the contact pair or pitch_stop.angle"),
        ("tas2", 'name="s1" axis="1 0 0"', 'name="s1" axis="2 0 0"', "scale them to length 1"),
    ],
)
def test_twin_check_names_what_the_two_files_do_not_share(copied, machine, old, new, said):
    folder = copied(machine)
    replace(folder / "platform.xml", old, new)
    sentences = [found.sentence for found in check_platform(load_platform(folder)) if not found.ok]
    assert any(said in sentence for sentence in sentences), sentences


def test_a_coil_on_a_body_that_floats_away_is_refused(copied):
    """Its torque is made with a force, which only a bearing that stands can take."""
    folder = copied("cubesat")
    replace(folder / "platform.toml", 'kind = "ball"', 'kind = "free"')
    replace(
        folder / "platform.xml",
        '<joint name="bearing" type="ball"/>',
        '<freejoint name="bearing"/>',
    )
    with pytest.raises(PlatformError, match="needs a bearing that stands"):
        compile_model(load_platform(folder))
