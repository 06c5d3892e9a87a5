"""The guard arms, stops and rests a machine by its rules, each with its sentence."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.plant.guard.bench import SETTINGS, Bench, Scripted
from tests.processes import wait_until
from twin.clock import SimulatedClock
from twin.controller.load import load_controller
from twin.errors import SafetyError, UsageError
from twin.estimators.named import load_estimator
from twin.loop import Ended, fly
from twin.plant.guard import rules
from twin.plant.guard.guarded import Guarded, GuardPhase, Held
from twin.plant.guard.rules import guard_settings
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.reference import Hold
from twin.rotation import from_rotation_vector
from twin.signals import Reading

# ---- arming


def test_it_begins_disarmed_and_computes_without_sending():
    bench = Bench()
    applied = bench.tell(wheel_torque=[0.1, 0.1, 0.1], stage_position=[0.01, 0.0, 0.0])
    assert bench.guard.phase is GuardPhase.disarmed
    assert bench.plant.told == []
    assert all(not value.any() for value in applied.values())


@pytest.mark.parametrize("said", ["", "y", "yes", "ARM"])
def test_only_the_word_arms_it(said: str):
    bench = Bench()
    with pytest.raises(SafetyError, match="nobody has said so; type 'arm', each session"):
        bench.guard.arm(said)
    assert bench.guard.phase is GuardPhase.disarmed


def test_without_a_calibration_file_it_is_not_armed():
    guard = Guarded(Scripted(load_platform("sads")), SETTINGS, calibrated=False)
    guard.read(0.0)
    with pytest.raises(SafetyError, match="no calibration file; calibrate this machine"):
        guard.arm("arm")


def test_without_a_signal_somebody_must_say_whether_it_floats():
    bench = Bench()
    bench.plant.silent = {"floating"}
    bench.guard.seen.newest.pop("floating")
    with pytest.raises(SafetyError, match="no signal says .*; look, and type 'floating' or"):
        bench.guard.arm("arm")
    assert bench.guard.floating, "where nobody knows, it may float"
    bench.guard.arm("arm", held=Held.captured)
    assert not bench.guard.floating


def test_the_operator_does_not_overrule_the_air():
    bench = Bench()
    with pytest.raises(SafetyError, match="never go by the word alone"):
        bench.guard.arm("arm", held=Held.captured)
    with pytest.raises(SafetyError, match="never go by the word alone"):
        bench.guard.captured()
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    with pytest.raises(SafetyError, match="the air that it does not; turn the air on"):
        bench.guard.arm("arm", held=Held.floating)


def test_a_signal_of_the_air_that_fell_silent_is_believed_no_more():
    bench = Bench()
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    bench.guard.arm("arm", held=Held.captured)
    assert not bench.guard.floating
    bench.plant.silent = {"floating"}
    bench.read(25)
    assert bench.guard.phase is GuardPhase.armed
    assert bench.guard.floating, "nobody knows whether the air has come on meanwhile"
    bench.guard.disarm()
    for held in (None, Held.floating, Held.captured):
        with pytest.raises(SafetyError, match="floating told of the air and .* silent for 1.25 s"):
            bench.guard.arm("arm", held=held)
    with pytest.raises(SafetyError, match="it may float"):
        bench.guard.captured()


def test_a_silent_sensor_keeps_it_from_being_armed():
    bench = Bench()
    bench.plant.silent = {"gyro"}
    bench.read(4)
    with pytest.raises(SafetyError, match="no fresh sample of gyro .*check the device"):
        bench.guard.arm("arm")


def test_tilted_it_is_not_armed():
    bench = Bench()
    bench.plant.shown["attitude"] = from_rotation_vector(np.array([0.5, 0.0, 0.0]))
    bench.read()
    with pytest.raises(SafetyError, match="it leans by 28.6 deg, more than the 20.0 deg.*level"):
        bench.guard.arm("arm")


def test_without_a_sensor_of_tilt_there_is_no_cut_out_and_no_arming():
    bench = Bench()
    bench.guard.seen.newest.pop("attitude")
    bench.guard.seen._needed = ()
    bench.guard.seen._stale.clear()
    with pytest.raises(SafetyError, match="no sensor tells the tilt"):
        bench.guard.arm("arm")


def test_a_stop_must_be_armed_anew():
    bench = Bench().armed()
    bench.guard.stop("a reason")
    assert bench.is_safe("a reason")
    bench.guard.arm("arm")
    assert bench.guard.safe_reason == ""
    assert bench.guard.stopped == {}
    bench.tell(wheel_torque=[0.1, 0.0, 0.0])
    assert bench.plant.told[-1]["command_wheel_torque"][0, 0] == 0.1


def test_a_batch_of_runs_is_no_machine():
    with pytest.raises(UsageError, match="not for a batch of 3"):
        Guarded(SimulatedPlant(load_platform("sads"), runs=range(3)), SETTINGS, calibrated=True)


# ---- what stops it


def test_a_command_that_is_not_a_number_stops_it():
    bench = Bench().armed()
    bench.tell(wheel_torque=[0.0, np.nan, 0.0])
    assert bench.is_safe("command_wheel_torque w2 is nan: the law has failed")


def test_beyond_the_tilt_cut_out_all_stops():
    bench = Bench().armed()
    bench.plant.shown["attitude"] = from_rotation_vector(np.array([0.0, 0.36, 0.0]))
    assert bench.is_safe("it leans by 20.6 deg, more than the 20.0 deg at which all stops")


def test_an_inclinometer_cuts_out_where_there_is_no_attitude():
    bench = Bench().armed()
    bench.plant.shown["inclinometer"] = np.array([0.3, -0.3])
    assert bench.is_safe("it leans by 24.7 deg")


def test_a_stale_stream_stops_it_after_the_cycles_that_are_allowed():
    bench = Bench().armed()
    bench.plant.silent = {"gyro"}
    bench.read(SETTINGS.stale_cycles)  # in the first period the last sample is still fresh
    assert bench.guard.phase is GuardPhase.armed
    bench.read(2)
    assert bench.is_safe("gyro is stale: nothing valid for")


def test_samples_that_are_not_valid_are_no_samples():
    bench = Bench().armed()
    bench.plant.shown["gyro"] = np.full(3, np.nan)
    honest = bench.plant.read

    def read(until: float) -> Reading:
        reading = honest(until)
        gyro = reading.streams["gyro"]
        lost = replace(gyro, valid=np.zeros_like(gyro.valid))
        return replace(reading, streams=dict(reading.streams) | {"gyro": lost})

    bench.plant.read = read
    bench.read(10)
    assert bench.is_safe("gyro is stale")


@pytest.mark.parametrize("held", [None, Held.floating])
def test_lost_air_stops_it_whatever_word_it_was_armed_by(held: Held | None):
    bench = Bench()
    bench.guard.arm("arm", held=held)
    bench.plant.shown["floating"] = np.zeros(1)
    assert bench.is_safe("the air was lost: the table is coming down")


def test_air_that_is_lost_while_its_signal_is_silent_stops_it_when_it_is_heard_again():
    bench = Bench()
    bench.guard.arm("arm", held=Held.floating)
    bench.plant.silent = {"floating"}
    bench.read(25)
    assert bench.guard.phase is GuardPhase.armed
    bench.plant.silent, bench.plant.shown["floating"] = set(), np.zeros(1)
    assert bench.is_safe("the air was lost")


def test_lost_air_is_seen_by_its_pressure_where_only_that_is_measured():
    bench = Bench(settings=replace(SETTINGS, air_pressure=3e5))
    bench.plant.silent = {"floating"}
    bench.guard.seen.newest.pop("floating")
    bench.plant.shown["air_pressure"] = np.array([4e5])
    bench.read()
    bench.armed()
    bench.plant.shown["air_pressure"] = np.array([2e5])
    assert bench.is_safe("the air was lost")


def test_a_position_that_jumps_while_floating_stops_it_until_it_was_captured():
    bench = Bench().armed()
    bench.plant.shown["stage_position"] = np.array([0.0, 0.05, 0.0])
    assert bench.is_safe("masses hold, wheels coast: capture it first")
    assert "reads 50.00 mm after 0.00 mm 0.05 s before" in bench.guard.safe_reason
    with pytest.raises(SafetyError, match="not armed: stage .* capture it first, then home"):
        bench.guard.arm("arm")
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    bench.guard.captured()
    bench.plant.shown["floating"] = np.ones(1)
    bench.read()
    bench.guard.arm("arm")


def test_a_loop_that_hangs_is_stopped_by_the_watchdog(monkeypatch):
    now = 100.0  # told, so that a busy machine neither hangs for the loop nor saves it
    monkeypatch.setattr(rules, "time", SimpleNamespace(monotonic=lambda: now))
    bench = Bench(settings=replace(SETTINGS, watchdog=0.1)).armed()
    for _ in range(5):
        bench.tell(wheel_torque=[0.1, 0.0, 0.0])
        now += 0.09
        time.sleep(0.15)  # meanwhile it looks
        assert bench.guard.phase is GuardPhase.armed
    now += 0.06
    wait_until(lambda: bench.plant.safe)
    assert bench.is_safe("no command for 0.15 s")
    rest, _ = bench.plant.safe[0]
    assert not rest["command_wheel_torque"].any()


def test_a_watchdog_that_ends_as_it_is_fed_does_no_harm(monkeypatch):
    bench = Bench(settings=replace(SETTINGS, watchdog=60.0)).armed()
    watchdog = bench.guard._watchdog
    seen = iter([watchdog])
    ends = property(lambda guard: next(seen, None), lambda guard, dog: None)
    monkeypatch.setattr(Guarded, "_watchdog", ends, raising=False)
    assert bench.tell(wheel_torque=[0.1, 0.0, 0.0])["command_wheel_torque"][0] == 0.1
    watchdog.stop()


def test_closing_it_armed_leaves_it_safe():
    bench = Bench().armed()
    bench.tell(wheel_torque=[0.1, 0.0, 0.0])
    bench.guard.close()
    assert len(bench.plant.safe) == 1
    assert bench.guard.phase is GuardPhase.disarmed


def test_a_sample_that_comes_late_does_not_replace_a_newer_one():
    bench = Bench().armed()
    bench.read(3)
    newest = bench.guard.seen.newest["stage_position"][0]
    honest = bench.plant.read

    def late(until: float) -> Reading:
        reading = honest(until)
        old = reading.streams["stage_position"]
        old = replace(old, time=old.time - 10.0, value=old.value + 0.05)
        return replace(reading, streams=dict(reading.streams) | {"stage_position": old})

    bench.plant.read = late
    bench.read()
    assert bench.guard.seen.newest["stage_position"][0] == newest
    assert not bench.guard.seen.lost


# ---- the safe state


def test_wheels_are_let_coast_and_stages_hold_where_their_ramps_end():
    bench = Bench().armed()
    bench.plant.shown["wheel_speed"] = np.array([100.0, -50.0, 0.0])
    bench.plant.shown["stage_position"] = np.array([2e-4, 0.0, 0.0])
    bench.tell(wheel_torque=[0.2, 0.2, 0.2], stage_position=[9e-4, 0.0, 0.0])
    bench.guard.stop("enough")
    rest, floating = bench.plant.safe[0]
    assert floating
    assert not rest["command_wheel_torque"].any(), "zero torque: coasting, never braked"
    stage = bench.platform.stages[0]
    ramp = 0.5 * stage.speed**2 / stage.acceleration
    target = bench.plant.told[-1]["command_stage_position"][0, 0]
    held = rest["command_stage_position"][0, 0]
    assert 2e-4 < held <= min(2e-4 + ramp, target), "it brakes onwards, and never turns back"


@pytest.mark.parametrize(
    ("machine", "command", "width"),
    [
        ("tas2", "gimbal_rate", 3),
        ("cubesat", "dipole", 3),
        ("astros", "thruster", 12),
        ("sads", "wheel_torque", 3),
    ],
)
def test_at_rest_gimbals_stand_coils_are_off_and_thrusters_are_closed(
    machine: str, command: str, width: int
):
    bench = Bench(machine).armed()
    applied = bench.tell(**{command: np.full(width, 0.01)})
    assert applied[f"command_{command}"].any()
    bench.guard.stop("enough")
    rest, _ = bench.plant.safe[0]
    assert not rest[f"command_{command}"].any()


@pytest.mark.parametrize("what", ["homing", "zeroing", "a move from end to end"])
def test_homing_and_full_strokes_are_for_a_captured_table(what: str):
    bench = Bench()
    with pytest.raises(SafetyError, match=f"{what} refused: the table floats.*capture it"):
        bench.guard.captured_only(what)
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    bench.guard.captured_only(what)


# ---- around the simulated machine


def test_a_run_on_the_simulated_table_ends_safely_with_the_reason():
    platform = load_platform("sads")
    heavy = replace(platform, center_of_mass_offset=np.array([0.05, 0.02, 0.01]))
    plant = SimulatedPlant(heavy, initial=InitialState())
    guard = Guarded(plant, guard_settings(platform), calibrated=True)
    guard.read(0.0)
    guard.arm("arm", held=Held.floating)
    outcome = fly(
        guard,
        load_estimator("passthrough"),
        load_controller("quaternion_pd"),
        Hold(),
        SimulatedClock(),
        duration=60.0,
    )
    assert outcome.ended is Ended.safe_stop
    assert "deg at which all stops" in outcome.reason
    speed = plant.truth()["truth_wheel_speed"].value[0, 0]
    assert np.abs(speed).max() > 1.0, "wheels are left turning"
