"""What an actuator shows of itself is held against what it was told."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.plant.guard.bench import SETTINGS, Bench
from twin.plant.guard.actuators import ActuatorMonitor
from twin.plant.guard.rules import guard_settings
from twin.platform import load_platform
from twin.signals import Reading, Samples

SADS = load_platform("sads")


def watched(
    platform, stream: str, shown: Callable[[float], float], told: Callable[[float], float], **kind
) -> str:
    """What the monitor says, of the first part; the others stand still."""
    command, seconds = kind["command"], kind.get("seconds", 20.0)
    monitor = ActuatorMonitor(platform)
    width = platform.commands[command]
    period = 1.0 / platform.sensors[stream].rate
    due = 0.0
    for tick in range(round(seconds / platform.tick)):
        now = tick * platform.tick
        streams = {}
        if now >= due - 1e-9:
            due += period
            value = np.zeros((1, 1, width))
            value[0, 0, 0] = shown(now)
            streams[stream] = Samples(value, np.full((1, 1), now), np.ones((1, 1), np.bool_))
        fault = monitor.take(Reading(now, streams))
        if fault:
            return fault
        command_now = np.zeros((1, width))
        command_now[0, 0] = told(now)
        monitor.take_command({command: command_now})
    return ""


def wheel(shown, told, seed=0, **kind) -> str:
    rng = np.random.default_rng(seed)
    noise = SADS.sensors["wheel_speed"].noise[0]
    return watched(
        SADS,
        "wheel_speed",
        lambda time: shown(time) + noise * rng.normal(),
        told,
        command="command_wheel_torque",
        **kind,
    )


INERTIA, LIMIT = SADS.wheels[0].inertia, SADS.wheels[0].torque_limit
SWING = 0.3 * LIMIT
"""Amplitude of a torque at 0.1 Hz [N m]."""


def swinging(time: float) -> float:
    return SWING * math.sin(0.2 * math.pi * time)


def speed(time: float) -> float:
    """The integral of `swinging`, over the inertia."""
    return SWING / (0.2 * math.pi) * (1.0 - math.cos(0.2 * math.pi * time)) / INERTIA


def test_a_wheel_that_does_what_it_is_told_is_never_stopped():
    for seed, gain in enumerate((0.8, 1.0, 1.2)):
        friction = 0.05 * LIMIT * 10.0 / INERTIA
        shown = lambda t, gain=gain, friction=friction: gain * speed(t) - friction * t / 20.0  # noqa: E731
        assert wheel(shown, swinging, seed) == ""


def test_a_wheel_that_runs_up_by_itself_is_stopped_within_seconds():
    fault = wheel(lambda t: LIMIT * t / INERTIA, lambda t: 0.0, seconds=3.0)
    assert fault.startswith(f"wheel {SADS.wheels[0].name} does not do what it is told: in ")


def test_a_wheel_that_turns_the_other_way_or_not_at_all_is_stopped():
    assert "does not do what it is told" in wheel(lambda t: -speed(t), swinging)
    # small torques, which are told by their share only
    small = lambda t: 0.4 * swinging(t)  # noqa: E731
    assert "the wrong way round" in wheel(lambda t: -0.4 * speed(t), small)
    assert "hardly does what it is told" in wheel(lambda t: 0.0, small)


def test_a_wheel_that_friction_holds_against_small_torques_is_not_stopped():
    assert wheel(lambda t: 0.0, lambda t: 0.02 * swinging(t)) == ""


def stage(shown, told, platform=SADS, **kind) -> str:
    return watched(
        platform, "stage_position", shown, told, command="command_stage_position", **kind
    )


def drive(platform, goal: float, start: float = 0.5) -> Callable[[float], float]:
    """A stage that goes to `goal` [m] from time `start` [s] on, at three quarters of its speed."""
    return lambda time: min(max(time - start, 0.0) * 0.75 * platform.stages[0].speed, goal)


def test_a_stage_that_goes_where_it_is_sent_is_not_stopped():
    goal = 0.01
    assert stage(drive(SADS, goal), lambda t: goal) == ""
    # a screw of another pitch ends elsewhere
    assert stage(lambda t: 0.98 * drive(SADS, goal)(t), lambda t: goal) == ""
    # one that follows a target which never rests
    lead = SADS.stages[0].speed * 0.25
    assert stage(drive(SADS, 1.0), lambda t: drive(SADS, 1.0)(t) + lead, seconds=5.0) == ""


def test_a_stage_that_stands_or_runs_away_is_stopped_with_both_positions():
    fault = stage(lambda t: 0.0, lambda t: 1e-3)
    assert fault.startswith(f"stage {SADS.stages[0].name} does not follow: it was sent to 1.000 mm")
    assert "does not follow" in stage(lambda t: -drive(SADS, 1.0)(t), lambda t: 1e-3, seconds=6.0)


def test_a_stage_that_stands_while_it_is_sent_to_and_fro_is_stopped():
    to_and_fro = lambda t: 5e-4 * math.copysign(1.0, math.sin(2.0 * math.pi * t))  # noqa: E731
    assert "was sent over" in stage(lambda t: 0.0, to_and_fro)
    assert stage(lambda t: 0.5 * to_and_fro(t - 0.2), to_and_fro) == ""


def test_a_gimbal_that_stands_while_it_is_told_to_turn_is_stopped():
    tas2 = load_platform("tas2")
    rate = tas2.gimbals[0].rate
    told = lambda t: 0.5 * rate * math.sin(t)  # noqa: E731
    kind = {"command": "command_gimbal_rate"}
    assert (
        watched(tas2, "gimbal_angle", lambda t: 0.5 * rate * (1 - math.cos(t)), told, **kind) == ""
    )
    assert "gimbal" in watched(tas2, "gimbal_angle", lambda t: 0.0, told, **kind)


def test_beyond_the_rate_cut_out_all_stops():
    bench = Bench(settings=replace(SETTINGS, rate_cutout=math.radians(30.0))).armed()
    bench.plant.shown["gyro"] = np.radians([0.0, 0.0, 31.0])
    assert bench.is_safe("it turns by 31.0 deg/s, more than the 30.0 deg/s at which all stops")


@pytest.mark.parametrize("name", ["cubesat", "astros", "sads", "tas2", "whorl1", "whorl2"])
def test_every_table_has_a_rate_cut_out_within_what_its_gyro_shows(name):
    platform = load_platform(name)
    assert guard_settings(platform).rate_cutout < platform.sensors["gyro"].range


def test_a_stage_that_does_not_follow_ends_a_guarded_flight():
    bench = Bench().armed()
    for _ in range(80):
        bench.tell(stage_position=[2e-3, 0.0, 0.0])
    assert bench.is_safe("does not follow")
