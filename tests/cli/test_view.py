"""`twin view` shows any log, mending or converting it first where that is needed."""

import sys
from pathlib import Path

import numpy as np
import pytest

from twin.cli.main import main
from twin.library import library
from twin.recording import Recording, Series, read_recording
from twin.stream.runfile import write_recording


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Path, Recording]]:
    """What the viewer would have been given."""
    given: list[tuple[Path, Recording]] = []

    def show(path: Path) -> int:
        given.append((path, read_recording(path)))
        return 0

    monkeypatch.setattr("twin.cli.logs._show", show)
    return given


def recorded(path: Path) -> Path:
    series = Series(np.arange(2000.0), np.ones((2000, 3)), ("x", "y", "z"), "rad/s")
    write_recording(Recording({"gyro": series}, {"schema": 1, "platform": "sads"}), path)
    return path


def test_a_whole_recording_is_shown_as_it_is(shown, tmp_path: Path):
    path = recorded(tmp_path / "a.rrd")
    assert main(["view", str(path)]) == 0
    assert shown[0][0] == path


def test_a_cut_recording_is_mended_first_and_that_is_said(shown, tmp_path: Path, capsys):
    path = recorded(tmp_path / "a.rrd")
    path.write_bytes(path.read_bytes()[:-30])
    assert main(["view", str(path)]) == 0
    assert "repaired: a.rrd was cut short" in capsys.readouterr().err
    assert shown[0][0] != path
    assert len(shown[0][1]["gyro"]) == 2000


@pytest.mark.skipif(sys.platform == "win32", reason="what stands for the viewer is a script")
def test_a_viewer_that_crashes_has_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    crashing = tmp_path / "viewer"
    crashing.write_text("#!/bin/sh\nexit 3\n")
    crashing.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(crashing))
    assert main(["view", str(recorded(tmp_path / "a.rrd"))]) == 1
    assert "twin: the viewer ended with code 3" in capsys.readouterr().err


def test_a_folder_log_is_shown_with_its_machine(shown):
    folder = library("models") / "dfki_pendulum" / "logs" / "sysid"
    assert main(["view", str(folder)]) == 0
    assert set(shown[0][1]) == {"joint_angle", "joint_rate", "command_joint_torque"}
