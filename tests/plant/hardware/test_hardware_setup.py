"""[hardware] is read with its routes and its calibration, or refused with file and line."""

import textwrap
from pathlib import Path

import numpy as np
import pytest

from twin.errors import PlatformError
from twin.plant.devices.microcontroller import MicrocontrollerSettings
from twin.plant.hardware_setup import HardwareSetup, read_hardware
from twin.platform import load_platform
from twin.rotation import from_rotation_vector, rotate

GOOD = """
[hardware]
calibration = "bench.toml"

[hardware.guard]
max_balance_step = 0.002
stale_cycles = 3

[hardware.devices.feather]
kind = "microcontroller"
port = "/dev/serial/by-id/feather"
valid_for = 0.2
[[hardware.devices.feather.channels]]
stream = "gyro"
columns = 3
[[hardware.devices.feather.channels]]
stream = "stage_position"
columns = 3
number = "int32"
scale = 2e-6
[[hardware.devices.feather.channels]]
stream = "command_stage_position"
columns = 3
number = "int32"
scale = 2e-6
safe = "hold"

[hardware.streams.gyro]
device = "feather"
body_from_device = [0.0, 1.0, 0.0, 0.0]
[hardware.streams.stage_position]
device = "feather"
scale = -1.0
parts = ["s2", "s1", "s3"]
[hardware.commands.command_stage_position]
device = "feather"
scale = -1.0
parts = ["s2", "s1", "s3"]
"""
CALIBRATION = """
platform = "cubesat"
[streams.gyro]
bias = [0.01, 0.0, 0.0]
[streams.stage_position]
bias = [1e-3, 2e-3, 0.0]
scale = 1.01
"""


def read(folder: Path, text: str = GOOD, calibration: str = CALIBRATION) -> HardwareSetup:
    (folder / "hardware.toml").write_text(textwrap.dedent(text))
    (folder / "bench.toml").write_text(calibration)
    return read_hardware(load_platform("cubesat"), folder / "hardware.toml")


def test_devices_routes_guard_and_calibration_are_read(tmp_path: Path):
    setup = read(tmp_path)
    settings = setup.devices["feather"]
    assert isinstance(settings, MicrocontrollerSettings)
    assert (settings.port, settings.valid_for) == ("/dev/serial/by-id/feather", 0.2)
    assert [channel.unit for channel in settings.channels] == ["rad/s", "m", "m"]
    assert (setup.guard.max_balance_step, setup.guard.stale_cycles) == (0.002, 3)
    assert setup.calibration == tmp_path / "bench.toml"
    gyro, stages = setup.measured
    np.testing.assert_allclose(gyro.taken(np.array([0.11, 0.2, 0.3])), [0.1, -0.2, -0.3])
    assert stages.columns == (1, 0, 2)
    # s2 is the first of the device's, its bias the second of the calibration's
    np.testing.assert_allclose(
        stages.taken(np.array([3e-3, 3e-3, 1e-3])), [-1.01e-3, -2.02e-3, -1.01e-3]
    )


def test_a_loop_that_hangs_is_noticed_unless_the_laboratory_says_otherwise(tmp_path: Path):
    assert read(tmp_path).guard.watchdog == 1.0
    off = GOOD.replace("stale_cycles = 3", "watchdog = inf")
    assert read(tmp_path, off).guard.watchdog == np.inf


@pytest.mark.parametrize("number", [0, 1])
def test_what_is_given_to_a_device_is_what_would_be_taken_from_it(tmp_path: Path, number: int):
    setup = read(tmp_path)
    route = (setup.measured[0], setup.commanded[0])[number]
    value = np.array([0.3, -0.2, 0.1])
    np.testing.assert_allclose(route.taken(route.given(value)), value)
    np.testing.assert_allclose(route.given(route.taken(value)), value)


def test_a_position_and_its_command_share_their_calibration(tmp_path: Path):
    setup = read(tmp_path)
    value = np.array([1e-3, 2e-3, 3e-3])
    np.testing.assert_allclose(setup.commanded[0].taken(value), setup.measured[1].taken(value))


