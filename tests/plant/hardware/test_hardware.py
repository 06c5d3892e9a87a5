"""The hardware plant merges what devices give, gives each its share, and fails to the safe side."""

import sys
import time
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.clock import WallClock
from twin.controller.load import load_controller
from twin.errors import DeviceError, UnknownName, UsageError
from twin.estimators.named import load_estimator
from twin.loop import Ended, Outcome, fly
from twin.plant.devices.device import Counters, Device, DeviceCommand, Sample, missing
from twin.plant.devices.link import Channel, Schema
from twin.plant.devices.microcontroller import MicrocontrollerSettings
from twin.plant.guard.guarded import Guarded, Held
from twin.plant.guard.rules import guard_settings
from twin.plant.hardware import HardwarePlant
from twin.plant.hardware_setup import HardwareSetup, Route
from twin.platform import Platform, load_platform
from twin.reference import Hold
from twin.rotation import from_rotation_vector

XYZ = (0, 1, 2)


class Fake(Device):
    """Gives what it is fed, and keeps what it is told."""

    def __init__(self, streams: dict[str, int], commands: dict[str, int]) -> None:
        self.streams, self.commands = streams, commands
        self.counters, self.notes, self.fault = Counters(), deque(), ""
        self.fed: list[Sample] = []
        self.told: list[DeviceCommand] = []
        self.did: list[str] = []
        self.refuses = ""

    def feed(self, stream: str, value: list[float], age: float = 0.0, **changes) -> None:
        self.fed.append(Sample(stream, tuple(value), time.monotonic() - age, **changes))

    def connect(self) -> None:
        self.did.append("connect")
        if self.refuses == "connect":
            raise DeviceError("fake", "it is not there", "look")

    def configure(self) -> None:
        self.did.append("configure")

    def arm(self) -> None:
        self.did.append("arm")
        if self.refuses == "arm":
            raise DeviceError("fake", "it will not", "look")

    def read(self) -> list[Sample]:
        fed, self.fed = self.fed, []
        return fed

    def write(self, command: DeviceCommand) -> DeviceCommand:
        if self.refuses == "write":
            raise DeviceError("fake", "it is gone", "look")
        self.told.append(dict(command))
        return {name: np.round(value, 3) for name, value in command.items()}

    def safe_stop(self, floating: bool) -> None:
        self.did.append(f"safe_stop {floating}")

    def disarm(self) -> None:
        self.did.append("disarm")

    def close(self) -> None:
        self.did.append("close")


@pytest.fixture
def sads() -> Platform:
    return load_platform("sads")


@pytest.fixture
def imu() -> Fake:
    return Fake({"gyro": 3}, {})


@pytest.fixture
def stages() -> Fake:
    return Fake({"stage_position": 3}, {"command_stage_position": 3})


@pytest.fixture
def plant(sads: Platform, imu: Fake, stages: Fake) -> HardwarePlant:
    turned = np.array([0.0, 1.0, 0.0, 0.0])
    order = (2, 0, 1)
    setup = HardwareSetup(
        {},
        (
            Route("gyro", "imu", "gyro", XYZ, turned),
            Route("stage_position", "stages", "stage_position", order, None, -1.0),
        ),
        (Route("command_stage_position", "stages", "command_stage_position", order, None, -1.0),),
        guard_settings(sads),
        None,
    )
    plant = HardwarePlant(sads, setup, {"imu": imu, "stages": stages})
    plant.read(0.0)
    return plant


WISH = {"command_stage_position": np.array([[0.01, 0.02, 0.03]])}


def test_streams_of_several_rates_come_in_order_in_body_axes_and_machine_order(plant, imu, stages):
    imu.feed("gyro", [0.1, 0.2, 0.3], age=0.01)
    imu.feed("gyro", [0.4, 0.5, 0.6], age=0.03)
    imu.feed("gyro", [0.7, 0.8, 0.9], latency=0.02)
    stages.feed("stage_position", [0.03, 0.01, 0.02])
    stages.feed("temperature", [300.0])
    reading = plant.read(0.05)
    gyro = reading.streams["gyro"]
    np.testing.assert_allclose(
        gyro.value[0], [[0.4, -0.5, -0.6], [0.7, -0.8, -0.9], [0.1, -0.2, -0.3]]
    )
    assert np.all(np.diff(gyro.time[0]) > 0.0), "an old value that came late stands where it was"
    np.testing.assert_allclose(reading.streams["stage_position"].value[0], [[-0.01, -0.02, -0.03]])
    assert set(reading.streams) == {"gyro", "stage_position"}
    assert plant.read(0.1).streams == {}, "a tick without a sample repeats nothing"


