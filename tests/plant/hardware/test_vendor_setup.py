"""Vendors' devices are read from [hardware.devices], key by key, or refused with file and line."""

import textwrap
from pathlib import Path

import pytest

from twin.config import read_toml
from twin.errors import PlatformError
from twin.plant.devices.device import DeviceSettings
from twin.plant.devices.kinds import KINDS
from twin.plant.devices.mdrive import MDriveSettings
from twin.plant.devices.mti import MtiSettings
from twin.plant.devices.solar2 import Solar2Settings

STAGES = """
kind = "mdrive"
baud = 38400
checksum = false
[[device.drives]]
address = "1"
part = "s1"
travel = [-0.025, 0.025]
speed = 0.02
[device.drives.inputs]
1 = [1, 0]
[[device.drives]]
address = "2"
part = "s2"
travel = [-0.025, 0.025]
speed = 0.02
"""
IMU = """
kind = "mti"
precision = "fp16.32"
device_id = 77
[device.rates]
gyro = 100
accelerometer = 50
"""
INCLINOMETER = """
kind = "solar2"
mode = "text"
rate = 10.0
x_first = false
"""


def read(text: str, folder: Path) -> DeviceSettings:
    path = folder / "platform.toml"
    path.write_text("[device]\n" + textwrap.dedent(text).lstrip(), encoding="utf-8")
    table = read_toml(path, PlatformError).table("device")
    found = KINDS[table.text("kind")](table, "it", "/dev/ttyUSB0")
    table.close()
    return found


def test_stages_on_one_line(tmp_path):
    found = read(STAGES, tmp_path)
    assert isinstance(found, MDriveSettings)
    assert (found.baud, found.checksum, found.echo_mode) == (38400, False, 1)
    assert [drive.part for drive in found.drives] == ["s1", "s2"]
    assert found.drives[0].inputs == {1: (1, 0)}
    assert found.drives[1].travel == (-0.025, 0.025)


def test_an_imu(tmp_path):
    found = read(IMU, tmp_path)
    assert isinstance(found, MtiSettings)
    assert (found.precision, found.device_id) == ("fp16.32", 77)
    assert found.rates == {"gyro": 100, "accelerometer": 50}


def test_an_inclinometer(tmp_path):
    found = read(INCLINOMETER, tmp_path)
    assert isinstance(found, Solar2Settings)
    assert (found.mode, found.rate, found.x_first) == ("text", 10.0, False)


@pytest.mark.parametrize(
    ("text", "old", "new", "said"),
    [
        (INCLINOMETER, '"text"', '"morse"', r"platform.toml:3: device.mode is 'morse'"),
        (INCLINOMETER, "false", '"no"', r"x_first is 'no'; say true or false"),
        (INCLINOMETER, "rate = 10.0", "rate = 1e6", r"device.mode and the keys beside it"),
        (INCLINOMETER, "x_first", "y_first", r"device.y_first is no key we know"),
        (IMU, "gyro = 100", "gyro = 99.5", r"device.rates.gyro is 99.5; give a whole number"),
        (IMU, "gyro = 100", "gyroscope = 100", r"no stream of an MTi named 'gyroscope'"),
        (STAGES, "1 = [1, 0]", "one = [1, 0]", r"device.drives.*inputs.one is no number"),
        (STAGES, 'address = "2"', 'address = "1"', r"each its own address"),
        (STAGES, "travel = [-0.025, 0.025]\n", "", r"travel is missing; add it"),
    ],
)
def test_a_wrong_setting_is_refused_where_it_stands(text, old, new, said, tmp_path):
    assert old in text
    with pytest.raises(PlatformError, match=said):
        read(text.replace(old, new, 1), tmp_path)
