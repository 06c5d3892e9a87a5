"""Fits go on in other processes, which end when they are told to and by nothing else."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import twin
from tests.processes import running, wait_until
from twin.platform import load_platform
from twin.procedures.fits import Fits, filter_moment

CUBESAT = load_platform("cubesat")
NOBODY = np.zeros((0, 3))
"""Guesses of a fit that is over at once."""

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no signals of that kind there")


@dataclass(frozen=True)
class Endless:
    """Guesses of a fit that goes on for minutes."""

    folder: Path

    def __iter__(self) -> Iterator[np.ndarray]:
        (self.folder / "written").write_text(str(os.getpid()))
        (self.folder / "written").rename(self.folder / "begun")
        time.sleep(120.0)
        (self.folder / "finished").touch()
        return iter(())

    def process(self) -> int:
        """In which it goes on, once it does."""
        wait_until((self.folder / "begun").exists)
        return int((self.folder / "begun").read_text())


def test_a_fit_whose_process_died_has_failed_with_a_reason_and_the_next_is_answered(tmp_path):
    endless = Endless(tmp_path)
    with Fits(CUBESAT) as fits:
        fits.ask(0, [], endless)
        fits.ask(1, [], NOBODY)
        os.kill(endless.process(), signal.SIGKILL)
        assert [fits.answer(run).failure for run in (0, 1)] == ["the process that fits died"] * 2
        fits.ask(0, [], NOBODY)
        assert not fits.answer(0).failure


def test_the_end_does_not_wait_for_a_fit_that_is_under_way(tmp_path):
    endless = Endless(tmp_path)
    many = np.zeros((100_000, 3))
    with Fits(CUBESAT) as fits:
        fits.ask(0, [], endless)
        for run in range(1, 5):
            fits.ask(run, [], many)
        process = endless.process()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    assert not (tmp_path / "finished").exists()


@pytest.mark.parametrize("word", ["identify:", "move:"])
def test_ctrl_c_ends_a_balancing_with_a_document_whatever_its_fits_do(word):
    command = [sys.executable, "-m", "twin", "balance", "cubesat", "--random-offset", "--json"]
    with running(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        told = ""
        while word not in told:
            line = process.stderr.readline()
            assert line, told
            told += line
        # as a terminal does: to all processes
        os.killpg(process.pid, signal.SIGINT)
        out, rest = process.communicate(timeout=60.0)
    assert "Traceback" not in rest, rest
    document = json.loads(out)
    assert document["ended"] == "safe_stop", document
    assert process.returncode == 130


@pytest.mark.parametrize("shows", ["attitude", "inclinometer", "accelerometer"])
def test_the_filter_finds_m_r_in_a_swing_within_its_interval(shows):
    whole = load_platform("astros")
    others = {"attitude", "inclinometer", "accelerometer"} - {shows}
    sensors = {name: sensor for name, sensor in whole.sensors.items() if name not in others}
    machine = replace(whole, sensors=sensors)
    estimator = "filter" if shows == "attitude" else "mekf"
    run = twin.fly(machine, attitude=(0.08, 0.03, 0.0), duration=40.0, seed=5, estimator=estimator)
    log = run.recording.without_truth()
    fit = filter_moment([log], machine, np.array([[0.0, 0.0, -0.05]]))
    assert not fit.failure
    error = fit.moment - machine.center_of_mass_offset
    assert (np.abs(error) < 2.0 * fit.quantile * np.sqrt(np.diag(fit.covariance))).all()
    assert np.abs(error).max() < 5e-3 * np.linalg.norm(machine.center_of_mass_offset)


def test_two_logs_tell_the_filter_more_than_one():
    machine = load_platform("astros")
    logs = [
        twin.fly(machine, attitude=(0.08, 0.03, 0.0), duration=20.0, seed=seed).recording
        for seed in (1, 2)
    ]
    logs = [log.without_truth() for log in logs]
    guess = np.array([[0.0, 0.0, -0.05]])
    one, two = filter_moment(logs[:1], machine, guess), filter_moment(logs, machine, guess)
    assert np.trace(two.covariance) < np.trace(one.covariance)
