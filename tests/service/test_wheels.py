"""Wheels are braked to rest on a captured table, and on no other."""

import sys

import numpy as np
import pytest

from twin.errors import SafetyError, UsageError
from twin.plant.guard.guarded import Held
from twin.service.stages import spin_down

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")


def test_wheels_come_to_rest_and_what_they_held_is_told(dumbbell):
    with dumbbell(Held.captured, 50.0) as bench:
        told = spin_down(bench)
        speed = bench.guard.seen.newest["wheel_speed"][1]
        inertia = [wheel.inertia for wheel in bench.platform.wheels]
    assert np.all(np.abs(speed) < 2.0)
    assert len(told) == 3
    assert f"{50.0 * inertia[0]:.2g}" in told[0]


def test_a_wheel_that_is_wired_the_other_way_round_is_let_go_before_it_runs_away(dumbbell):
    with dumbbell(Held.captured, 50.0, sign=-1.0) as bench:
        with pytest.raises(SafetyError, match="and turns faster"):
            spin_down(bench)
        speed = bench.guard.seen.newest["wheel_speed"][1]
    assert np.all(np.abs(speed) < 60.0)


def test_a_floating_table_has_no_wheel_braked(dumbbell):
    with dumbbell(Held.floating, 50.0) as bench, pytest.raises(SafetyError, match="spin-down"):
        spin_down(bench)


def test_a_machine_without_wheels_says_so(table):
    with table(Held.captured) as bench, pytest.raises(UsageError, match="has no wheels"):
        spin_down(bench)


def test_the_status_has_wheel_speeds_in_rpm():
    from twin.service.status import StreamStatus

    said = StreamStatus("wheel_speed", ("w1",), (100.0,), 0.1).words()
    assert said == "wheel_speed: w1 954.9 rpm, 0.10 s old"
