"""The driver of our own link over a pseudo-terminal, against an emulated board in a process."""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.plant.devices.hosts import killed
from twin.errors import CommandError, DeviceError, UnknownName
from twin.plant.devices.device import Sample
from twin.plant.devices.link import (
    Channel,
    Event,
    FarEndState,
    MessageType,
    Parser,
    SampleRows,
    Schema,
)
from twin.plant.devices.microcontroller import Microcontroller, MicrocontrollerSettings

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals"),
    pytest.mark.wall_clock,
]

if sys.platform != "win32":
    from twin.emulate.emulated import Fault
    from twin.emulate.line import EmulatedLine
    from twin.emulate.microcontroller import EmulatedMicrocontroller, EmulatedStages

CHANNELS = (
    Channel("gyro", "rad/s", 3),
    Channel("stage_position", "m", 3, "int32", 2e-6),
    Channel("command_stage_position", "m", 3, "int32", 2e-6, "hold"),
    Channel("command_dipole", "A m^2", 3, safe="zero"),
)
RATES = {"gyro": 50.0, "stage_position": 20.0}


def board(channels: tuple[Channel, ...] = CHANNELS, **settings) -> "EmulatedMicrocontroller":
    stages = EmulatedStages(3, speed=0.02, acceleration=0.1)
    emulated = EmulatedMicrocontroller(Schema(channels), RATES, stages=stages, **settings)
    emulated.shown["gyro"] = np.array([0.25, -0.5, 1.0])
    return emulated


@pytest.fixture
def line(tmp_path: Path) -> Iterator["EmulatedLine"]:
    with EmulatedLine(board(drift=5e-5), tmp_path / "feather") as emulated:
        yield emulated


@pytest.fixture
def device(line: "EmulatedLine") -> Iterator[Microcontroller]:
    with MicrocontrollerSettings(
        name="feather", port=str(line.link), channels=CHANNELS, clock_period=0.1
    ).session() as session:
        session.connect()
        session.configure()
        yield session


def until(done: Callable[[], object], longest: float = 30.0) -> bool:
    end = time.monotonic() + longest
    while time.monotonic() < end:
        # once a round: to read is to take
        if done():
            return True
        time.sleep(0.005)
    return False


def renewed(device: Microcontroller, duration: float, **command) -> list[Sample]:
    """Write twenty times a second; what was read meanwhile."""
    samples: list[Sample] = []
    end = time.monotonic() + duration
    values = {f"command_{name}": np.array(value) for name, value in command.items()}
    while time.monotonic() < end:
        device.write(values)
        time.sleep(0.05)
        samples += device.read()
    return samples


def test_a_session_measures_moves_and_says_what_was_applied(device: Microcontroller):
    device.arm()
    applied = device.write({"command_stage_position": np.array([0.0010005, 0.0, -0.0005])})
    np.testing.assert_allclose(applied["command_stage_position"], [0.001, 0.0, -0.0005])
    samples = renewed(device, 0.8, stage_position=[0.001, 0.0, -0.0005])
    places = [sample for sample in samples if sample.stream == "stage_position"]
    np.testing.assert_allclose(places[-1].value, [0.001, 0.0, -0.0005])
    gyro = [sample for sample in samples if sample.stream == "gyro"]
    assert {sample.value for sample in gyro} == {(0.25, -0.5, 1.0)}
    assert all(sample.valid for sample in samples)
    steps = np.diff([sample.device_time for sample in gyro])
    assert np.median(steps) == pytest.approx(0.02, rel=1e-2), "fifty a second by its clock"
    assert device.armed


def test_the_clocks_are_fitted_and_every_sample_has_its_age(device: Microcontroller):
    samples: list[Sample] = []
    until(lambda: samples.extend(device.read()) or len(samples) > 60)
    clock = device.clock
    assert clock is not None
    assert clock.half_width < 0.05
    last = samples[-1]
    assert last.device_time is not None
    age = last.host_time - clock.host(last.device_time)
    assert -clock.half_width - 1e-3 < age < 0.1
    assert last.latency == pytest.approx(max(age, 0.0), abs=clock.half_width + 1e-3)


def test_when_nothing_is_written_the_far_end_is_safe_and_says_so(device: Microcontroller):
    device.arm()
    renewed(device, 0.2, dipole=[1.0, 0.0, 0.0])
    assert until(lambda: not device.armed)
    assert device.notes[-1] == "feather: no new set-point came in time on channel 3; it is safe"
    with pytest.raises(DeviceError, match=r"it is not armed \(no new set-point.*\); arm it"):
        device.write({"command_dipole": np.zeros(3)})
    device.arm()
    renewed(device, 0.1, dipole=[0.0, 0.0, 0.0])


