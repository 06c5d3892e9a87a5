"""The loop flies an emulated machine over its line as it flies a simulated one, and ends safely."""

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from tests.processes import running
from twin.bench import Bench, open_bench
from twin.cli.main import main
from twin.controller.load import load_controller
from twin.emulate.emulated import Fault
from twin.emulate.microcontroller import EmulatedMicrocontroller
from twin.emulate.platform import Devices, EmulatedPlatform
from twin.errors import DeviceError, PlatformError, SafetyError, UnknownName, UsageError
from twin.estimators.named import load_estimator
from twin.loop import Ended, Outcome, fly
from twin.plant.devices.link import Schema
from twin.plant.guard.guarded import Held
from twin.plant.hardware_setup import read_hardware
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.recording import open_log
from twin.reference import Hold
from twin.rotation import from_rotation_vector
from twin.signals import Reading, Tick

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")

TILTED = InitialState(attitude=from_rotation_vector(np.array([0.05, 0.0, 0.0])))


@dataclass
class Kept:
    """An observer that keeps every tick, and does something at one of them."""

    at: float = np.inf
    do: Callable[[], object] = lambda: None
    ticks: list[Tick] = field(default_factory=list[Tick])

    def collect(self, tick: Tick) -> None:
        self.ticks.append(tick)
        if tick.reading.time >= self.at:
            self.at = np.inf
            self.do()

    def stream(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Times (m,) and values (m, k) of all samples."""
        return samples_of([tick.reading for tick in self.ticks], name)


def samples_of(readings: list[Reading], name: str) -> tuple[np.ndarray, np.ndarray]:
    found = [reading.streams[name] for reading in readings if name in reading.streams]
    times = np.concatenate([samples.time[0] for samples in found])
    return times, np.concatenate([samples.value[0] for samples in found])


@pytest.fixture
def cubesat() -> Platform:
    return load_platform("cubesat")


@pytest.fixture
def on_bench(cubesat: Platform) -> Callable[..., Bench]:
    """The emulated table in lockstep: `on_bench(held, initial)`, not entered."""

    def made(held: Held | None = None, initial: InitialState | None = None) -> Bench:
        setup = read_hardware(cubesat)
        emulation = EmulatedPlatform(cubesat, setup, seed=3, initial=initial, lockstep=True)
        return Bench(cubesat, setup, held=held, emulation=emulation)

    return made


def flown(bench: Bench, kept: Kept, duration: float, law: str = "mass_magnetic_pid") -> Outcome:
    clock = bench.begin()
    estimator, controller = load_estimator("passthrough"), load_controller(law)
    return fly(bench, estimator, controller, Hold(), clock, duration=duration, observers=[kept])


def test_what_the_simulated_sensors_give_comes_over_the_line_sample_by_sample(cubesat, on_bench):
    kept = Kept()
    with on_bench(initial=TILTED) as bench:
        outcome = flown(bench, kept, 2.0)
    assert outcome.ended is Ended.done, outcome.reason
    alone = SimulatedPlant(cubesat, seed=3, initial=TILTED)
    simulated = [alone.read(number * cubesat.tick) for number in range(1200)]
    for name in ("gyro", "attitude", "accelerometer", "magnetometer"):
        (times, values), (_, true) = kept.stream(name), samples_of(simulated, name)
        first = int(np.argmin(np.abs(true - values[0]).sum(axis=1)))
        np.testing.assert_allclose(
            values, true[first : first + len(values)], rtol=2e-7, atol=1e-9, err_msg=name
        )
        assert len(values) > 30
        # a clock that becomes known better moves all later samples, once
        assert np.median(np.diff(times)) == pytest.approx(0.05, abs=1e-3)
        assert np.all(np.diff(times) > 0.0)


def test_until_it_is_armed_nothing_leaves(on_bench):
    kept = Kept()
    with on_bench(initial=TILTED) as bench:
        outcome = flown(bench, kept, 1.5)
    assert outcome.ended is Ended.done
    assert not kept.stream("stage_position")[1].any(), "the masses stand"
    assert kept.ticks[-1].wanted["command_stage_position"].any(), "though the law would move them"


def test_a_mass_goes_where_it_is_told_over_the_line(on_bench):
    goal = np.array([[4e-4, -2e-4, 0.0]])
    readings: list[Reading] = []
    with on_bench(Held.captured) as bench:
        for now in bench.begin().ticks(bench.platform.tick, 1.5):
            readings.append(bench.read(now))
            applied = bench.write({"command_stage_position": goal})
    assert not bench.safe_reason
    np.testing.assert_allclose(applied["command_stage_position"], goal, atol=1e-9)
    _, positions = samples_of(readings, "stage_position")
    np.testing.assert_allclose(positions[-1], goal[0], atol=0.5e-5 + 2e-6)


class Impatient(Devices):
    """Boards that take no set-point for longer than 0.1 s, nor wait longer for the first."""

    def _made(self, name, machine):
        settings = self.settings[name]
        return EmulatedMicrocontroller(
            Schema(settings.channels), {}, machine=machine.share(name), longest_valid_ms=100
        )


def test_a_board_that_waits_a_tenth_of_a_second_for_its_first_set_point_is_flown(cubesat):
    setup = read_hardware(cubesat)
    feather = replace(setup.devices["feather"], valid_for=0.1)
    setup = replace(setup, devices={"feather": feather})
    emulation = EmulatedPlatform(cubesat, setup, seed=3, lockstep=True)
    emulation._devices = Impatient(**vars(emulation._devices))
    with Bench(cubesat, setup, held=Held.captured, emulation=emulation) as bench:
        outcome = flown(bench, Kept(), 1.0)
    assert outcome.ended is Ended.done, outcome.reason


@pytest.mark.parametrize("held", [Held.floating, None], ids=["armed", "dry run"])
@pytest.mark.parametrize("how", ["killed", "unplugged"])
def test_a_machine_that_is_lost_ends_the_run_safely_with_a_sentence(on_bench, how, held):
    with on_bench(held) as bench:
        line = bench.emulation.line
        gone = line.kill if how == "killed" else lambda: line.inject(Fault("unplug"))
        outcome = flown(bench, Kept(at=0.5, do=gone), 8.0)
    assert outcome.ended is Ended.safe_stop
    assert "feather: lost" in outcome.reason or "is stale" in outcome.reason
    assert outcome.duration < 4.0


def test_a_far_end_that_hears_nothing_more_brings_its_masses_to_rest(on_bench):
    far = np.array([[0.015, 0.0, 0.0]])
    places = []
    with on_bench(Held.captured) as bench:
        for now in bench.begin().ticks(bench.platform.tick, 5.0):
            reading = bench.read(now)
            if now < 0.5:
                bench.write({"command_stage_position": far})
            if "stage_position" in reading.streams:
                places.append(reading.streams["stage_position"].value[0, -1, 0])
    assert places[-1] == pytest.approx(places[-10], abs=1e-9), "it rests"
    assert 1e-4 < places[-1] < 0.7 * far[0, 0], "where its time-to-live has stopped it"


def test_a_table_that_leans_too_far_is_not_armed(on_bench):
    leaning = InitialState(attitude=from_rotation_vector(np.array([0.0, 0.65, 0.0])))
    with on_bench(Held.captured, leaning) as bench, pytest.raises(SafetyError, match="it leans by"):
        bench.begin()


@pytest.mark.parametrize(
    ("plant", "error", "sentence"),
    [
        ("serial:", UsageError, "names no port"),
        ("pty:1", UnknownName, "no plant named 'pty:1'"),
        ("serial:no.toml", PlatformError, "no.toml"),
    ],
)
def test_a_bench_that_cannot_be_is_refused_with_a_sentence(cubesat, plant, error, sentence):
    with pytest.raises(error, match=sentence):
        open_bench(cubesat, plant)


def test_a_port_that_is_not_there_is_told(cubesat):
    bench = open_bench(cubesat, "serial:/dev/not_there")
    with pytest.raises(DeviceError, match="feather: cannot open /dev/not_there"), bench:
        pass


def test_a_port_of_its_own_needs_a_calibration_before_it_is_armed(cubesat):
    with (
        EmulatedPlatform(cubesat, read_hardware(cubesat)) as emulation,
        open_bench(cubesat, f"serial:{emulation.ports['feather']}", held=Held.captured) as bench,
        pytest.raises(SafetyError, match="no calibration file"),
    ):
        bench.begin()


def test_a_run_over_the_line_tries_what_it_commands_and_is_recorded(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    words = ["cubesat", "--plant", "pty", "--lockstep", "--arm", "floating", "--rrd", str(out)]
    law = ["--controller", "mass_magnetic_pid", "--duration", "1"]
    assert main(["run", *words, *law]) == 0
    told = capsys.readouterr()
    assert "armed as floating" in told.err
    assert "first use of s1 (command_stage_position): predicted a turn of" in told.err
    assert "feather:" in told.out
    recording = open_log(out)
    assert recording.stop == pytest.approx(1.0, abs=0.1)
    assert {"gyro", "attitude", "stage_position", "command_stage_position"} <= set(recording)
    assert not [name for name in recording if name.startswith("truth")]


LAW_THAT_IS_CUT_OUT = '''
"""A law whose coils' command is no number after a second."""

from dataclasses import dataclass

import numpy as np

from twin.controller import Controller


@dataclass(frozen=True)
class CutOut(Controller[None]):
    """Asks for nothing, then for NaN."""

    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        dipole = np.full((len(estimate.valid), 3), 0.0 if time < 1.0 else np.nan)
        return {"command_dipole": dipole}, state
'''


def test_a_run_that_the_guard_cuts_out_has_failed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("law.py").write_text(LAW_THAT_IS_CUT_OUT, encoding="utf-8")
    words = ["cubesat", "--plant", "pty", "--lockstep", "--arm", "captured", "--duration", "3"]
    Path("cubesat.flight-0.rrd").write_text("of an earlier session")
    assert main(["run", *words, "--controller", "law.py"]) == 1
    told = capsys.readouterr().out
    assert "safe_stop after 1" in told
    assert "before it was stopped: cubesat.flight-0-2.rrd" in told
    assert Path("cubesat.flight-0.rrd").read_text() == "of an earlier session"


@pytest.mark.wall_clock
def test_emulate_prints_a_port_that_a_run_can_open_and_ends_with_ctrl_c():
    words = [sys.executable, "-m", "twin", "emulate", "cubesat", "--attitude", "3", "0", "0"]
    with running(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as one:
        assert one.stdout is not None
        device, _, port = one.stdout.readline().strip().partition(": ")
        assert device == "feather"
        words = ["run", "cubesat", "--plant", f"serial:{port}", "--duration", "1"]
        assert main(words) == 0
        one.send_signal(signal.SIGINT)
        _, errors = one.communicate()
    assert one.returncode == 0
    assert "Traceback" not in errors
    assert not Path(port).exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("run cubesat --plant pty --arm captured --attitude 5 0 0", "is locked level"),
        ("emulate cubesat --attitude 60 0 0", "stop"),
    ],
)
def test_a_start_that_an_emulated_machine_cannot_have_is_one_sentence(words, sentence, capfd):
    assert main(words.split()) == 2
    told = capfd.readouterr().err
    assert sentence in told
    assert "Traceback" not in told
