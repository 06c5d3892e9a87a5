"""Before a machine flies an excitation, its lean is simulated with the CM anywhere it may be."""

import json
import sys

import numpy as np
import pytest

from twin.errors import SafetyError, UsageError
from twin.flight import Flight, prepare
from twin.plant.guard.guarded import Held
from twin.rehearsal import check_lean, identified_box, worst_lean

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