def test_what_is_absent_from_a_command_is_renewed_with_its_last_value(device: Microcontroller):
    device.arm()
    device.write({"command_dipole": np.array([0.5, 0.0, 0.0])})
    end = time.monotonic() + 0.6
    while time.monotonic() < end:
        applied = device.write({})
        time.sleep(0.05)
    assert device.armed
    np.testing.assert_array_equal(applied["command_dipole"], [0.5, 0.0, 0.0])


@pytest.mark.parametrize(
    ("command", "error", "sentence"),
    [
        ({"command_dipol": np.zeros(3)}, UnknownName, "command_dipole"),
        ({"command_dipole": np.zeros(2)}, CommandError, "it takes 3 finite numbers"),
        ({"command_dipole": np.array([0.0, np.nan, 0.0])}, CommandError, "it takes 3 finite"),
    ],
)
def test_a_command_that_it_cannot_take_is_refused(
    device: Microcontroller, command: dict, error: type[Exception], sentence: str
):
    device.arm()
    with pytest.raises(error, match=sentence):
        device.write(command)


def test_a_safe_stop_works_at_once_and_more_than_once(device: Microcontroller):
    device.arm()
    renewed(device, 0.1, dipole=[1.0, 0.0, 0.0])
    device.safe_stop(floating=True)
    device.safe_stop(floating=True)
    assert until(lambda: any("told to be safe" in note for note in device.notes))
    device.disarm()
    device.close()
    device.safe_stop(floating=False)


@pytest.mark.parametrize("fault", ["reset", "power_cycle"])
def test_a_restart_is_a_fault_and_connecting_anew_works_twice(
    line: "EmulatedLine", device: Microcontroller, fault: str
):
    for _ in range(2):
        device.arm()
        renewed(device, 0.1, dipole=[1.0, 0.0, 0.0])
        line.inject(Fault(fault))
        assert until(lambda: device.fault)
        assert device.fault == "feather: it has restarted; connect anew, then arm it again"
        with pytest.raises(DeviceError, match="restarted"):
            device.write({})
        with pytest.raises(DeviceError, match="restarted"):
            device.arm()
        device.connect()
        device.configure()
        assert not device.armed
        assert until(lambda: any(sample.valid for sample in device.read()))


def test_unplugged_it_is_a_fault_and_plugged_in_again_it_works_twice(
    line: "EmulatedLine", device: Microcontroller
):
    for _ in range(2):
        device.arm()
        device.write({"command_dipole": np.array([1.0, 0.0, 0.0])})
        line.inject(Fault("unplug", duration=0.8))
        assert until(lambda: device.fault)
        assert "feather: lost" in device.fault
        samples = device.read()
        assert not samples[-1].valid
        with pytest.raises(DeviceError):
            device.connect()
        assert until(line.link.exists)
        device.connect()
        device.configure()
        assert until(lambda: any(sample.valid for sample in device.read()))


def test_silence_makes_samples_that_are_not_valid_and_never_the_last_value(
    line: "EmulatedLine", device: Microcontroller
):
    assert until(device.read)
    line.inject(Fault("mute", value=1.0))
    time.sleep(0.1)
    device.read()
    samples: list[Sample] = []
    assert until(lambda: samples.extend(device.read()) or samples)
    assert not any(sample.valid for sample in samples)
    assert all(np.isnan(sample.value).all() for sample in samples)
    assert "feather: nothing heard for 0.5" in samples[0].reason
    assert device.counters.timeouts == 1
    assert until(lambda: any(sample.valid for sample in device.read()))


def test_a_far_end_that_no_longer_answers_is_told_to_be_safe(
    line: "EmulatedLine", device: Microcontroller
):
    device.arm()
    renewed(device, 0.1, dipole=[1.0, 0.0, 0.0])
    line.inject(Fault("mute", value=2.0))
    with pytest.raises(DeviceError, match="has not acknowledged a set-point for 0.25 s"):
        renewed(device, 2.0, dipole=[1.0, 0.0, 0.0])
    assert not device.armed


def test_a_fault_of_the_far_end_must_be_looked_at(line: "EmulatedLine", device: Microcontroller):
    line.inject(Fault("fault", value=2.0))
    assert until(lambda: "feather: LIMIT (2)" in device.notes)
    with pytest.raises(DeviceError, match="reports a fault; look at the machine, then disarm"):
        device.arm()
    device.disarm()
    assert until(lambda: len(device.notes) >= 3)
    device.arm()


def test_a_noisy_line_lets_nothing_false_through(line: "EmulatedLine", device: Microcontroller):
    line.inject(Fault("garble", duration=1.0, share=0.01))
    line.inject(Fault("drop", duration=1.0, share=0.01))
    samples: list[Sample] = []
    until(lambda: samples.extend(device.read()) or False, 1.2)
    assert device.counters.bad_checksums + device.counters.resyncs > 5
    assert device.counters.gaps > 5
    gyro = {sample.value for sample in samples if sample.stream == "gyro" and sample.valid}
    assert gyro == {(0.25, -0.5, 1.0)}
    assert not device.fault


