"""The examples of CONTRIBUTING.md are copied from there, and do what it says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import twin
from tests.seeds import seed_of
from twin.cli.main import main

PAGE = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")


def example(title: str, language: str = "python") -> list[str]:
    """The blocks of a section."""
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return re.findall(rf"```{language}\n(.*?)```", section, re.DOTALL)


def written(folder: Path, name: str, title: str) -> Path:
    (code,) = example(title)
    path = folder / name
    path.write_text(code)
    return path


@pytest.fixture
def effect(tmp_path: Path) -> Path:
    return written(tmp_path, "slip_ring_cogging.py", "Add an effect")


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A folder with the device's and the reader's packages, as an installer leaves them."""
    written(tmp_path, "lab_thermometer.py", "Add a device")
    written(tmp_path, "lab_records.py", "Add a log reader")
    points = [example("Add a device", "toml")[0], *example("Add a log reader", "toml")]
    facts = tmp_path / "lab-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    table = re.compile(r'\[project\.entry-points\."(.*?)"\]\n(\w+) = "(.*?)"')
    (facts / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n{name} = {value}\n"
            for group, name, value in table.findall("".join(points))
        )
    )
    return tmp_path


def run_beside(folder: Path, script: str) -> str:
    """What a script prints in a process for which the packages in a folder are installed."""
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=100.0,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_control_law_keeps_the_contract_and_damps(tmp_path: Path, capsys):
    law = written(tmp_path, "wheel_damper.py", "Add a control law")
    assert main(["check", str(law), "--platform", "sads"]) == 0
    assert "all ok" in capsys.readouterr().out
    run = twin.fly("sads", law, rate=(0.02, 0.0, 0.0), duration=20.0)
    rate = np.linalg.norm(run.recording["truth_rate"].value, axis=1)
    assert rate[-1] < 0.3 * rate[0]


def test_a_stream_of_any_name_is_read_and_exported_in_its_unit(tmp_path: Path, capsys):
    (facts,) = example("Add a stream", "toml")
    (tmp_path / "log.toml").write_text(facts)
    times = np.arange(0.0, 5.0, 0.1)
    gyro = np.column_stack([times, *np.random.default_rng(1).normal(size=(3, len(times)))])
    np.savetxt(tmp_path / "gyro.csv", gyro, delimiter=",", header="t,x,y,z", comments="")
    warm = np.column_stack([times, 293.0 + 0.1 * times])
    np.savetxt(tmp_path / "thermocouple.csv", warm, delimiter=",", header="t,top", comments="")
    log = twin.read(tmp_path)
    assert log["bearing_temperature"].unit == "K"
    np.testing.assert_allclose(log["bearing_temperature"].value[:, 0], warm[:, 1])
    assert "bearing_temperature" in str(twin.show(log))
    again = twin.read(log.save(tmp_path / "exported"))
    np.testing.assert_allclose(again["bearing_temperature"].value[:, 0], warm[:, 1])


def test_a_log_reader_of_an_installed_package_reads_its_files(installed: Path):
    records = np.arange(40.0).reshape(10, 4) / 100.0
    records.astype("<f8").tofile(installed / "spin.rec")
    (installed / "log.toml").write_text('[streams.gyro]\nfile = "spin.rec"\n')
    printed = run_beside(
        installed,
        "import twin; gyro = twin.read('.')['gyro']; print(gyro.time[1], gyro.value[1].tolist())",
    )
    assert printed == "0.04 [0.05, 0.06, 0.07]\n"


def test_a_device_of_an_installed_package_is_named_in_hardware_and_measures(installed: Path):
    wiring = example("Add a device", "toml")[1]
    printed = run_beside(installed, DEVICE.replace("WIRING", repr(wiring)))
    assert printed == "supply ['293.15', '293.25'] 2\n"


DEVICE = """
import os, pty, time, tty
from pathlib import Path
import twin
from twin.plant.hardware_setup import read_hardware

near, far = pty.openpty()
tty.setraw(far)
Path("bench.toml").write_text(WIRING.replace("/dev/serial/by-id/usb-thermometer", os.ttyname(far)))
setup = read_hardware(twin.load("sads"), Path("bench.toml"))
(settings,) = setup.devices.values()
with settings.session() as device:
    import threading
    threading.Timer(0.2, lambda: os.write(near, b"noise\\n")).start()
    device.connect()
    device.configure()
    os.write(near, b"293.15\\nwarm\\n293.2")
    os.write(near, b"5\\n")
    samples, end = [], time.monotonic() + 20.0
    while len(samples) < 2 and time.monotonic() < end:
        samples += device.read()
        time.sleep(0.01)
    print(settings.name, [f"{s.value[0]:.2f}" for s in samples], device.counters.frames)
"""


@pytest.mark.slow(60)
def test_an_effect_of_ones_own_is_a_candidate_of_a_diagnosis(
    effect: Path, tmp_path: Path, capsys, request: pytest.FixtureRequest
):
    seed = seed_of(request)
    size = float(10.0 ** np.random.default_rng(seed).uniform(-2.5, -1.7))
    log = tmp_path / "log.rrd"
    words = ["run", "sads", "--controller", "quaternion_pd", "--reference", "slew:0,0,150@3"]
    words += ["--duration", "60", "--seed", str(seed), "--effects", f"{effect}={size}"]
    assert main([*words, "--rrd", str(log)]) == 0

    found = twin.diagnose(log, "sads", effects=[effect])
    assert [cause.effect.name for cause in found.causes] == ["slip_ring_cogging"]
    (cause,) = found.causes
    assert abs(cause.effect.values[0] - size) < 3.0 * cause.half_widths[0]

    extended = twin.extend(found, tmp_path / "extended")
    assert [one.name for one in extended.effects] == ["slip_ring_cogging"]
    assert (tmp_path / "extended" / effect.name).read_text() == effect.read_text()


def test_a_file_that_is_no_effect_is_refused(tmp_path: Path, capsys):
    (tmp_path / "none.py").write_text("")
    words = ["diagnose", "models/dfki_pendulum/logs/sysid", "--effects", str(tmp_path / "none.py")]
    assert main(words) == 2
    assert "defines 0 effects" in capsys.readouterr().err
