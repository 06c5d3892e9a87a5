"""What a balancing states knows whether its own logs agree with the model."""

import re
import secrets
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from twin.cli.main import main
from twin.identification import Misfit
from twin.platform import load_platform
from twin.procedures import Phase, balancing
from twin.procedures.fits import Fits, MomentFit, fit_moment
from twin.procedures.plan import Statement, state
from twin.recording import open_log
from twin.reference import Hold
from twin.report.outcomes import balanced
from twin.signals import Estimate

CUBESAT = load_platform("cubesat")
DRAFT = 3e-5, 1e-4
"""Of a fan that swings, 0.3 m above the bearing [N]."""


def stated(folder: Path, seed: int, *hidden: str) -> Statement:
    """On a table that swings for a minute."""
    log = folder / "swing.rrd"
    words = [
        "run",
        "cubesat",
        "--controller",
        "free_float",
        "--duration",
        "60",
        "--seed",
        str(seed),
    ]
    assert main([*words, "--attitude", "4", "3", "40", *hidden, "--rrd", str(log)]) == 0
    found = fit_moment([open_log(log)], CUBESAT, CUBESAT.center_of_mass_offset[None])
    assert not found.failure
    return state(
        CUBESAT, found.moment, found.covariance, found.quantile, 0.0, np.zeros(3), found.misfit
    )


@pytest.fixture
def seed() -> int:
    drawn = secrets.randbits(31)
    print("seed", drawn)
    return drawn


def test_a_statement_on_a_machine_that_is_as_stated_has_no_doubt(tmp_path, seed):
    statement = stated(tmp_path, seed)
    low, high = statement.document()["chi2_per_sample"]["band"]
    assert low < 1.0 < high
    # beyond its band one time in forty; half a band's width further never
    assert statement.misfit.chi2_per_sample < high + 0.5 * (high - low)


@pytest.mark.parametrize("again", [None, 1190215373], ids=["drawn", "states off the model's path"])
def test_a_statement_doubts_itself_where_something_hidden_moves_the_machine(tmp_path, seed, again):
    seed = again or seed
    force = np.random.default_rng(seed).uniform(*DRAFT)
    draft = f"room_draft=0.1/0/0.3/{force}/{force}/0/0.3/1"
    statement = stated(tmp_path, seed, "--effects", draft)
    told = balanced(statement, CUBESAT, 4.3e-5)[-1]
    assert re.search(r"misses more than noise .*chi2 per sample .*twin diagnose", told), told


def test_a_torque_that_may_be_nothing_is_told_with_both_ends_of_its_interval():
    covariance, misfit = np.diag([1e-14, 1e-14, 1e-16]), Misfit("all", 1.0, 0.9, 1.1)
    moment = np.array([1e-7, 0.0, -2e-6])
    statement = state(CUBESAT, moment, covariance, 1.96, 1e-5, np.zeros(3), misfit)
    lines = balanced(statement, CUBESAT, 4.3e-5)
    assert any("of the level body 0.981 uN m (0 to 2.9" in line for line in lines), lines


class Answered(Fits):
    """Every fit finds an offset that the masses can undo."""

    def answer(self, run: int) -> MomentFit:
        nothing = Misfit("all", 1.0, 0.9, 1.1)
        moment = np.array([0.0, 0.0, -2e-5])
        return MomentFit(moment, 1e-14 * np.eye(3), 1.96, CUBESAT.inertia, nothing)


@pytest.mark.parametrize("target", [4.3e-5, 5e-4])
def test_a_statement_is_there_only_while_the_masses_stand_where_it_was_made(monkeypatch, target):
    monkeypatch.setattr(
        import_module("twin.procedures.balancing"), "observed_torque", lambda *_: 1e-5
    )
    procedure = balancing(CUBESAT, 1, way="direct", target=target, workers=0)
    procedure = replace(procedure, lab=replace(procedure.lab, fits=Answered(CUBESAT, workers=0)))
    procedure.lab.logs[0] = [None, None]
    notes = procedure.lab.notes.runs[0]
    now = replace(
        procedure.init(CUBESAT, 1), phase=np.array([int(Phase.judge)]), estimated=np.array([True])
    )
    still, none = np.zeros((1, 3)), np.zeros((1, 0))
    level = np.array([[1.0, 0.0, 0.0, 0.0]])

    def pass_to(state, time):
        shown = Estimate(
            time, level, still, still, still, none, none, still, np.ones(1, dtype=bool)
        )
        return procedure.update(state, shown, Hold().at(np.full(1, time)), time)[1]

    now = pass_to(now, 3.0)
    if target > 1e-4:
        assert notes.phase is Phase.done
        assert notes.statement is not None
        return
    assert notes.phase is Phase.move
    now = pass_to(now, 1000.0)
    assert notes.phase is Phase.stopped, "its masses never arrived"
    assert notes.statement is None, "it is of masses that were sent elsewhere since"