def test_what_is_missing_or_beyond_the_sensors_range_is_not_valid(sads, imu, stages, plant):
    gyro = replace(sads.sensors["gyro"], range=1.0)
    narrow = replace(sads, sensors=dict(sads.sensors) | {"gyro": gyro})
    plant = HardwarePlant(narrow, plant.setup, {"imu": imu, "stages": stages})
    plant.read(0.0)
    imu.feed("gyro", [0.1, 0.1, 0.1], age=0.02)
    imu.fed.append(missing("gyro", 3, time.monotonic() - 0.01, "nothing came"))
    imu.feed("gyro", [0.1, -1.0, 0.1])
    valid = plant.read(0.05).streams["gyro"].valid
    assert valid.tolist() == [[True, False, False]]


def test_parts_that_come_one_after_the_other_make_one_row_when_all_are_there(plant, stages):
    stages.feed("stage_position", [-0.01], age=0.03, part="s1")
    stages.feed("stage_position", [-0.03], age=0.02, part="s3")
    assert "stage_position" not in plant.read(0.05).streams
    stages.feed("stage_position", [-0.02], age=0.01, part="s2")
    samples = plant.read(0.1).streams["stage_position"]
    np.testing.assert_allclose(samples.value[0], [[0.01, 0.02, 0.03]])
    assert samples.time.shape == (1, 1)


def test_until_it_is_engaged_nothing_leaves(plant, stages):
    applied = plant.write(WISH)
    assert stages.told == []
    assert not applied["command_stage_position"].any()


def test_each_device_gets_its_share_and_what_it_does_comes_back(plant, imu, stages):
    plant.engage()
    applied = plant.write({"command_stage_position": np.array([[0.01, 0.0204, 0.03]])})
    np.testing.assert_allclose(stages.told[0]["command_stage_position"], [-0.03, -0.01, -0.0204])
    np.testing.assert_allclose(applied["command_stage_position"], [[0.01, 0.02, 0.03]])
    assert imu.told == []
    held = plant.write({})
    assert stages.told[1] == {}, "and yet told, for it renews what it holds"
    np.testing.assert_allclose(held["command_stage_position"], [[0.01, 0.02, 0.03]])


def test_a_device_that_is_lost_makes_all_of_them_safe(plant, imu, stages):
    plant.engage()
    imu.fault = "imu: lost /dev/ttyUSB0"
    plant.read(0.05)
    assert plant.stopped == {0: "imu: lost /dev/ttyUSB0"}
    assert "safe_stop True" in stages.did
    plant.write(WISH)
    assert stages.told == []


def test_a_device_that_refuses_a_command_makes_all_of_them_safe(plant, stages):
    plant.engage()
    stages.refuses = "write"
    plant.write(WISH)
    assert plant.stopped == {0: "fake: it is gone; look"}
    assert "safe_stop True" in stages.did


def test_a_command_that_is_not_finite_never_leaves(plant, stages):
    plant.engage()
    plant.write({"command_stage_position": np.array([[0.01, np.nan, 0.03]])})
    assert stages.told == []
    assert "command_stage_position is [0.01, nan, 0.03]" in plant.stopped[0]


def test_if_one_device_is_not_there_none_stays_open(plant, imu, stages):
    stages.refuses = "connect"
    with pytest.raises(DeviceError, match="it is not there"):
        plant.connect()
    assert imu.did == ["connect", "configure", "close"]


def test_if_one_device_cannot_be_armed_none_stays_armed(plant, imu, stages):
    stages.refuses = "arm"
    with pytest.raises(DeviceError, match="it will not"):
        plant.engage()
    assert imu.did == ["arm", "disarm"]
    assert not plant.armed


