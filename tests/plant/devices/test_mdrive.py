"""A session with MDrive stages against their emulation, over a pty at the line's rate."""

import math
import re
import time

import numpy as np
import pytest

from tests.plant.devices.stages import COMMAND, STEP, drives, go, stage, there, valid
from twin.emulate.line import EmulatedLine
from twin.emulate.mdrive import Axis
from twin.errors import CommandError, DeviceError, UsageError

pytestmark = pytest.mark.wall_clock

SWITCHES = {1: (1, 0), 2: (2, 1), 3: (3, 1)}


@pytest.mark.parametrize("checksum", [True, False])
@pytest.mark.parametrize("echo_mode", [0, 1, 2, 3])
def test_a_stage_goes_where_it_is_told_in_every_mode(armed, wait_for, echo_mode, checksum):
    _, session = armed(echo_mode=echo_mode, checksum=checksum)
    applied = go(session, 0.002)
    assert applied == pytest.approx([0.002], abs=STEP / 2)
    samples = wait_for(session, there(0.002))
    positions = np.array([each.value[0] for each in valid(samples)])
    assert np.all(np.diff(positions) >= 0.0)
    assert session.counters.bad_checksums == 0
    assert not session.notes


def test_a_drive_that_sends_empty_lines_before_values_is_understood(armed, wait_for):
    _, session = armed(drives(newline_before_value=True), checksum=False)
    go(session, 0.001)
    wait_for(session, there(0.001))


def test_three_stages_share_a_line(armed, wait_for):
    _, session = armed(drives("1a2"), stage("1"), stage("a"), stage("2"))
    go(session, 0.001, -0.0005, 0.0)
    samples = wait_for(session, lambda got: there(0.001)(got) and there(-0.0005, "sa")(got))
    assert {each.part for each in samples} == {"s1", "sa", "s2"}
    assert all(s.value == (0.0,) for s in valid(samples) if s.part == "s2")


def test_speeds_are_written_and_read_back_before_the_first_move(tmp_path, mdrive, wait_for):
    log = tmp_path / "bytes"
    with EmulatedLine(drives(), tmp_path / "port", log=log):
        session = mdrive()
        session.configure()
        session.arm()
        go(session, 0.025)
        wait_for(session, there(0.025 * 0.25))
        session.close()
    sent = b"".join(
        bytes.fromhex(line[1:]) for line in log.read_text().splitlines() if line[0] == "<"
    ).decode("latin1")
    speed = round(0.025 / STEP)
    first_move = sent.index("MA ")
    assert sent.index(f"VM={speed}") < sent.index('VI,"_"VM') < first_move
    assert "A=1024000" in sent[:first_move]
    assert "D=1024000" in sent[:first_move]
    assert set(re.findall(r"SL -?\d+", sent)) == {"SL 0"}, "a slew would outlive its host"
    assert "\x1b" not in sent
    assert "DE=0" not in sent


def test_a_move_is_no_longer_than_a_quarter_second_of_full_speed(armed, wait_for):
    _, session = armed()
    assert go(session, 0.02) == pytest.approx([0.00625], abs=STEP)
    samples = wait_for(session, there(0.00625))
    speeds = np.diff([s.value[0] for s in samples]) / np.diff([s.host_time for s in samples])
    assert np.max(speeds) < 1.6 * 0.025, "1.52 times that would be the factory's VM"


def test_travel_bounds_what_is_applied(armed):
    _, session = armed(None, stage(travel=(-0.001, 0.002)))
    assert go(session, 0.01) == pytest.approx([0.002], abs=STEP)
    assert go(session, -0.01) == pytest.approx([-0.001], abs=STEP)


def test_the_order_of_a_dead_host_is_not_given(armed, wait_for):
    _, session = armed()
    session.stages[0].want(20_000, time.monotonic() - 1.0)
    samples = wait_for(session, lambda got: len(valid(got)) >= 10)
    assert samples[-1].value == (0.0,)


