"""Before a machine flies an excitation, its lean is simulated with the CM anywhere it may be."""

import json
import os
import signal
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest

from twin.controller import Controller
from twin.errors import SafetyError, UsageError
from twin.flight import Flight, prepare
from twin.plant.guard.guarded import Held
from twin.platform import Platform
from twin.rehearsal import check_lean, identified_box, worst_lean
from twin.signals import Command, Estimate, Target

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")


@pytest.fixture
def flight() -> Flight:
    """Of the emulated CubeSat table; nothing is opened."""
    return prepare(
        "cubesat",
        controller="free_float",
        estimator=None,
        plant="pty",
        reference=None,
        duration=10.0,
        held=Held.floating,
        lockstep=True,
    )


def box(half_width: float) -> tuple[np.ndarray, np.ndarray]:
    """In the plane about a table that hangs by 4e-4 kg m."""
    middle, width = np.array([0.0, 0.0, -4e-4]), np.array([half_width, half_width, 0.0])
    return middle - width, middle + width


def test_a_body_let_go_level_swings_to_twice_the_angle_at_which_it_hangs(flight):
    lean, corner = worst_lean(flight, box(2e-5))
    hangs = np.arctan(np.hypot(*corner[:2]) / -corner[2])
    assert lean == pytest.approx(2.0 * hangs, rel=0.05)


def test_the_worst_corner_is_held_against_the_cut_out(flight):
    assert "it leans by up to" in check_lean(flight, box(2e-5))
    with pytest.raises(SafetyError, match=r"worst corner .* leans by up to .* of 32.0 deg"):
        check_lean(flight, box(2e-4))


@dataclass(frozen=True)
class Dreadful(Controller[float]):
    """What goes wrong at 1 s; it commands nothing. The state is the time [s]."""

    interrupts: bool = False
    gives_up: bool = False

    def init(self, platform: Platform, n: int) -> float:
        return 0.0

    def update(
        self, state: float, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, float]:
        if self.interrupts and time == 1.0:
            os.kill(os.getpid(), signal.SIGINT)
        return {}, time

    def lost(self, state: float) -> str:
        return "the law has given up" if self.gives_up and state >= 1.0 else ""


def test_a_rehearsal_that_ctrl_c_ends_is_not_flown(flight, hears):
    interrupted = replace(flight, controller=Dreadful(interrupts=True))
    with pytest.raises(KeyboardInterrupt):
        check_lean(interrupted, box(2e-5))


def test_a_rehearsal_that_does_not_come_to_its_end_is_not_flown(flight):
    lost = replace(flight, controller=Dreadful(gives_up=True))
    with pytest.raises(SafetyError, match="not flown: .* did not come to its end: the law has giv"):
        check_lean(lost, box(2e-5))


def test_a_lean_that_is_no_number_is_beyond_the_cut_out(flight, monkeypatch):
    monkeypatch.setattr(Platform, "lean", lambda self, attitude: np.full(len(attitude), np.nan))
    with pytest.raises(SafetyError, match="not flown"):
        check_lean(flight, box(2e-5))


def test_the_set_is_read_from_what_identify_writes(tmp_path):
    file = tmp_path / "found.json"
    offset = {"value": [0, 0, -1e-4], "low": [-1e-5, -1e-5, -2e-4], "high": [1e-5, 1e-5, 0]}
    file.write_text(json.dumps({"base": {"center_of_mass_offset": offset}}))
    low, high = identified_box(file)
    assert low.tolist() == offset["low"]
    assert high.tolist() == offset["high"]


@pytest.mark.parametrize("text", ["no json", "{}", '{"base": {"center_of_mass_offset": null}}'])
def test_a_file_that_tells_no_set_is_refused(tmp_path, text):
    file = tmp_path / "found.json"
    file.write_text(text)
    with pytest.raises(UsageError, match="tells no 95 % set of the CM"):
        identified_box(file)