def test_another_schema_is_refused_with_both_hashes(tmp_path: Path):
    with EmulatedLine(board(CHANNELS[:3], name="old"), tmp_path / "old") as line:
        settings = MicrocontrollerSettings(name="feather", port=str(line.link), channels=CHANNELS)
        there, here = Schema(CHANNELS[:3]).hash, Schema(CHANNELS).hash
        sentence = f"'old' carries schema {there:08X}, .* make {here:08X}; flash the firmware"
        for _ in range(2):
            with settings.session() as session, pytest.raises(DeviceError, match=sentence):
                session.connect()


def test_a_board_that_says_nothing_is_asked_about(tmp_path: Path):
    with EmulatedLine(board(), tmp_path / "dead", [Fault("silence")]) as line:
        settings = MicrocontrollerSettings(name="feather", port=str(line.link), channels=CHANNELS)
        with settings.session() as session, pytest.raises(DeviceError, match="0 bytes.*powered"):
            session.connect()


def test_another_baud_rate_is_guessed_at(tmp_path: Path):
    with EmulatedLine(board(), tmp_path / "fast") as line:
        settings = MicrocontrollerSettings(
            name="feather", port=str(line.link), channels=CHANNELS, baud=230_400
        )
        with settings.session() as session, pytest.raises(DeviceError, match="at 230400 baud"):
            session.connect()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"baud": 1200}, "feather: 1200 baud would put a SAMD21 into its bootloader"),
        ({"valid_for": 0.0}, "set valid_for to some control periods"),
        ({"valid_for": 100.0}, "at most 65 s"),
    ],
)
def test_dangerous_settings_are_refused_before_a_port_is_opened(change: dict, sentence: str):
    settings = {"name": "feather", "port": "/dev/null", "channels": CHANNELS} | change
    with pytest.raises(DeviceError, match=sentence):
        MicrocontrollerSettings(**settings).session()


def test_set_points_that_live_longer_than_the_far_end_allows_are_refused(line: "EmulatedLine"):
    settings = MicrocontrollerSettings(
        name="feather", port=str(line.link), channels=CHANNELS, valid_for=0.6
    )
    with settings.session() as session:
        session.connect()
        session.configure()
        with pytest.raises(DeviceError, match="600 ms, it takes at most 500 ms; lower valid_for"):
            session.arm()


def test_before_it_is_configured_it_takes_nothing(line: "EmulatedLine"):
    settings = MicrocontrollerSettings(name="feather", port=str(line.link), channels=CHANNELS)
    with settings.session() as session:
        with pytest.raises(DeviceError, match="not configured"):
            session.arm()
        session.connect()
        session.connect()
        assert session.read() == []


HOST = """
import sys, time
import numpy as np
from tests.plant.devices.test_microcontroller import CHANNELS
from twin.plant.devices.microcontroller import MicrocontrollerSettings
device = MicrocontrollerSettings(name="feather", port=sys.argv[1], channels=CHANNELS).session()
device.connect()
device.configure()
device.arm()
print("armed", flush=True)
while True:
    device.write({"command_stage_position": np.array([0.02, 0.0, 0.0])})
    time.sleep(0.05)
"""


def test_a_host_that_is_killed_leaves_the_far_end_safe_by_itself(tmp_path: Path):
    log = tmp_path / "bytes.log"
    with EmulatedLine(board(), tmp_path / "feather", log=log) as line:
        killed(HOST, line.link, "armed", after=0.5)
        time.sleep(1.0)
    said = [row[1:] for row in log.read_text().splitlines() if row.startswith(">")]
    frames = Parser(Schema(CHANNELS), "far end").feed(bytes.fromhex("".join(said)))
    last = max(frame.last_received for frame in frames)
    heard = next(frame.time_us for frame in frames if frame.last_received == last)
    events = [(f, Event.unpacked(f.payload)) for f in frames if f.type == MessageType.event]
    expired, event = events[-1]
    assert event == Event("EXPIRED", 2.0)
    assert 0.15 < (expired.time_us - heard) * 1e-6 < 0.26, "valid_for is 0.25 s"
    assert frames[-1].state == FarEndState.safe
    places = [
        SampleRows.unpacked(frame.payload, Schema(CHANNELS))
        for frame in frames
        if frame.type == MessageType.samples and frame.payload[0] == 1
    ]
    np.testing.assert_array_equal(places[-1].value, places[-5].value)
    assert 1e-3 < places[-1].value[0, 0] < 0.02, "it moved, and holds where it stopped"
