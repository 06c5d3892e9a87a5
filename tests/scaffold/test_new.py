"""A lab's own machine begins as a folder that checks and flies as it is."""

import math
from pathlib import Path

import numpy as np
import pytest

from twin.check import check_platform
from twin.cli.main import main
from twin.clock import SimulatedClock
from twin.errors import UsageError
from twin.flight import prepare
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.recording import Recording, Series
from twin.rotation import rotate
from twin.scaffold import KINDS, new_platform
from twin.stream.recorder import MemoryRecorder


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_passes_its_check(tmp_path: Path, kind: str):
    platform = load_platform(new_platform(tmp_path / "my-own", kind))
    assert platform.name == "my-own"
    assert [finding.sentence for finding in check_platform(platform) if not finding.ok] == []


@pytest.mark.parametrize("kind", KINDS)
def test_twin_new_then_twin_run_flies_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my-own", "--kind", kind]) == 0
    assert "twin run my-own" in capsys.readouterr().out
    assert main(["run", "my-own", "--duration", "1"]) == 0


def test_the_table_of_the_scaffold_is_levelled_by_its_masses(tmp_path: Path):
    folder = new_platform(tmp_path / "my-own", "table")
    tilted = InitialState(attitude=np.array([math.cos(0.02), math.sin(0.02), 0.0, 0.0]))
    flight = prepare(
        str(folder),
        controller="mass_pid",
        estimator="filter",
        plant="sim",
        reference=None,
        duration=120.0,
        initial=tilted,
        gains={"proportional": 0.3, "integral": 0.01, "derivative": 1.0},
    )
    recorder = MemoryRecorder(flight.platform)
    flight.fly(SimulatedClock(), [recorder])
    late = recorder.recording()["truth_attitude"].value[-20:]
    assert np.abs(late[:, 1:3]).max() < 0.005


def test_a_thrown_body_falls_and_keeps_its_angular_momentum(tmp_path: Path):
    """About its CM, which is off the point that motion capture sees."""
    folder = new_platform(tmp_path / "my-own", "free")
    start = InitialState(velocity=np.array([0.3, 0.0, 5.0]), rate_body=np.array([2.0, 0.5, 4.0]))
    flight = prepare(
        str(folder),
        controller="free_float",
        estimator="passthrough",
        plant="sim",
        reference=None,
        duration=1.0,
        initial=start,
    )
    recorder = MemoryRecorder(flight.platform)
    flight.fly(SimulatedClock(), [recorder])
    log, platform = recorder.recording(), flight.platform
    offset = platform.center_of_mass_offset / platform.mass
    outer = np.dot(offset, offset) * np.eye(3) - np.outer(offset, offset)
    about_center = platform.inertia - platform.mass * outer
    spin = platform.wheels[0].inertia * log["truth_wheel_speed"].value * platform.wheels[0].axis
    attitude, rate = log["truth_attitude"].value, log["truth_rate"].value
    momentum = rotate(attitude, rate @ about_center + spin)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(len(momentum), 0), atol=1e-7)
    time = log["truth_position"].time
    center = log["truth_position"].value + rotate(attitude, np.tile(offset, (len(attitude), 1)))
    moved = center - center[0]
    speed = start.velocity + np.cross(start.rate_body, offset)
    fallen = np.outer(time, speed) - 0.5 * 9.81 * np.outer(time**2, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(moved, fallen, atol=1e-7)


def test_a_folder_that_is_there_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "my-own").mkdir()
    assert main(["new", str(tmp_path / "my-own")]) == 2
    assert "is there already" in capsys.readouterr().err
    assert list((tmp_path / "my-own").iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["new", "sads"], "is a machine that is shipped"),
        (["new", "7 up"], "cannot be called '7 up'"),
        (["new", "mine", "--kind", "tabel"], "no kind of machine named 'tabel' (did you mean"),
    ],
)
def test_a_name_or_kind_that_will_not_do_is_answered(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_machine_begins_with_the_sensors_of_a_log(tmp_path: Path):
    draw = np.random.default_rng(5)
    time = np.arange(4000) / 200.0
    streams = {
        "gyro": Series(time, draw.normal(0.0, 2e-3, (4000, 3)), ("x", "y", "z"), "rad/s"),
        "accelerometer": Series(
            time[::2],
            np.array([0.0, 0.0, 9.81]) + draw.normal(0.0, 0.02, (2000, 3)),
            ("x", "y", "z"),
            "m/s^2",
        ),
    }
    log = Recording(streams, {"kind": "log"})
    platform = load_platform(new_platform(tmp_path / "my-own", "table", log))
    assert set(platform.sensors) == {"gyro", "accelerometer"}
    assert platform.sensors["gyro"].rate == pytest.approx(200.0)
    np.testing.assert_allclose(platform.sensors["gyro"].noise, 2e-3, rtol=0.1)
    assert platform.sensors["accelerometer"].rate == pytest.approx(100.0)
    assert [finding.sentence for finding in check_platform(platform) if not finding.ok] == []


def test_a_log_without_a_sensor_of_such_a_machine_begins_none(tmp_path: Path):
    log = Recording({"gyro": Series(np.arange(9.0), np.ones((9, 3)), tuple("xyz"), "rad/s")})
    with pytest.raises(UsageError, match="has no stream of a sensor of a pendulum"):
        new_platform(tmp_path / "my-own", "pendulum", log)
    assert not (tmp_path / "my-own").exists()