def test_homing_counts_from_the_switch_and_is_remembered_by_the_drive(plug, mdrive, wait_for):
    plug(drives(homed=False, axis=Axis(position=4000)))
    quick = stage(inputs=SWITCHES, initial_speed=1e-3, home_speed=4e-3, home_position=0.001)
    session = mdrive(quick)
    session.configure()
    with pytest.raises(DeviceError, match=r"stage s1 \(drive 1\) is not homed; home it when capt"):
        session.arm()
    assert "is not homed" in wait_for(session, len)[0].reason
    session.home(captured=True)
    assert wait_for(session, lambda got: valid(got))
    session.close()
    session = mdrive(quick)
    session.configure()
    session.arm()
    assert valid(wait_for(session, len))[0].value[0] == pytest.approx(0.001, abs=STEP / 2)


def test_homing_a_floating_table_is_refused(armed):
    _, session = armed()
    with pytest.raises(DeviceError, match="would throw a floating table; capture the table first"):
        session.home(captured=False)


def test_homing_without_a_switch_is_refused(armed):
    _, session = armed()
    with pytest.raises(DeviceError, match="drive 1: has no home switch; set up an input of kind 1"):
        session.home(captured=True)


def test_a_limit_switch_is_told_and_lets_the_stage_go_back_only(armed, wait_for):
    _, session = armed(drives(axis=Axis(travel=20_000)), stage(inputs=SWITCHES))
    go(session, 0.005)
    wait_for(session, lambda got: len(session.notes) >= 2)
    notes = " ".join(session.notes)
    assert "stage s1 (drive 1): it is at the limit switch towards plus (error 83)" in notes
    assert "stopped at" in notes
    here = session.read()[-1].value[0] if session.read() else wait_for(session, len)[-1].value[0]
    assert go(session, 0.01) == pytest.approx([here], abs=STEP)
    assert go(session, 0.0) == pytest.approx([0.0], abs=STEP)
    wait_for(session, there(0.0))
    assert go(session, 0.0005) == pytest.approx([0.0005], abs=STEP)


def test_a_safe_stop_ends_a_move_on_its_ramp_and_holds(armed, wait_for):
    _, session = armed(None, stage(acceleration=0.5))
    go(session, 0.00625)
    wait_for(session, lambda got: got and got[-1].value[0] > 0.001)
    session.safe_stop(floating=True)
    samples = wait_for(session, lambda got: len(got) > 20 and got[-1].value == got[-10].value)
    assert 0.001 < samples[-1].value[0] < 0.00625
    assert valid(samples)[-1] == samples[-1]
    with pytest.raises(DeviceError, match="stages: is not armed; arm it before commanding it"):
        go(session, 0.0)
    session.arm()
    go(session, 0.001)
    wait_for(session, there(0.001))


def test_an_absent_drive_is_named(plug, mdrive):
    plug(drives("1"))
    with pytest.raises(DeviceError, match="stages: drive 2: does not answer on .*party mode"):
        mdrive(stage("1"), stage("2")).connect()


def test_a_setting_that_the_drive_does_not_have_is_told(plug, mdrive):
    plug(drives(saved={"MS": 128}))
    with pytest.raises(DeviceError, match="drive 1: MS is 128, not 256 as written"):
        mdrive().configure()


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ({COMMAND: np.array([math.nan])}, "give 1 finite numbers"),
        ({COMMAND: np.zeros(2)}, "give 1 finite numbers"),
        ({"command_dipole": np.zeros(3)}, "takes no command_dipole, only command_stage_position"),
    ],
)
def test_a_command_that_is_none_is_refused(mdrive, command, sentence):
    with pytest.raises(CommandError, match=sentence):
        mdrive().write(command)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"address": "12"}, "address '12': an MDrive's name is a letter or a digit"),
        ({"travel": (0.1, 0.0)}, "give lowest and highest"),
        ({"speed": 1.0}, "VM would be 20157480; the drive takes 1 to 5000000"),
        ({"microsteps": 255}, "an MDrive has no 255 microsteps"),
        ({"home_speed": 1e-5}, "must be above the initial"),
    ],
)
def test_settings_that_cannot_work_are_refused(settings, sentence):
    with pytest.raises(UsageError, match=sentence):
        stage(**settings)


def test_two_drives_of_one_name_are_refused(mdrive):
    with pytest.raises(UsageError, match="give each its own address"):
        mdrive(stage("1"), stage("1"))
