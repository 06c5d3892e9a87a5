"""MDrive stages on a bad line, or that fail: a reason each, and never a wrong value or move."""

import math
import re

import pytest

from tests.plant.devices.said import Said
from tests.plant.devices.stages import STEP, drives, go, stage, there, valid
from twin.emulate.emulated import Fault
from twin.errors import DeviceError
from twin.plant.devices.mdrive import CONFIGURED, HOMED, pending_error
from twin.plant.devices.mdrive_line import Mode

pytestmark = pytest.mark.wall_clock


@pytest.mark.parametrize(
    ("fault", "value"),
    [
        ("lost_reply", 1),
        ("double_reply", 5),
        ("garbled_reply", 1),
        ("late_reply", 0.3),
        ("extra_newline", 0),
        ("newline_only", 1),
        ("completion", 0),
        ("not_acknowledged", 2),
        ("error", 20),
        ("error", 63),
        ("error", 71),
    ],
)
@pytest.mark.parametrize("checksum", [True, False])
def test_trouble_on_the_line_costs_at_most_samples(armed, wait_for, fault, value, checksum):
    line, session = armed(checksum=checksum)
    go(session, 0.003)
    line.inject(Fault(fault, value=value))
    samples = wait_for(session, there(0.003))
    assert all(-STEP <= s.value[0] <= 0.003 + STEP for s in valid(samples)), "a wrong value"
    assert session.armed
    assert session.fault == ""
    if fault == "error":
        assert f"(error {value})" in session.notes[0]


@pytest.mark.parametrize("kind", ["drop", "duplicate", "garble"])
def test_a_bad_cable_gives_no_wrong_value_and_no_wrong_move(armed, wait_for, kind):
    line, session = armed()
    line.inject(Fault(kind, share=0.004))

    def arrived(samples):
        go(session, 0.003)  # as the loop does, tick by tick
        return there(0.003)(samples)

    samples = wait_for(session, arrived)
    assert all(-STEP <= s.value[0] <= 0.003 + STEP for s in valid(samples))


@pytest.mark.parametrize(
    ("fault", "value", "reason"),
    [
        ("reboot", 0, "has started anew"),
        ("stall", 0, r"the motor has stalled \(error 86\); capture the table and home it"),
        ("error", 72, r"it is too hot and has switched the motor off \(error 72\)"),
    ],
)
def test_a_position_that_is_lost_is_a_reason_and_stops_all_moves(
    armed, wait_for, reasons, fault, value, reason
):
    line, session = armed()
    go(session, 0.005)
    wait_for(session, lambda got: got and got[-1].value[0] > 0.001)
    line.inject(Fault(fault, value=value))
    samples = wait_for(session, lambda got: re.search(reason, reasons(got)))
    assert math.isnan(samples[-1].value[0])
    with pytest.raises(DeviceError, match=reason):
        go(session, 0.0)
    with pytest.raises(DeviceError, match=reason):
        session.arm()


def test_a_lost_position_stays_lost_in_the_next_session(armed, mdrive, wait_for, reasons):
    line, session = armed()
    line.inject(Fault("stall"))
    wait_for(session, lambda got: "stalled" in reasons(got))
    session.configure()
    with pytest.raises(DeviceError, match="is not homed"):
        session.arm()
    session.close()
    later = mdrive()
    later.configure()
    with pytest.raises(DeviceError, match="is not homed"):
        later.arm()


def test_a_drive_that_says_for_ever_that_it_moves_is_not_believed(armed, wait_for, reasons):
    line, session = armed(None, stage(acceleration=0.5))
    line.inject(Fault("stuck_moving"))
    go(session, 0.0005)
    wait_for(session, lambda got: "long after its move must have ended" in reasons(got))


def test_a_position_that_leaps_at_rest_is_lost(armed, wait_for, reasons):
    _, session = armed()
    wait_for(session, len)
    session.stages[0].rest(5000)  # the drive says 0
    samples = wait_for(session, lambda got: "its counter leapt from 5000 to 0" in reasons(got))
    assert not valid(samples[1:])


def test_another_drive_of_the_same_name_is_never_taken_for_a_value(armed, wait_for):
    line, session = armed(drives("12"), stage("1"), stage("2"))
    line.inject(Fault("2:wrong_address", value=ord("1")))
    go(session, 0.001, -0.001)
    samples = wait_for(session, lambda got: any(not each.valid for each in got))
    for each in valid(samples):
        low, high = (0.0, 0.001) if each.part == "s1" else (-0.001, 0.0)
        assert low - STEP <= each.value[0] <= high + STEP


