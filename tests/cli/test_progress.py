"""A person at a terminal sees how far a verb is; a file and a pipe get nothing of it."""

import io
import logging

import pytest

import twin
from twin.cli.output import progress, tell


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_sees_the_step_and_what_the_package_logs_and_then_a_clean_line(
    monkeypatch: pytest.MonkeyPatch,
):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    before = logging.getLogger("twin").level
    with progress() as say:
        say("the fit")
        logging.getLogger("twin.identification").info("step %d", 3)
        tell("a remark")
    shown = terminal.getvalue()
    assert "\r\x1b[Kthe fit ..." in shown
    assert "\r\x1b[Kthe fit: step 3 ..." in shown
    assert "\r\x1b[Ka remark\n" in shown
    assert shown.endswith("\r\x1b[K")
    assert logging.getLogger("twin").level == before
    assert logging.getLogger("twin").handlers == []


def test_a_pipe_gets_no_progress(monkeypatch: pytest.MonkeyPatch):
    pipe = io.StringIO()
    monkeypatch.setattr("sys.stderr", pipe)
    with progress() as say:
        say("the fit")
        logging.getLogger("twin").info("step 3")
    assert pipe.getvalue() == ""


def test_a_line_is_no_wider_than_its_terminal(monkeypatch: pytest.MonkeyPatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("COLUMNS", "40")
    with progress() as say:
        say("a" * 100)
    (line,) = [part for part in terminal.getvalue().split("\r\x1b[K") if "a" in part]
    assert len(line) < 40


def test_a_fit_and_a_flight_log_how_far_they_are(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("twin.loop.FlightProgress.PERIOD", 0.0)
    with caplog.at_level(logging.INFO, logger="twin"):
        run = twin.fly("sads", "quaternion_pd", reference="multisine:8@0.1", duration=10.0)
        twin.identify(run.recording, "sads")
    said = [record.getMessage() for record in caplog.records]
    assert any("5 of 10 s flown, " in line and line.endswith("left") for line in said)
    assert "step 1" in said
