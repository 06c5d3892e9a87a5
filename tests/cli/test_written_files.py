"""What is written where: no file is lost to a word too many, or to a second session."""

import os
from pathlib import Path

import pytest

from twin.cli.main import main
from twin.errors import UsageError
from twin.files import check_writable

LOST = '''
"""A law whose commands are soon not finite."""

from dataclasses import dataclass

import numpy as np

from twin.controller import Controller


@dataclass(frozen=True)
class Lost(Controller[None]):
    """Asks for what is no number."""

    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        return {"command_wheel_torque": np.full((len(estimate.valid), 3), np.nan)}, None
'''


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["run", "sads", "--rrd", "notes.md"], "say notes.rrd"),
        (["balance", "cubesat", "--rrd", "notes.md"], "say notes.rrd"),
        (["replay", ".", "3", "--rrd", "notes.md"], "say notes.rrd"),
        (["check", "sads", "--picture", "notes.md"], "say notes.png"),
        (["compare", "nowhere", "--report", "notes.md"], "say notes.html"),
        (["compare", "nowhere", "--rrd", "notes.md"], "say notes.rrd"),
        (["diagnose", "nowhere", "--report", "notes.md"], "say notes.html"),
        (["compare", "nowhere", "--report", "."], "is a folder; name a file in it"),
    ],
)
def test_a_file_of_another_kind_is_not_written_over(words, remedy, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("notes.md").write_text("precious")
    assert main(words) == 2
    assert remedy in capsys.readouterr().err
    assert Path("notes.md").read_text() == "precious"


@pytest.mark.parametrize("verb", ["run", "balance"])
@pytest.mark.parametrize("plant", ["pty", "serial", "serial:/dev/nowhere"])
def test_a_session_is_not_written_over(verb, plant, tmp_path, capsys):
    log = tmp_path / "session.rrd"
    log.write_text("precious")
    words = [verb, "cubesat", "--plant", plant, "--arm", "floating", "--rrd", str(log)]
    assert main(words) == 2
    assert (
        f"{log} exists, and may be a session that cannot be flown again" in capsys.readouterr().err
    )
    assert log.read_text() == "precious"


@pytest.mark.parametrize(
    "words",
    [
        ["run", "sads", "--plant", "replay:log.rrd", "--rrd", "./log.rrd"],
        ["compare", "log.rrd", "--rrd", "log.rrd"],
        ["diagnose", "other.rrd", "--validate", "log.rrd", "--rrd", "log.rrd"],
    ],
)
def test_a_log_is_not_written_over_by_what_reads_it(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("log.rrd").write_text("precious")
    assert main(words) == 2
    assert "log.rrd is the log that is read; name another file" in capsys.readouterr().err
    assert Path("log.rrd").read_text() == "precious"


def test_a_simulated_run_may_be_written_anew(tmp_path):
    log = tmp_path / "run.rrd"
    log.write_text("of an earlier run")
    assert main(["run", "sads", "--duration", "1", "--rrd", str(log)]) == 0
    assert log.stat().st_size > 1000


def test_a_place_one_may_not_write_to_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # as for a user who is not root
    with pytest.raises(UsageError, match="you may not write into"):
        check_writable(tmp_path / "in" / "out.rrd", ".rrd")
    (tmp_path / "out.rrd").touch()
    with pytest.raises(UsageError, match="you may not write to it"):
        check_writable(tmp_path / "out.rrd", ".rrd")


def test_the_flight_record_of_a_machine_in_a_folder_is_written_where_one_stands(
    tmp_path, monkeypatch, capsys
):
    (tmp_path / "home").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(["new", "home/table", "--kind", "table"]) == 0
    Path("lost.py").write_text(LOST)
    words = ["run", str(tmp_path / "home" / "table"), "--controller", "lost.py", "--duration", "2"]
    assert main(words) == 1
    assert "before it was stopped: table.flight-0.rrd" in capsys.readouterr().out
    assert Path("table.flight-0.rrd").is_file()


def test_a_folder_that_is_made_for_a_recording_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    path = tmp_path / "rnus" / "a.rrd"
    words = ["run", "dfki_pendulum", "--duration", "0.2", "--rrd", str(path)]
    assert main(words) == 0
    assert caplog.messages == [f"the folder {path.parent} does not exist: it is made for a.rrd"]
    assert main(words) == 0
    assert len(caplog.messages) == 1
