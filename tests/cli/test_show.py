"""`twin show` names what looks misread, with the lines that put it right."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from twin import rotation
from twin.cli.main import main
from twin.errors import UsageError
from twin.library import library
from twin.platform import load_platform, other_machine, platform_of
from twin.recording import Recording, Series, read_log, write_folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A body that rocks about three axes; its gyro is in deg/s, and log.toml does not say so."""
    draw = np.random.default_rng(2)
    time = np.arange(6000) / 100.0
    phase = time[:, None] * np.array([0.5, 0.7, 0.9]) + np.array([0.0, 1.0, 2.0])
    attitude = np.empty((6000, 4))
    attitude[0] = 1.0, 0.0, 0.0, 0.0
    steps = rotation.from_rotation_vector(0.1 * np.sin(phase) / 100.0)
    for row in range(5999):
        attitude[row + 1] = rotation.multiply(attitude[row], steps[row])
    gyro = np.rad2deg(0.1 * np.sin(phase) + draw.normal(0.0, 1e-3, phase.shape))
    streams = {
        "gyro": Series(time, gyro, ("x", "y", "z"), "rad/s"),
        "attitude": Series(time + 0.005, attitude, ("w", "x", "y", "z"), "1"),
    }
    write_folder(Recording(streams, {"platform": "nowhere"}), tmp_path / "log")
    return tmp_path / "log"


MISREAD = """
Gyro looks like deg/s, read as rad/s.
To read it so, write in log.toml:
  [streams.gyro]
  unit = "deg/s"
"""


def test_a_misread_stream_is_named_with_the_lines_to_paste(folder: Path, capsys):
    assert main(["show", str(folder)]) == 1
    text = capsys.readouterr().out
    assert MISREAD in text
    assert "The log was not compared with the machine: no platform named 'nowhere'" in text


def test_after_pasting_nothing_is_left_to_say(folder: Path, capsys):
    path = folder / "log.toml"
    text = path.read_text().replace('unit = "rad/s"', 'unit = "deg/s"')
    path.write_text(text.replace('platform = "nowhere"\n', ""))
    assert main(["show", str(folder)]) == 0
    assert "write in log.toml" not in capsys.readouterr().out


def test_the_document_holds_findings_and_lines(folder: Path, capsys):
    assert main(["show", str(folder), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["log_toml"] == '[streams.gyro]\nunit = "deg/s"'
    (finding,) = document["conventions"]
    assert (finding["stream"], finding["kind"]) == ("gyro", "unit")
    assert finding["alternatives"] == []


def test_a_part_of_a_log_is_shown_at_a_lower_rate(folder: Path, capsys):
    words = ["--start", "10", "--stop", "40", "--rate", "25", "--json"]
    main(["show", str(folder), *words])
    document = json.loads(capsys.readouterr().out)
    assert document["start"] >= 10.0
    assert document["stop"] <= 40.0
    gyro = next(one for one in document["streams"] if one["name"] == "gyro")
    assert gyro["rate"] == pytest.approx(25.0)
    assert gyro["rows"] == pytest.approx(750, abs=2)
    assert any("read from 10 to 40 s" in repair for repair in document["repairs"])


def test_what_the_fits_will_refuse_is_said_before(tmp_path: Path, capsys):
    counts = 1e4 * np.arange(3000) / 100.0  # of 0.1 ms
    draw = np.random.default_rng(3)
    attitude = np.array([[1.0, 0.0, 0.0, 0.0]]) + draw.normal(0.0, 1e-3, (1500, 4))
    gyro = draw.normal(0.0, 1e-3, (3000, 3))
    streams = {
        "gyro": Series(counts, gyro, ("x", "y", "z"), "rad/s"),
        "attitude": Series(counts[::2], rotation.normalized(attitude), tuple("wxyz"), "1"),
    }
    write_folder(Recording(streams, {"platform": "sads"}), tmp_path / "log")
    assert main(["show", str(tmp_path / "log")]) == 1
    assert "identify and diagnose will refuse this log: " in capsys.readouterr().out


def rocking_beside_a_folder_of_a_shipped_name(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A log that names `cubesat`, in a place where a folder has that name, too."""
    path = folder / "log.toml"
    path.write_text(path.read_text().replace("nowhere", "cubesat"))
    mine = folder.parent / "cubesat"
    shutil.copytree(library("models") / "sads", mine, ignore=shutil.ignore_patterns("logs"))
    monkeypatch.chdir(folder.parent)
    return f"./{mine.name}"


def test_a_machine_that_the_command_names_stands_in_for_that_of_the_log(folder: Path, capsys):
    assert main(["show", str(folder), "--platform", "sads"]) == 1
    text = capsys.readouterr().out
    assert "The log was not compared with the machine" not in text
    assert "wheels" in text, "sads has some, and the log has no stream of them"


def test_of_two_machines_of_one_name_the_command_decides(folder: Path, capsys, monkeypatch):
    named = rocking_beside_a_folder_of_a_shipped_name(folder, monkeypatch)
    main(["show", "log"])
    assert "'cubesat' is a shipped machine, and a folder here" in capsys.readouterr().out
    main(["show", "log", "--platform", named])
    text = capsys.readouterr().out
    assert "is a shipped machine" not in text
    assert "The log was not compared with the machine" not in text


def test_a_log_of_two_machines_of_one_name_is_of_either(folder: Path, monkeypatch):
    named = rocking_beside_a_folder_of_a_shipped_name(folder, monkeypatch)
    log = read_log("log")
    with pytest.raises(UsageError, match="log: 'cubesat' is a shipped machine"):
        platform_of(log)
    assert not other_machine(log, load_platform(named))
    assert other_machine(log, load_platform("sads")) == "cubesat"
