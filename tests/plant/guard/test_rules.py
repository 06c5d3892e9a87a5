"""What a guard lets a command be: rule by rule, with the settings that they go by."""

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from tests.plant.guard.bench import SETTINGS, Bench
from twin.plant.guard.rules import RULES, GuardSettings, guard_settings
from twin.platform import load_platform


def moved(bench: Bench, target: list[float]) -> np.ndarray:
    """Where a wish sends the stages, from where they are [m]."""
    applied = bench.tell(stage_position=target)["command_stage_position"]
    return applied - bench.plant.shown["stage_position"]


def test_one_move_while_floating_changes_the_gravity_torque_by_no_more_than_a_step():
    bench = Bench(settings=replace(SETTINGS, max_balance_step=2e-3)).armed()
    lead = moved(bench, [0.05, -0.02, 0.0])
    slides = np.array([stage.mass * stage.axis for stage in bench.platform.stages])
    torque = bench.platform.gravity * np.linalg.norm(lead @ slides)
    assert 0.9 * 2e-3 < torque <= 2e-3
    assert bench.guard.limited["balance_step"] == 1


def test_captured_a_move_is_limited_by_its_drive_alone():
    bench = Bench(settings=replace(SETTINGS, max_balance_step=2e-3))
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    bench.armed()
    lead = moved(bench, [0.05, 0.0, 0.0])
    assert lead[0] == pytest.approx(bench.platform.stages[0].speed * SETTINGS.horizon)
    assert bench.guard.limited == {"rate": 1}


@pytest.mark.parametrize("margin", [0.0, 1e-4])
def test_no_move_while_floating_brings_the_cm_up_to_the_cr(margin: float):
    below = np.array([0.0, 0.0, -1e-3])
    settings = replace(SETTINGS, max_balance_step=np.inf, height_margin=margin)
    bench = Bench(settings=settings, center_of_mass_offset=below).armed()
    axes = np.array([stage.axis for stage in bench.platform.stages])
    up = int(np.argmax(np.abs(axes[:, 2])))
    place = np.zeros(3)
    for _ in range(200):
        wish = place.copy()
        wish[up] = 0.1 * np.sign(axes[up, 2])
        bench.plant.shown["stage_position"] = place = place + moved(bench, wish.tolist())
    height = bench.guard._rules.height(place)
    resolution = bench.platform.stages[up].resolution * bench.platform.stages[up].mass
    assert -margin - 2.0 * resolution <= height <= -margin
    assert bench.guard.limited["height"] > 0


def test_top_heavy_it_may_only_go_down():
    above = np.array([0.0, 0.0, 1e-3])
    settings = replace(SETTINGS, max_balance_step=np.inf)
    bench = Bench(settings=settings, center_of_mass_offset=above).armed()
    axes = np.array([stage.axis for stage in bench.platform.stages])
    up = int(np.argmax(np.abs(axes[:, 2])))
    rise = np.zeros(3)
    rise[up] = 1e-3 * np.sign(axes[up, 2])
    np.testing.assert_array_equal(moved(bench, rise.tolist()), 0.0)
    np.testing.assert_allclose(moved(bench, (-rise).tolist()), -rise)


def test_a_stage_keeps_off_its_ends():
    settings = replace(SETTINGS, max_balance_step=np.inf, horizon=100.0)
    bench = Bench(settings=settings, center_of_mass_offset=np.array([0.0, 0.0, -1.0])).armed()
    stages = bench.platform.stages
    np.testing.assert_allclose(
        moved(bench, [9.0, 9.0, 9.0]), [stage.travel[1] - 5e-3 for stage in stages]
    )
    np.testing.assert_allclose(
        moved(bench, [-9.0, -9.0, -9.0]), [stage.travel[0] + 5e-3 for stage in stages]
    )
    assert bench.guard.limited["stroke"] == 2


def test_no_motor_is_asked_for_more_than_it_has():
    bench = Bench().armed()
    applied = bench.tell(wheel_torque=[2.0, -2.0, 0.1])
    np.testing.assert_allclose(applied["command_wheel_torque"], [0.5, -0.5, 0.1])
    assert bench.guard.limited["torque"] == 1
    coils = Bench("cubesat").armed()
    np.testing.assert_allclose(
        coils.tell(dipole=[3.0, 0.0, -0.5])["command_dipole"], [1.0, 0.0, -0.5]
    )
    assert coils.guard.limited["torque"] == 1
    gas = Bench("astros").armed()
    assert gas.tell(thruster=[-1.0] * 12)["command_thruster"].min() == 0.0
    gyros = Bench("tas2").armed()
    rate = gyros.tell(gimbal_rate=[99.0, 0.0, 0.0])["command_gimbal_rate"][0]
    assert rate == gyros.platform.gimbals[0].rate
    assert gyros.guard.limited["rate"] == 1


def test_a_wheel_near_its_limit_is_turned_no_faster_and_not_braked_either():
    bench = Bench().armed()
    wheel = bench.platform.wheels[0]
    bench.plant.shown["wheel_speed"] = np.array([0.95 * wheel.speed_limit, 0.0, 0.0])
    assert bench.tell(wheel_torque=[0.1, 0.0, 0.0])["command_wheel_torque"][0] == 0.0
    assert bench.tell(wheel_torque=[-0.1, 0.0, 0.0])["command_wheel_torque"][0] == -0.1
    assert bench.guard.limited["momentum"] == 1


@pytest.mark.parametrize("shown", ["nothing", "what is not valid"])
def test_a_torque_that_is_held_while_speeds_are_not_measured_fills_no_wheel(shown: str):
    bench = Bench().armed()
    if shown == "nothing":
        bench.plant.silent = {"wheel_speed"}
    else:
        bench.plant.shown["wheel_speed"] = np.full(3, np.nan)
    torques = [bench.tell(wheel_torque=[0.5, 0.0, 0.0])["command_wheel_torque"][0]]
    while torques[-1] > 0.0 and len(torques) < 1000:
        torques.append(bench.tell()["command_wheel_torque"][0])
    gained = sum(torques) * bench.platform.tick
    share = SETTINGS.momentum_share * bench.platform.wheels[0].momentum_limit
    assert gained == pytest.approx(share)


def test_settings_of_a_machine_of_which_nothing_is_stated():
    settings = guard_settings(load_platform("sads"))
    assert 0.0 < settings.max_balance_step < 1.0
    assert settings.tilt_cutout == pytest.approx(0.8 * load_platform("sads").stop_angle)
    assert guard_settings(load_platform("dfki_pendulum")).max_balance_step == np.inf


def test_the_document_names_every_rule_and_every_number():
    document = (Path(__file__).parents[3] / "docs" / "safety.md").read_text(encoding="utf-8")
    rules, numbers = document.split("| rule |")[1].split("| key |")
    assert re.findall(r"^\| (\w+) \| ", rules, re.MULTILINE) == list(RULES)
    keys = re.findall(r"^\| `(\w+)` \| ", numbers, re.MULTILINE)
    assert keys == [field.name for field in fields(GuardSettings)]
