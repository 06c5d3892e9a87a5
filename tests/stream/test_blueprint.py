"""A person who opens a recording sees the machine and the plots of what it has."""

import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import rerun.blueprint as rrb

from twin.platform import load_platform
from twin.recording import Recording, Series
from twin.rotation import from_rotation_vector
from twin.stream.blueprint import blueprint
from twin.stream.rows import Header
from twin.stream.runfile import write_recording

DRIVERS = [*Path("/usr/share/vulkan/icd.d").glob("*.json"), *Path("/etc/vulkan").rglob("*.json")]


def views(name: str) -> list[str]:
    machine, plots = blueprint(load_platform(name)).root_container.contents
    assert isinstance(machine, rrb.Spatial3DView)
    return [str(view.name) for view in plots.contents]


def test_a_gyrostat_shows_tilt_rates_wheels_stages_and_gravity_torque():
    titles = views("sads")
    for word in ("tilt", "attitude", "rate", "wheel speed", "stage position", "gravity torque"):
        assert any(title.startswith(word) for title in titles), word
    assert all("[" in title for title in titles), "a plot states its unit"


def test_a_pendulum_shows_its_joint_and_no_wheels():
    assert [title.split(" [")[0] for title in views("dfki_pendulum")] == [
        "joint angle",
        "joint rate",
        "joint torque",
    ]


def test_what_is_predicted_and_left_stands_beside_what_was_measured_before_the_flight():
    rate, turn = Header(tuple("xyz"), "rad/s"), Header(tuple("xyz"), "rad")
    attitude = Header(tuple("wxyz"), "1")
    streams = {"gyro": rate, "predicted_gyro": rate, "residual_gyro": rate}
    streams |= {"attitude": attitude, "predicted_attitude": attitude, "residual_attitude": turn}
    _, shown = blueprint(load_platform("sads"), streams=streams).root_container.contents
    compared, flight = shown.contents
    assert shown.active_tab == 0
    assert [view.name for view in compared.contents] == [
        "gyro, measured and predicted [rad/s]",
        "gyro, residual [rad/s]",
        "attitude, measured and predicted [1]",
        "attitude, residual [rad]",
    ]
    assert [view.name for view in flight.contents] == views("sads")


@pytest.mark.skipif(not DRIVERS, reason="no Vulkan driver (apt-get install mesa-vulkan-drivers)")
def test_the_viewer_draws_the_machine_in_its_own_colours(tmp_path: Path):
    time = np.arange(0.0, 20.0, 0.05)
    attitude = from_rotation_vector(0.1 * np.sin(time)[:, None] * np.array([1.0, 0.5, 0.0]))
    streams = {"estimate_attitude": Series(time, attitude, ("w", "x", "y", "z"), "1")}
    write_recording(Recording(streams, {}), tmp_path / "a.rrd", load_platform("sads"))
    # The viewer takes its picture when it likes, sometimes before the file is loaded.
    pictures = (screenshot(tmp_path / "a.rrd", tmp_path / f"{i}.png") for i in range(8))
    ring, mass = (0.93, 0.55, 0.13), (0.82, 0.18, 0.16)
    assert any(all(shows(picture, color) for color in (ring, mass)) for picture in pictures)


def screenshot(recording: Path, path: Path) -> np.ndarray:
    command = [sys.executable, "-m", "rerun_cli", recording, "--headless", "--renderer", "vulkan"]
    command += ["--window-size", "1000x600", "--screenshot-to", path]
    done = subprocess.run(command, capture_output=True, timeout=120)
    if done.returncode != 0 or not path.exists():
        pytest.skip("the Vulkan driver does not draw")
    return matplotlib.image.imread(path)[..., :3].reshape(-1, 3)


def shows(picture: np.ndarray, color: tuple[float, float, float]) -> bool:
    """Whether there is a patch of that colour, however bright."""
    length = np.linalg.norm(picture, axis=1)
    likeness = picture @ np.array(color) / np.linalg.norm(color) / np.maximum(length, 1e-9)
    return np.count_nonzero((likeness > 0.99) & (length > 0.3)) > 200
