"""Whatever is wrong in platform.toml is said with file, line, value and what would do."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from twin.errors import PlatformError, UnknownName, UsageError
from twin.library import library, model_names
from twin.platform import load_platform, variants_of

SADS = Path(__file__).parents[2] / "models" / "sads"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    copy = tmp_path / "machine"
    shutil.copytree(SADS, copy)
    return copy


def edit(folder: Path, old: str, new: str) -> int:
    """Replace the first `old` in platform.toml; the number of the line it stood on."""
    file = folder / "platform.toml"
    before, found, after = file.read_text().partition(old)
    assert found, f"{old!r} is not in the file: mend the test"
    file.write_text(before + new + after)
    return before.count("\n") + 1


def refusal(folder: Path, variant: str = "") -> PlatformError:
    with pytest.raises(PlatformError) as caught:
        load_platform(f"{folder}:{variant}" if variant else folder)
    return caught.value


WRONG = {
    "mass is negative": ("mass = 95.0", "mass = -95.0", "mass is -95 kg"),
    "mass is text": ("mass = 95.0", 'mass = "95 kg"', "give a number in kg"),
    "mass is endless": ("mass = 95.0", "mass = inf", "mass is inf kg; give a finite number in kg"),
    "ramp is endless": ("acceleration = 0.02", "acceleration = inf", "give a finite number"),
    "mass is true": ("mass = 95.0", "mass = true", "give a number in kg"),
    "inertia has five entries": ("12.0, 0.0, 0.0, 0.0]", "12.0, 0.0, 0.0]", "give 6 numbers"),
    "inertia is not positive": (
        "12.0, 0.0, 0.0, 0.0]",
        "12.0, 9.0, 0.0, 0.0]",
        "not all of them positive",
    ),
    "inertia is of no rigid body": ("[3.0, 12.0, 12.0", "[3.0, 12.0, 18.0", "no rigid body"),
    "offset is not a number": ("[9.5e-4, -9.5e-4", "[nan, -9.5e-4", "give 3 numbers in kg m"),
    "key is misspelt": ("momentum_limit = 5.0", "momentum_limt = 5.0", "'momentum_limit'"),
    "wheel has no inertia": ("inertia = 0.028", "inertia = 0.0", "at least 1e-12 kg m^2"),
    "torque limit is negative": ("torque_limit = 0.5", "torque_limit = -0.5", "at least 0 N m"),
    "wheel is no joint": ('name = "w1"', 'name = "wheel1"', "no joint of the MJCF"),
    "wheel is written with brackets": ('name = "w1"', 'name = "w(1)"', "MJCF; did you mean 'w1'"),
    "stage is no joint": ('name = "s1"', 'name = "stage1"', "no joint of the MJCF"),
    "stage weighs nothing": ("mass = 1.5", "mass = 0", "at least 1e-09 kg"),
    "travel is reversed": ("[-0.10, 0.10]", "[0.10, -0.10]", "give the lower end first"),
    "speed is zero": ("speed = 0.01", "speed = 0.0", "speed is 0 m/s"),
    "base is a slide": ('kind = "ball"', 'kind = "slide"', "use one of 'ball', 'hinge'"),
    "base is no joint": ('joint = "bearing"', 'joint = "ball"', "no joint of the MJCF"),
    "ball has a motor": ('body = "bus"', 'body = "bus"\nactuator = "w1"', "only a hinge"),
    "step does not fit": ("step = 0.01 ", "step = 0.03 ", "does not divide the control period"),
    "field in uT": ("gravity = 9.81", "magnetic_field = [22, 0, -42]", "1 uT is 1e-6 T"),
    "gravity points up": ("gravity = 9.81", "gravity = -9.81", "between 0 and 100 m/s^2"),
    "frame is no rotation": ("[0.0, 1.0, 0.0, 0.0]", "[0.0, 2.0, 0.0, 0.0]", "scale it to length"),
    "tilt stop beyond pi": ("angle = 0.52", "angle = 30.52", "at most 3.14159 rad"),
    "sensor is unknown": ("[sensors.gyro]", "[sensors.girometer]", "use gyro, attitude"),
    "sensor is faster than the step": (
        "rate = 100.0",
        "rate = 190.0",
        "is 190 Hz, but there is at most one sample a step of 0.01 s; give at most 100 Hz, or a "
        "simulation.step of 0.005 s",
    ),
    "sensor is endlessly fast": ("rate = 100.0", "rate = inf", "give a finite number in Hz"),
    "sensor has no range": ("range = 5.24", "range = 0.0", "it must be at least 1e-12 rad/s"),
    "sensor is seconds late": ("range = 5.24", "latency = 5.0", "between 0 and 1 s"),
    "wheel takes no momentum": (
        "momentum_limit = 5.0",
        "momentum_limit = 0",
        "at least 1e-09 N m s",
    ),
    "stage knows one place": (
        "resolution = 1e-6",
        "resolution = 0.3",
        "is 0.3 m, more than the 0.2 m of its travel; give the step of its drive",
    ),
    "machine has no name": ('name = "sads"', 'name = " "', "name is ' '; give the machine one"),
    "noise is negative": ("noise = 1e-3", "noise = -1e-3", "at least 0 rad/s"),
    "noise is a word": ("noise = 1e-3", 'noise = "low"', "give 3 numbers in rad/s"),
    "dropout is certain": ("range = 5.24", "dropout = 1.5", "between 0 and 1"),
    "sensor measures nothing": ("[sensors.gyro]", "[sensors.joint_angle]", "does not have"),
    "model is elsewhere": ('"platform.xml"', '"../platform.xml"', "keep the MJCF beside it"),
    "model is missing": ('"platform.xml"', '"machine.xml"', "machine.xml, which is missing"),
    "file is not TOML": ("mass = 95.0", "mass = = 95.0", "mend the TOML"),
    "key is nobody's": ("[tilt_stop]", "tilt_stop2 = 1\n[tilt_stop]", "is no key we know"),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_a_mistake_is_reported_with_its_file_and_line(folder: Path, mistake: str):
    old, new, said = WRONG[mistake]
    line = edit(folder, old, new)
    if mistake == "ball has a motor":
        line += 1
    error = refusal(folder)
    assert said in str(error)
    assert str(error).startswith(f"{folder / 'platform.toml'}:{line}: ")
    assert "; " in str(error), "a remedy follows the problem"


@pytest.mark.parametrize("key", ["mass", "inertia", "center_of_mass_offset"])
def test_a_missing_mass_property_is_reported_at_its_table(folder: Path, key: str):
    line = edit(folder, "[mass_properties]", "[mass_properties]")
    edit(folder, f"\n{key} =", f"\n# {key} =")
    error = refusal(folder)
    assert f"mass_properties.{key} is missing; add it" in str(error)
    assert error.line == line


def test_a_missing_name_is_not_looked_for_in_other_tables(folder: Path):
    edit(folder, 'name = "sads"', "")
    error = refusal(folder)
    assert "name is missing; add it" in str(error)
    assert error.line is None


def test_two_parts_of_one_name_are_refused_where_the_parts_stand(folder: Path):
    line = edit(folder, 'name = "w2"', 'name = "w1"')
    error = refusal(folder)
    assert "'w1', which another part has" in str(error)
    assert error.line == line


@pytest.mark.parametrize("key", ["mas", "inertias"])
def test_a_variant_may_not_hold_an_unknown_key(folder: Path, key: str):
    line = edit(folder, "[variants.table1]", f"[variants.table1]\n{key} = 1.0") + 1
    error = refusal(folder, "table1")
    assert f"variants.table1.{key} is no key we know" in str(error)
    assert error.line == line


def test_a_variant_changes_no_wires(folder: Path):
    file = folder / "platform.toml"
    text = file.read_text(encoding="utf-8")
    wires = "[variants.table1.hardware]\nport = 1\n\n[variants.table1]"
    file.write_text(text.replace("[variants.table1]", wires, 1), encoding="utf-8")
    with pytest.raises(PlatformError, match=r"platform\.toml:\d+: .*hardware is not a variant's"):
        load_platform(f"{folder}:table1")


def test_an_unphysical_variant_is_refused_at_its_own_line(folder: Path):
    line = edit(folder, "inertia = [2.93, 12.178, 12.288,", "inertia = [2.93, 12.178, 22.288,")
    assert refusal(folder, "table3").line == line
    assert load_platform(folder).name == "sads", "the base is as good as before"


def test_a_missing_table_is_named(folder: Path):
    edit(folder, "[simulation]", "[notes]")
    assert "simulation is missing; add it" in str(refusal(folder))


def test_a_misspelt_table_is_asked_about_at_its_line(folder: Path):
    line = edit(folder, "[simulation]", "[simulations]")
    error = refusal(folder)
    assert "simulations is no key we know; is it meant to be 'simulation'?" in str(error)
    assert error.line == line


def test_an_mjcf_that_mujoco_refuses_is_reported_with_mujocos_reason(folder: Path):
    file = folder / "platform.xml"
    file.write_text(file.read_text().replace('mass="78.5"', 'mass="-78.5"'))
    error = refusal(folder)
    assert re.search(r"platform\.xml: MuJoCo refuses it: .*mass", str(error))


def test_a_variant_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(UnknownName, match=r"no variant named 'tabel1' \(did you mean 'table1'"):
        load_platform("sads:tabel1")


def test_a_folder_without_platform_toml_is_no_platform(tmp_path: Path):
    with pytest.raises(UnknownName, match="no platform named"):
        load_platform(tmp_path)


@pytest.mark.parametrize("name", model_names())
def test_every_shipped_machine_and_variant_loads(name: str):
    base = load_platform(name)
    for variant in variants_of(base.folder):
        assert load_platform(f"{name}:{variant}").name == f"{base.name}:{variant}"


@pytest.mark.parametrize(
    "limit",
    ["momentum_limit = 5.0", "torque_limit = 0.5", "force_limit = 1.0", "angle = 0.52", "range ="],
)
def test_a_limit_may_be_infinite_where_that_means_none(folder: Path, limit: str):
    edit(folder, limit, f"{limit.partition('=')[0]}= inf #")
    load_platform(folder)


def test_a_variant_changes_only_what_it_states():
    base, heavy = load_platform("sads"), load_platform("sads:table1")
    assert heavy.mass == base.mass
    np.testing.assert_array_equal(heavy.inertia, base.inertia)
    assert not np.array_equal(heavy.center_of_mass_offset, base.center_of_mass_offset)


def test_latitude_and_heading_are_the_earths_rotation(folder: Path):
    place = f"[environment]\nlatitude = {0.25 * np.pi}\nheading = {0.5 * np.pi}\n"
    edit(folder, "[environment]\n", place)
    (stated,) = load_platform(str(folder)).effects
    assert stated.name == "earth_rotation"
    # x to the east, so y to the north
    expected = 7.292115e-5 * np.sqrt(0.5) * np.array([0.0, 1.0, 1.0])
    assert np.allclose(stated.values["rate"], expected, rtol=1e-12, atol=1e-18)
    edit(folder, place.splitlines(keepends=True)[1], "")
    with pytest.raises(PlatformError, match="heading stands without latitude; give both"):
        load_platform(str(folder))


def test_a_folder_does_not_stand_in_for_the_shipped_machine_of_its_name(tmp_path, monkeypatch):
    other = tmp_path / "cubesat"
    shutil.copytree(library("models") / "sads", other, ignore=shutil.ignore_patterns("logs"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"'cubesat' is a shipped machine, and a folder here; say"):
        load_platform("cubesat")
    with pytest.raises(UsageError, match="and a folder here"):
        load_platform("cubesat:heavy_masses")
    assert load_platform("./cubesat").name == "sads"
    assert load_platform("sads").name == "sads"
    monkeypatch.chdir(library("models"))
    assert load_platform("cubesat").name == "cubesat", "it is the same folder"
