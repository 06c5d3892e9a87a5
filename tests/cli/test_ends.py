"""Whatever ends a flight, the machine is safe, and report, JSON and recording are there."""

import json
import signal
import sys
from pathlib import Path

import pytest

from twin import stop
from twin.cli.main import main
from twin.errors import RecordingError
from twin.recording import open_log
from twin.service import first_use
from twin.stream.recorder import FileRecorder

needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
BENCH = ["--plant", "pty", "--lockstep", "--arm", "floating"]

LAW = '''
"""A law that leaves."""

from dataclasses import dataclass

from twin.controller import Controller


@dataclass(frozen=True)
class Leaves(Controller[None]):
    """Ends the process, it thinks."""

    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        if time > 0.5:
            raise SystemExit(0)
        return {}, state
'''


@pytest.mark.parametrize(
    "words",
    [
        ["run", "nosuch", "--json"],
        ["run", "sads", "--no-such-option", "--json"],
        ["show", "nosuch.rrd", "--json"],
    ],
)
def test_json_is_one_document_where_a_verb_fails_too(words, capsys):
    status = main(words)
    document = json.loads(capsys.readouterr().out)
    assert document["status"] == status != 0
    assert document["error"]


def test_a_law_that_raises_system_exit_has_failed_and_says_so(tmp_path, capsys):
    law = tmp_path / "leaves.py"
    law.write_text(LAW, encoding="utf-8")
    words = ["run", "sads", "--controller", str(law), "--duration", "2", "--json"]
    assert main(words) == 1
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert document["ended"] == "failed"
    assert "line 18: SystemExit" in document["reason"]
    assert 0.5 <= document["duration"] < 0.7


@needs_pty
def test_a_recorder_that_dies_leaves_the_report_and_the_last_seconds(tmp_path, capsys, monkeypatch):
    collect = FileRecorder.collect

    def dies(recorder: FileRecorder, tick) -> None:
        if tick.reading.time > 1.0:
            raise RecordingError(
                "out.rrd", "the process that writes it has ended", "record elsewhere"
            )
        collect(recorder, tick)

    monkeypatch.setattr(FileRecorder, "collect", dies)
    out = tmp_path / "out.rrd"
    words = ["run", "cubesat", *BENCH, "--duration", "3", "--rrd", str(out), "--json"]
    assert main(words) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["ended"] == "failed"
    assert "the process that writes it has ended" in document["reason"]
    (record,) = [Path(name) for name in document["records"] if ".flight-" in name]
    assert open_log(record).stop == pytest.approx(1.0, abs=0.11)
    assert len(open_log(out)["gyro"]) > 10


@needs_pty
def test_the_first_use_is_recorded_and_told(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    words = ["run", "cubesat", *BENCH, "--controller", "magnetic_damping", "--duration", "1"]
    assert main([*words, "--rrd", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [line.split(" (")[0] for line in document["first_use"]] == [
        f"first use of {axis}" for axis in "xyz"
    ]
    assert document["devices"]["feather"]["frames"] > 100
    assert document["streams"]["gyro"]["samples"] > 10
    assert document["streams"]["gyro"]["not_believed"] == 0
    assert document["ticks"] == 21
    trial = open_log(tmp_path / "out.first-use.rrd")
    assert {"gyro", "attitude", "command_dipole"} <= set(trial)
    assert abs(trial["command_dipole"].value).max() > 0.0


@needs_pty
def test_ctrl_c_in_the_first_use_leaves_a_report_of_it(tmp_path, capsys, monkeypatch):
    tried = first_use._Trial.tried

    def interrupted(trial, stream: str, column: int) -> str:
        if column == 1:
            stop.request(signal.SIGINT)
        return tried(trial, stream, column)

    monkeypatch.setattr(first_use._Trial, "tried", interrupted)
    out = tmp_path / "out.rrd"
    words = ["run", "cubesat", *BENCH, "--controller", "magnetic_damping", "--duration", "1"]
    assert main([*words, "--rrd", str(out), "--json"]) == 130
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert document["ended"] == "safe_stop"
    assert document["reason"] == "stopped by Ctrl-C before its law began"
    assert document["duration"] == 0.0
    assert len(document["first_use"]) == 1
    assert len(open_log(tmp_path / "out.first-use.rrd")["gyro"]) > 10
    assert not out.exists(), "nothing was recorded in it"


def test_a_port_that_does_not_open_leaves_no_file_that_blocks_its_name(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    words = ["run", "cubesat", "--plant", f"serial:{tmp_path / 'nothing'}", "--rrd", str(out)]
    for _ in range(2):
        assert main(words) == 1
        assert "cannot open" in capsys.readouterr().err
        assert not out.exists()
