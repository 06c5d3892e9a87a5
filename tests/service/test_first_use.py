"""What a law will command is tried first: the right way goes on, any other is refused by name."""

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from twin.bench import Bench
from twin.errors import SafetyError
from twin.plant.guard.guarded import GuardPhase, Held
from twin.plant.hardware_setup import HardwareSetup, read_hardware
from twin.service import first_use
from twin.service.first_use import Evidence, armed, body_evidence
from twin.service.session import Session

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")

COILS, STAGES, WHEELS = "command_dipole", "command_stage_position", "command_wheel_torque"


def turned_round(setup: HardwareSetup, *streams: str) -> HardwareSetup:
    """The same wiring with the other sign on these."""
    measured, commanded = (
        tuple(replace(r, scale=-1.0) if r.stream in streams else r for r in routes)
        for routes in (setup.measured, setup.commanded)
    )
    return replace(setup, measured=measured, commanded=commanded)


def test_a_machine_that_does_what_is_predicted_goes_on_armed_from_time_0(table):
    told: list[str] = []
    with table(Held.floating) as bench:
        clock = armed(bench, [STAGES, COILS], told.append)
        for now in clock.ticks(bench.platform.tick, 1.0):
            bench.read(now)
            bench.write({COILS: np.zeros((1, 3))})
            assert bench.guard.seen.age("gyro") < 0.2, "time began anew for all that was seen"
        assert bench.guard.phase is GuardPhase.armed
        places = bench.guard.seen.stage_position
    np.testing.assert_allclose(places, 0.0, atol=1.5e-5, err_msg="each mass is where it was")
    names = [line.split(" (")[0].removeprefix("first use of ") for line in told]
    assert names == ["s1", "s2", "s3", "x", "y", "z"]
    for line in (told[0], told[1], told[3], told[4]):
        assert "the gyro showed" in line
        assert "does not tell" not in line
    assert "stage_position showed" in told[2]
    # a coil along the field turns nothing
    assert "does not tell the sign" in told[5]


def test_nothing_is_tried_on_a_machine_that_nobody_has_armed(table):
    told: list[str] = []
    with table() as bench:
        armed(bench, [STAGES, COILS], told.append)
        assert bench.guard.phase is GuardPhase.disarmed
    assert not told


@pytest.mark.parametrize(
    ("wrong", "tried", "sentence"),
    [
        ((COILS,), COILS, r"first use of x .* the gyro showed -.*acts the wrong way round"),
        (
            (STAGES, "stage_position"),
            STAGES,
            r"first use of s1 .* a turn of \+.* about y, the gyro showed -.*the wrong way round",
        ),
        ((STAGES,), STAGES, r"first use of s1 .* stage_position showed one of -0\.\d+ mm"),
    ],
    ids=["coils", "stages with their counters", "stages against their counters"],
)
def test_what_acts_the_other_way_round_is_refused(cubesat, table, wrong, tried, sentence):
    believed = turned_round(read_hardware(cubesat), *wrong)
    with table(Held.floating, believed=believed) as bench:
        with pytest.raises(SafetyError, match=sentence):
            armed(bench, [tried], print)
        assert np.abs(bench.guard.seen.stage_position).max() < 1e-3
    assert bench.guard.phase is GuardPhase.disarmed


def test_a_wheel_is_tried_by_the_body_and_by_its_own_speed(dumbbell):
    told: list[str] = []
    with dumbbell(Held.floating, 0.0) as bench:
        armed(bench, [WHEELS], told.append)
    assert len(told) == 3
    assert all("the gyro showed" in line and "wheel_speed showed" in line for line in told)


@pytest.mark.parametrize("held", list(Held), ids=lambda held: held.value)
def test_a_wheel_that_is_wired_the_wrong_way_round_is_refused(dumbbell, held):
    shows = "the gyro" if held is Held.floating else "wheel_speed"
    with (
        dumbbell(held, 0.0, sign=-1.0) as bench,
        pytest.raises(SafetyError, match=f"first use of w1 .*{shows} showed -"),
    ):
        armed(bench, [WHEELS], print)


def test_a_captured_machine_says_what_it_cannot_tell(table):
    told: list[str] = []
    with table(Held.captured) as bench:
        armed(bench, [COILS], told.append)
    assert all("while it is captured nothing shows what it does" in line for line in told)


def test_set_points_go_on_while_a_push_is_judged(table, monkeypatch: pytest.MonkeyPatch):
    def judged(seen: Session, *more: Any) -> Evidence | None:
        begun, waited = sessions[0].now, 0
        while sessions[0].now < begun + 0.5 and waited < 1000:  # one is valid for 0.25 s
            time.sleep(0.01)
            waited += 1
        gone_on.append(sessions[0].now - begun)
        return body_evidence(seen, *more)

    sessions: list[Session] = []
    gone_on: list[float] = []
    monkeypatch.setattr(first_use, "body_evidence", judged)
    with table(Held.floating) as bench:
        # as where the wall's clock counts, at the pace of lockstep
        monkeypatch.setattr(Bench, "in_lockstep", False)
        sessions.append(Session(bench))
        first_use.first_use(sessions[0], [COILS])
        assert bench.guard.phase is GuardPhase.armed
    assert len(gone_on) >= 3
    assert min(gone_on) >= 0.5
