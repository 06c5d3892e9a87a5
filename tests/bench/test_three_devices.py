"""A table over three makers' devices, each on its own line at the line's rate, one simulation
behind them. Time is the wall's: nothing here depends on how late a busy computer is.
"""

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.processes import running
from twin.bench import Bench, captured, carried, open_bench
from twin.cli.main import main
from twin.emulate.emulated import Fault
from twin.emulate.platform import EmulatedPlatform
from twin.errors import TwinError
from twin.plant.guard.guarded import Held
from twin.plant.hardware_setup import HardwareSetup, read_hardware
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.rotation import from_rotation_vector
from twin.service.jog import jog
from twin.service.stages import home
from twin.signals import Reading

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals"),
    pytest.mark.wall_clock,
]

TILTED = InitialState(attitude=from_rotation_vector(np.array([0.05, -0.02, 0.0])))


class Patient(EmulatedPlatform):
    """Its guard waits as long as a busy test machine may make a device wait."""

    @property
    def setup(self) -> HardwareSetup:
        found = super().setup
        patient = {"stale_cycles": 100, "watchdog": np.inf, "max_balance_step": 0.2}
        return replace(found, guard=replace(found.guard, **patient))


@pytest.fixture
def astros() -> Platform:
    return load_platform("astros")


@pytest.fixture
def on_bench(astros: Platform) -> Callable[..., Bench]:
    def made(held: Held | None = None, initial: InitialState | None = None) -> Bench:
        setup = read_hardware(astros)
        simulated = captured(astros) if held is Held.captured else astros
        emulation = Patient(simulated, setup, seed=3, initial=initial)
        return Bench(carried(astros, setup), setup, held=held, emulation=emulation)

    return made


def samples_of(readings: list[Reading], name: str) -> tuple[np.ndarray, np.ndarray]:
    found = [reading.streams[name] for reading in readings if name in reading.streams]
    valid = np.concatenate([samples.valid[0] for samples in found])
    times = np.concatenate([samples.time[0] for samples in found])
    return times[valid], np.concatenate([samples.value[0] for samples in found])[valid]


def watched(bench: Bench, seconds: float, **least: int) -> list[Reading]:
    """For so long, and on until streams have so many samples: on a busy computer a line answers
    less often."""
    readings: list[Reading] = []
    for now in bench.begin().ticks(bench.platform.tick, 10.0 * seconds):
        readings.append(bench.read(now))
        if now < seconds:
            continue
        if all(count_of(readings, name) >= count for name, count in least.items()):
            break
    return readings


def count_of(readings: list[Reading], name: str) -> int:
    return sum(int(one.streams[name].valid[0].sum()) for one in readings if name in one.streams)


def test_what_the_simulated_sensors_give_comes_over_each_line(astros, on_bench):
    with on_bench(initial=TILTED) as bench:
        readings = watched(bench, 3.0, gyro=200, accelerometer=200, stage_position=20)
        told = bench.messages()
    alone = SimulatedPlant(astros, seed=3, initial=TILTED)
    # the emulation's time 0 was before the connection
    simulated = [alone.read(number * astros.tick) for number in range(len(readings) + 900)]
    for name in ("gyro", "accelerometer"):
        (times, values), (_, true) = samples_of(readings, name), samples_of(simulated, name)
        first = int(np.argmin(np.abs(true - values[0]).sum(axis=1)))
        assert len(values) >= 200
        np.testing.assert_allclose(
            values, true[first : first + len(values)], rtol=2e-7, atol=1e-9, err_msg=name
        )
        # by the host's clock, which a busy computer reads late
        assert np.median(np.diff(times)) == pytest.approx(0.01, abs=5e-3)
    tilt = samples_of(readings, "inclinometer")[1]
    assert np.abs(np.degrees(tilt[0])).min() > 0.5
    np.testing.assert_allclose(np.degrees(tilt) * 1e3, np.round(np.degrees(tilt) * 1e3), atol=1e-6)
    assert len(samples_of(readings, "stage_position")[1]) >= 20
    assert [line for line in told if line.startswith(("imu", "tilt", "stages"))]


def test_a_mass_that_its_drive_moves_turns_the_simulated_table(on_bench):
    with on_bench(Held.floating) as bench:
        told = jog(bench, "s1", 5e-3)
        assert bench.guard.seen.stage_position[0] == pytest.approx(5e-3, abs=1e-6)
    assert "turned the right way" in told[1], told


def test_stages_seek_their_home_switches_on_a_captured_table(on_bench):
    with on_bench(Held.captured, InitialState(stage_position=5e-4)) as bench:
        told = home(bench)
        assert bench.guard.seen.stage_position == pytest.approx([0.0, 0.0, 0.0], abs=2e-5)
    assert told[0] == "stages: s1, s2, s3 homed"


def test_a_sensor_that_is_unplugged_ends_the_run_with_its_name(astros):
    with open_bench(astros, "pty") as bench:
        bench.watch()
        assert not bench.safe_reason
        bench.emulation.line.inject(Fault("unplug", device="imu"))
        for _ in range(10):
            bench.watch_on()
            if bench.safe_reason:
                break
    assert bench.safe_reason.startswith("imu")


def test_the_loop_knows_of_no_sensor_that_no_device_carries(astros):
    seen = carried(astros, read_hardware(astros))
    assert "attitude" not in seen.sensors
    assert set(seen.sensors) == {
        "gyro", "accelerometer", "magnetometer", "inclinometer", "stage_position"
    }  # fmt: skip


def test_a_file_beside_the_platform_may_wire_more_devices(astros):
    deck = astros.model_path.with_name("deck.toml")
    with open_bench(astros, f"pty:{deck}") as bench:
        readings = watched(bench, 2.0)
    for name in ("attitude", "gimbal_angle", "wheel_speed", "inclinometer", "gyro"):
        assert len(samples_of(readings, name)[1]) > 10, name
    assert {"stages", "tilt", "imu", "deck"} == set(bench.setup.devices)


def test_a_file_of_wiring_that_is_not_there_is_named(astros):
    with pytest.raises(TwinError, match=r"nowhere\.toml"):
        open_bench(astros, "pty:nowhere.toml")


def test_a_run_over_three_lines_is_reported(capsys):
    words = ["--controller", "mass_pid", "--duration", "2", "--plant", "pty"]
    assert main(["run", "astros", *words]) == 0
    told = capsys.readouterr()
    assert "estimator inclinometer" in told.err
    assert "not armed: nothing leaves" in told.err
    for name in ("stages", "tilt", "imu"):
        assert f"{name}: " in told.out


def test_emulate_prints_a_port_for_each_device_that_another_program_can_open(capsys):
    words = [sys.executable, "-m", "twin", "emulate", "astros"]
    with running(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as one:
        assert one.stdout is not None
        ports = [one.stdout.readline().strip().replace(": ", "=") for _ in range(3)]
        plant = f"serial:{','.join(ports)}"
        assert main(["hardware", "astros", "status", "--plant", plant]) == 0
        one.send_signal(signal.SIGINT)
        _, errors = one.communicate()
    assert [port.partition("=")[0] for port in ports] == ["stages", "tilt", "imu"]
    assert "Traceback" not in errors
    told = capsys.readouterr().out
    assert "imu (unit 03880011) at" in told
    assert "no calibration file" in told


def test_a_table_on_which_nothing_damps_is_not_begun_to_be_balanced(capsys):
    words = ["--plant", "pty", "--arm", "floating", "--offset", "20", "-15", "-100"]
    assert main(["balance", "astros", *words]) == 2
    assert "no device of astros takes anything that damps" in capsys.readouterr().err