def test_an_attitude_is_turned_into_the_body(tmp_path: Path):
    turn = from_rotation_vector(np.array([0.3, -0.2, 0.5]))
    text = GOOD.replace('stream = "gyro"\ncolumns = 3', 'stream = "attitude"\ncolumns = 4')
    text = text.replace("[hardware.streams.gyro]", "[hardware.streams.attitude]")
    text = text.replace("[0.0, 1.0, 0.0, 0.0]", str(turn.tolist()))
    route = read(tmp_path, text, 'platform = "cubesat"').measured[0]
    world_from_device = from_rotation_vector(np.array([0.1, 0.7, -0.4]))
    world_from_body = route.taken(world_from_device)
    arrow = np.array([0.2, -1.0, 0.5])
    np.testing.assert_allclose(
        rotate(world_from_body, rotate(turn, arrow)), rotate(world_from_device, arrow), atol=1e-12
    )


def test_without_a_calibration_there_is_none(tmp_path: Path):
    setup = read(tmp_path, GOOD.replace('calibration = "bench.toml"', ""))
    assert setup.calibration is None


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[hardware", "[hardwear", "no \\[hardware\\]; say which device carries"),
        ('kind = "microcontroller"', 'kind = "arduino"', "kind is 'arduino'; use one of"),
        ('port = "/dev/serial/by-id/feather"', "", "port is missing"),
        ("valid_for = 0.2", "valid_for = 0", "valid_for is 0 s; it must lie between"),
        ("valid_for = 0.2", "baud = 1200", "baud is 1200, which resets a SAMD21"),
        ("valid_for = 0.2", "watchdog = 1", "watchdog is no key we know"),
        ("columns = 3", "columns = 99", "cannot travel: gyro: 99 columns"),
        ('safe = "hold"', "", "states safe = 'zero' or 'hold'"),
        ('device = "feather"', 'device = "imu"', "device is 'imu'; use one of 'feather'"),
        ("[0.0, 1.0, 0.0, 0.0]", "[0.0, 2.0, 0.0, 0.0]", "is no unit quaternion"),
        ("scale = -1.0", "scale = 0.0", "scale is zero"),
        ('["s2", "s1", "s3"]', '["s2", "s2", "s3"]', "use each of s1, s2, s3 once"),
        ('["s2", "s1", "s3"]', '["s2", "s1"]', "carry each of s1, s2, s3 once"),
        ("[hardware.streams.gyro]", "[hardware.streams.gyros]", "gyros is not known"),
        ("command_stage_position]", "command_wheel_torque]", "no command of this machine"),
        ("stale_cycles", "stale_cycle", "stale_cycle is no key we know"),
        ('"bench.toml"', '"bench_3.toml"', "there is no such file"),
    ],
)
def test_a_mistake_is_refused_with_its_sentence(tmp_path: Path, old: str, new: str, sentence: str):
    assert old in GOOD
    with pytest.raises(PlatformError, match=sentence):
        read(tmp_path, GOOD.replace(old, new))


def test_the_calibration_of_another_machine_is_refused(tmp_path: Path):
    with pytest.raises(PlatformError, match="platform is 'sads', this is cubesat; name this"):
        read(tmp_path, calibration='platform = "sads"')


@pytest.mark.parametrize("scale", ["0.0", "[1.0, 0.0, 1.0]"])
def test_a_calibration_that_makes_nothing_of_a_reading_is_refused(tmp_path: Path, scale: str):
    with pytest.raises(PlatformError, match=r"bench.toml:7: streams.stage_position.scale is zero"):
        read(tmp_path, calibration=CALIBRATION.replace("scale = 1.01", f"scale = {scale}"))


def test_a_platform_file_may_hold_its_hardware_itself():
    with pytest.raises(PlatformError, match="platform.toml.*no \\[hardware\\]"):
        read_hardware(load_platform("sads"))
