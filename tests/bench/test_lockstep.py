"""In lockstep an emulated machine flies as on the wall's clock, as fast as the computer can."""

import json
import sys

import numpy as np
import pytest

from twin.bench import open_bench
from twin.cli.main import main
from twin.clock import WallClock
from twin.controller.load import load_controller
from twin.emulate.emulated import Fault
from twin.estimators.named import load_estimator
from twin.loop import Ended, Outcome, fly
from twin.plant.guard.guarded import Held
from twin.platform import load_platform
from twin.reference import Hold

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")


def flown(duration: float, *faults: Fault) -> Outcome:
    cubesat = load_platform("cubesat")
    with open_bench(cubesat, "pty", held=Held.floating, faults=faults, lockstep=True) as bench:
        clock = bench.begin()
        assert not isinstance(clock, WallClock)
        estimator, law = load_estimator("filter"), load_controller("mass_magnetic_pid")
        return fly(bench, estimator, law, Hold(), clock, duration=duration)


def test_no_tick_is_late_and_no_set_point_runs_out_however_busy_the_computer_is():
    outcome = flown(5.0)
    assert outcome.ended is Ended.done, outcome.reason
    assert outcome.timing.ticks == 101
    assert outcome.timing.overruns == 0


def test_a_board_that_restarts_ends_the_run_in_lockstep_too():
    outcome = flown(8.0, Fault("reset", 3.0))
    assert outcome.ended is Ended.safe_stop
    assert "it has restarted" in outcome.reason
    assert outcome.duration < 2.5, "1.2 s of watching and arming were before"


def test_a_far_end_that_is_deaf_for_longer_than_a_set_point_is_valid_ends_the_run_in_a_sentence():
    outcome = flown(8.0, Fault("deaf", 3.0, value=5.0))
    assert outcome.ended is Ended.safe_stop
    assert "no new set-point came in time" in outcome.reason or "acknowledged" in outcome.reason


def test_an_emulation_that_is_killed_ends_the_run_in_lockstep_too():
    class Killer:
        def collect(self, tick):
            if tick.reading.time >= 1.0:
                bench.emulation.line.kill()

    with open_bench(load_platform("cubesat"), "pty", held=Held.floating, lockstep=True) as bench:
        clock = bench.begin()
        law = load_controller("mass_magnetic_pid")
        outcome = fly(
            bench,
            load_estimator("filter"),
            law,
            Hold(),
            clock,
            duration=10.0,
            observers=[Killer()],
        )
    assert outcome.ended is Ended.safe_stop
    assert "feather" in outcome.reason or "is stale" in outcome.reason
    assert outcome.duration < 3.0


@pytest.mark.slow(60)
def test_a_table_is_balanced_over_its_line_and_says_truly_how_well(capsys):
    words = ["--plant", "pty", "--arm", "floating", "--lockstep", "--target", "4e-3", "--json"]
    assert main(["balance", "cubesat", *words]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ended"] == "done"
    assert told["residual_torque"]["high"] <= told["target"]
    cubesat = load_platform("cubesat")
    masses = np.array([stage.mass for stage in cubesat.stages])
    left = cubesat.center_of_mass_offset + masses * np.array(told["stage_position"])
    # within half of the backlash, which no counter sees
    unseen = 0.5 * 1e-5 * masses
    offset = told["center_of_mass_offset"]
    assert (np.array(offset["low"]) - unseen <= left).all()
    assert (left <= np.array(offset["high"]) + unseen).all()