def test_wiring_that_a_device_lacks_is_told_before_a_port_is_opened(sads, imu, plant):
    with pytest.raises(UnknownName, match="no stream of stages named 'stage_position'"):
        HardwarePlant(sads, plant.setup, {"imu": imu, "stages": imu})
    narrow = Fake({"stage_position": 2}, {"command_stage_position": 3})
    with pytest.raises(UsageError, match="stages has 2 columns of stage_position.*takes 3"):
        HardwarePlant(sads, plant.setup, {"imu": imu, "stages": narrow})


# ---- over a pseudo-terminal

CHANNELS = (
    Channel("gyro", "rad/s", 3),
    Channel("attitude", "1", 4),
    Channel("accelerometer", "m/s^2", 3),
    Channel("magnetometer", "T", 3),
    Channel("stage_position", "m", 3, "int32", 2e-6),
    Channel("command_stage_position", "m", 3, "int32", 2e-6, "hold"),
    Channel("command_dipole", "A m^2", 3, safe="zero"),
)


def flown(tmp_path: Path, duration: float, *faults) -> tuple[Outcome, Guarded]:
    """A law on the wall's clock, over an emulated Feather that stands still."""
    from twin.emulate.line import EmulatedLine
    from twin.emulate.microcontroller import EmulatedMicrocontroller, EmulatedStages

    cubesat = load_platform("cubesat")
    rates = {c.stream: 20.0 for c in CHANNELS if not c.commanded}
    feather = EmulatedMicrocontroller(
        Schema(CHANNELS), rates, stages=EmulatedStages(3, speed=0.002, acceleration=0.02)
    )
    feather.shown = {
        "attitude": from_rotation_vector(np.array([0.03, 0.02, 0.0])),
        "accelerometer": np.array([0.0, 0.0, 9.81]),
        "gyro": np.array([0.002, -0.001, 0.0]),
    }
    with EmulatedLine(feather, tmp_path / "feather", faults) as line:
        settings = MicrocontrollerSettings(name="feather", port=str(line.link), channels=CHANNELS)
        routes = [Route(c.stream, "feather", c.stream, tuple(range(c.columns))) for c in CHANNELS]
        setup = HardwareSetup(
            {"feather": settings},
            tuple(route for route in routes if not route.stream.startswith("command_")),
            tuple(route for route in routes if route.stream.startswith("command_")),
            replace(guard_settings(cubesat), watchdog=1.0),
            Path("bench.toml"),
            # what stands behind the board shows constants, without the noise of the real sensors
            {stream: {"frozen_after": 0} for stream in feather.shown},
        )
        hardware = HardwarePlant(cubesat, setup)
        with Guarded(hardware, setup.guard, calibrated=setup.calibration is not None) as guard:
            hardware.connect()
            time.sleep(0.2)
            guard.read(0.0)
            guard.arm("arm", held=Held.floating)
            outcome = fly(
                guard,
                load_estimator("passthrough"),
                load_controller("mass_magnetic_pid"),
                Hold(),
                WallClock(),
                duration=duration,
            )
    return outcome, guard


needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")


@needs_pty
@pytest.mark.wall_clock
def test_a_law_flies_on_an_emulated_board_as_on_any_plant(tmp_path: Path):
    outcome, guard = flown(tmp_path, 1.5)
    assert outcome.ended is Ended.done, outcome.reason
    position = guard.seen.stage_position
    assert position is not None
    assert np.abs(position).max() > 0.0, "the law has moved a mass"


@needs_pty
@pytest.mark.wall_clock
def test_a_board_that_falls_silent_ends_the_run_safely_with_the_reason(tmp_path: Path):
    from twin.emulate.emulated import Fault

    outcome, _ = flown(tmp_path, 6.0, Fault("mute", 1.5, value=20.0))
    assert outcome.ended is Ended.safe_stop
    assert "is stale: nothing valid for" in outcome.reason or "acknowledged" in outcome.reason
    assert outcome.duration < 4.0


@needs_pty
@pytest.mark.wall_clock
def test_a_board_that_restarts_ends_the_run_safely_with_the_reason(tmp_path: Path):
    from twin.emulate.emulated import Fault

    outcome, _ = flown(tmp_path, 6.0, Fault("reset", 1.5))
    assert outcome.ended is Ended.safe_stop
    assert "it has restarted" in outcome.reason or "not armed" in outcome.reason
