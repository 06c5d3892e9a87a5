"""Every kind of mistake in a platform folder gets one sentence: file, what, value and remedy.

The tables of the files beside this one are gone through, and some more that need the MJCF, what it
is compiled to, or `twin check`. With -s each sentence is printed.
"""

import re
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.platform.test_load import WRONG as IN_SADS
from tests.platform.test_load_parts import WRONG as IN_PARTS
from twin.check import check_platform
from twin.errors import PlatformError
from twin.library import library
from twin.model import compile_model
from twin.platform import load_platform


class Mistake(NamedTuple):
    """What is replaced in a copy of a shipped machine."""

    machine: str
    file: str
    old: str
    new: str
    value: str = ""
    """What of it must be told; a number or word of `new` that `old` has not, if not given."""


BUS = '<body name="bus" pos="0 0 1.2">'
MORE = {
    "noise is not stated": Mistake("sads", "platform.toml", "noise = 1e-3 ", "# ", "noise"),
    "imbalance at a coarse step": Mistake(
        "sads",
        "platform.toml",
        "[tilt_stop]",
        "[effects.wheel_imbalance]\nstatic = 1e-5\ndynamic = 1e-6\n[tilt_stop]",
        "0.01 s",
    ),
    "effect is unknown": Mistake(
        "sads", "platform.toml", "[tilt_stop]", "[effects.bearing_swirl]\nk = 1\n[tilt_stop]"
    ),
    "entity bomb": Mistake(
        "sads", "platform.xml", "<mujoco ", '<!DOCTYPE m [<!ENTITY a "aa">]>\n<mujoco ', "type"
    ),
    "include from outside": Mistake(
        "sads", "platform.xml", "<worldbody>", '<include file="../a.xml"/><worldbody>'
    ),
    "mesh from outside": Mistake(
        "sads", "platform.xml", "<asset>", '<asset><mesh name="m" file="/etc/passwd"/>'
    ),
    "gyro on a hinge": Mistake(
        "dfki_pendulum",
        "platform.toml",
        "[sensors.joint_angle]",
        "[sensors.gyro]\nrate = 100\nnoise = 1e-3\n[sensors.joint_angle]",
        "gyro",
    ),
    "attitude rounded": Mistake(
        "sads", "platform.toml", "[sensors.attitude]", "[sensors.attitude]\nresolution = 0.1"
    ),
    "half a pole": Mistake(
        "sads", "platform.toml", "[sensors.gyro]", "[sensors.gyro]\ncutoff = 10\norder = 2.5"
    ),
    "no XML": Mistake("sads", "platform.xml", "</worldbody>", "</world>", "mismatched tag"),
    "negative mass in the MJCF": Mistake(
        "sads", "platform.xml", 'mass="78.5"', 'mass="-78.5"', "'bus'"
    ),
    "thruster's gear": Mistake(
        "sads", "platform.xml", 'gear="0 0 1 0 0 0"', 'gear="0 0 2 0 0 0"', "2.0"
    ),
    "rotor along its gimbal": Mistake(
        "tas2", "platform.xml", 'name="r1" axis="0 -1 0"', 'name="r1" axis="1 0 0"', "'g1'"
    ),
    "parts heavier than the whole": Mistake(
        "sads", "platform.toml", "mass = 95.0", "mass = 15.0", "15 kg"
    ),
    "axis is not unit": Mistake(
        "sads", "platform.xml", 'name="s1" axis="1 0 0"', 'name="s1" axis="2 0 0"', "s1"
    ),
}
MISTAKES = (
    {kind: Mistake("sads", "platform.toml", *row[:2]) for kind, row in IN_SADS.items()}
    | {kind: Mistake(row[0], "platform.toml", *row[1:3]) for kind, row in IN_PARTS.items()}
    | MORE
)
TOLD = {
    "mass is true": "is True",
    "inertia has five entries": "is [3.0, 12.0, 12.0, 0.0, 0.0]",
    "inertia is not positive": "principal moments [-2.5623, 12.0, 17.5623]",
    "travel is reversed": "from 0.1 to -0.1 m",
    "sensor measures nothing": "sensors.joint_angle",
    "no tanks to measure": "sensors.gas_pressure",
    "no stage floats": "sensors.position",
    "attitude is filtered": "sensors.attitude.cutoff",
    "stage has two joints": "is ['x', 'y']",
    "pitch axis is upright": "is [0.0, 0.0, 1.0]",
    "file is not TOML": "line 21",
    "machine has no name": "is ' '",
    "two stops": "0.5 rad",
}
"""Of those whose value is no word of its own, or not the matter."""


def sentence(mistake: Mistake, folder: Path) -> str:
    """What is said first on loading, compiling or checking it."""
    file = shutil.copytree(library("models") / mistake.machine, folder) / mistake.file
    before, found, after = file.read_text().partition(mistake.old)
    assert found, f"{mistake.old!r} is not in the file: mend the test"
    file.write_text(before + mistake.new + after)
    try:
        platform = load_platform(folder)
        compile_model(platform)
    except PlatformError as error:
        return str(error)
    wrong = [finding.sentence for finding in check_platform(platform) if not finding.ok]
    return f"{file}: {wrong[0]}" if wrong else "nothing was found"


def tells_of(kind: str, mistake: Mistake, said: str) -> bool:
    value = mistake.value or TOLD.get(kind, "")
    if value:
        return value in said
    tokens = set(re.findall(r"[-\w.]+", mistake.new)) - set(re.findall(r"[-\w.]+", mistake.old))
    return any(form in said for token in tokens for form in (token, shown(token)))


def shown(token: str) -> str:
    try:
        return f"{float(token):g}"
    except ValueError:
        return token


@pytest.mark.usefixtures("brief_check")
@pytest.mark.parametrize("kind", MISTAKES)
def test_a_mistake_gets_a_sentence_with_file_what_value_and_remedy(kind: str, tmp_path: Path):
    mistake = MISTAKES[kind]
    said = sentence(mistake, tmp_path / mistake.machine).replace(f"{tmp_path}/", "")
    print(f"{kind}: {said}")
    assert re.match(rf"{mistake.machine}/platform\.(toml|xml):", said)
    assert "; " in said, "a remedy follows"
    assert tells_of(kind, mistake, said)
    assert "\n" not in said


def test_there_are_more_than_thirty_kinds():
    assert len(MISTAKES) > 30