@pytest.mark.parametrize("fault", [Fault("silence", duration=3.0), Fault("baud", duration=3.0)])
def test_a_dead_line_gives_reasons_and_values_when_it_lives_again(armed, wait_for, reasons, fault):
    line, session = armed()
    line.inject(fault)
    samples = wait_for(session, lambda got: "does not answer" in reasons(got))
    assert math.isnan(samples[-1].value[0])
    wait_for(session, valid)


def test_bursts_of_the_adapter_are_waited_for(armed, wait_for):
    line, session = armed()
    line.inject(Fault("burst"))
    go(session, 0.002)
    samples = wait_for(session, there(0.002))
    assert valid(samples) == samples
    assert session.counters.timeouts == 0 or session.counters.timeouts <= 4


def test_unplugging_is_a_reason_and_the_drive_still_knows_its_home(
    armed, wait_for, reasons, tmp_path
):
    line, session = armed()
    for _ in range(2):
        line.inject(Fault("unplug", duration=0.2))
        wait_for(session, lambda got: "stages: lost" in reasons(got))
        with pytest.raises(DeviceError, match="is not armed"):
            go(session, 0.0)
        wait_for(session, lambda got: (tmp_path / "port").exists())
        session.configure()
        session.arm()
        wait_for(session, valid)


def test_a_power_cycle_between_sessions_asks_for_homing(plug, mdrive):
    line = plug(drives(homed=False))
    session = mdrive()
    session.configure()
    session.close()
    line.inject(Fault("power_cycle"))
    session.configure()
    with pytest.raises(DeviceError, match="is not homed"):
        session.arm()


@pytest.fixture
def told(mdrive):
    """A session whose stage is homed and at 0, and what it makes of those answers."""

    def make(*answers, **settings):
        session = mdrive(**settings)
        session._line = line = Said(*answers)
        session.stages[0].homed = True
        session._serve(0)
        return session, line

    return make


WELL, FAILING = (0, 0, 0, HOMED), (0, 0, 1, HOMED)
"""P, MV, EF and the mark of a drive that stands at 0."""


def test_an_error_code_that_is_lost_on_the_line_may_have_been_a_stall(told):
    session, line = told(FAILING, None, WELL)
    assert "had an error whose code was lost on the line" in session.unfit()
    assert f"R1={CONFIGURED}" in line.told
    assert "SL 0" in line.told
    assert not valid(session.read())


def test_a_question_for_an_error_that_the_drive_did_not_hear_is_asked_again(told):
    session, _ = told(FAILING, None, FAILING, (86,))
    assert "the motor has stalled (error 86)" in session.unfit()
    session, line = told(FAILING, None, FAILING, (71,))
    assert session.unfit() == ""
    assert line.asked.count(("ER",)) == 2
    assert valid(session.read())


def test_an_error_that_waits_is_heard_before_settings_are_written(plug, mdrive):
    # this VI is above the factory's VM: the first time, writing it is an error of its own
    line = plug(drives())
    line.inject(Fault("error", value=86))
    session = mdrive(stage(speed=0.05, home_speed=0.05, initial_speed=0.04))
    session.configure()
    assert "the motor has stalled (error 86)" in session.unfit()


def test_a_code_that_is_lost_at_set_up_costs_the_home_and_is_said():
    who, again = "stages: drive 1", Said((1,), None, (1,), (1,), (86,))
    assert pending_error(who, again, "1", "R1", Mode()) == 86, "the drive had not heard it"
    line = Said((1,), None, (0,))
    with pytest.raises(DeviceError, match="code was lost on the line.*configure it anew and home"):
        pending_error(who, line, "1", "R1", Mode())
    assert line.told == [f"R1={CONFIGURED}"]


@pytest.mark.parametrize("checksum", [True, False])
def test_one_wrong_mark_is_doubted_and_two_in_a_row_cost_the_home(told, checksum):
    rest = () if checksum else (0,)  # the position, once more
    well, wrong = (0, 0, 0, HOMED, *rest), (0, 0, 0, HOMED ^ 4, *rest)
    session, line = told(wrong, well, wrong, well, checksum=checksum)
    assert session.unfit() == ""
    assert valid(session.read())
    session._serve(0)
    assert session.unfit() == "", "not in a row"
    assert line.told == []
    session, line = told(wrong, wrong, checksum=checksum)
    assert f"has started anew (R1 is {HOMED ^ 4})" in session.unfit()
    assert not valid(session.read())
