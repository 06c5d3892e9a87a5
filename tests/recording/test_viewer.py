"""The viewer that a run starts listens to this computer alone."""

import subprocess

import pytest

from twin.recording import rrd


class Started:
    """A process that is told to start."""

    returncode = 3

    def __init__(self, command: list[str], **_: object) -> None:
        self.command = command
        commands.append(command)

    def poll(self) -> int | None:
        return None if up else self.returncode


commands: list[list[str]] = []
up = True


def test_it_is_bound_to_the_loopback(monkeypatch):
    commands.clear()
    answers = iter([False, False, True])
    monkeypatch.setattr(rrd, "_listens", lambda: next(answers))
    monkeypatch.setattr(subprocess, "Popen", Started)
    rrd.open_viewer()
    assert "--bind=127.0.0.1" in commands[0]


def test_one_that_listens_already_is_taken(monkeypatch):
    commands.clear()
    monkeypatch.setattr(rrd, "_listens", lambda: True)
    monkeypatch.setattr(subprocess, "Popen", Started)
    rrd.open_viewer()
    assert commands == []


def test_one_that_ends_is_no_viewer(monkeypatch):
    monkeypatch.setattr("tests.recording.test_viewer.up", False)
    monkeypatch.setattr(rrd, "_listens", lambda: False)
    monkeypatch.setattr(subprocess, "Popen", Started)
    with pytest.raises(RuntimeError, match="ended with code 3"):
        rrd.open_viewer()
