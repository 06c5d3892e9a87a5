"""Effects on gimbals, coils and thrusters, on the machines that have them."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from twin.effects import parse_effects, with_effects
from twin.model import compile_model
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.rotation import from_rotation_vector, rotate


def rates_after(platform: Platform, text: str, name: str, value: np.ndarray) -> np.ndarray:
    """(n, 3) rates of n runs after one tick under a command (n, k)."""
    effects = parse_effects(text) if text else ()
    plant = SimulatedPlant(with_effects(platform, effects), runs=range(len(value)))
    plant.read(0.0)
    plant.write({name: value})
    plant.read(platform.tick)
    return plant.truth()["truth_rate"].value[:, 0]


def test_a_coil_of_another_gain_turns_the_table_as_another_command(agrees):
    table = load_platform("cubesat")
    told = np.array([[0.3, -0.2, 0.1]])
    askew = rates_after(table, "magnetorquer_gain=0.1/-0.2/0.3", "command_dipole", told)
    plain = rates_after(table, "", "command_dipole", told * [1.1, 0.8, 1.3])
    error = np.abs(askew - plain).max() / np.abs(plain).max()
    agrees("magnetorquer_gain: as a dipole of that size", error, 1e-12)
    unaware = rates_after(table, "", "command_dipole", told)
    assert np.abs(askew - unaware).max() > 0.05 * np.abs(plain).max()


@pytest.mark.parametrize("name", ["whorl1", "astros:mode_c"])
def test_an_askew_thruster_gives_the_torque_of_its_turned_force(name, agrees):
    machine = load_platform(name)
    assert machine.gas is not None
    # gas that leaves a tank would move the CM meanwhile
    weightless = replace(machine.gas, tanks=())
    machine = replace(machine, center_of_mass_offset=np.zeros(3), gas=weightless)
    thruster = machine.thrusters[0]
    forces = np.diag([0.1 * one.force_limit for one in machine.thrusters])
    arms = np.array([np.cross(one.point, one.direction) for one in machine.thrusters])
    plain = rates_after(machine, "", "command_thruster", forces)
    text = f"thruster_misalignment:{thruster.name}=0.1/-0.2/0.15"
    askew = rates_after(machine, text, "command_thruster", forces)
    # from rest the machine answers torques in proportion
    answer = np.linalg.lstsq(forces @ arms, plain, rcond=None)[0]
    turn = from_rotation_vector(np.array([0.1, -0.2, 0.15]))
    turned = np.cross(thruster.point, rotate(turn, thruster.direction))
    size = np.abs(plain).max()
    error = np.abs(askew[0] - forces[0, 0] * turned @ answer).max() / size
    agrees(f"thruster_misalignment of {name}: torque of the turned force", error, 5e-7)
    np.testing.assert_allclose(askew[1:], plain[1:], atol=1e-12 * size)
    assert np.abs(askew[0] - plain[0]).max() > 0.01 * size


def test_an_unbalanced_gimbal_weighs_where_its_angle_turns_it(agrees):
    platform = load_platform("tas2")
    (effect,) = parse_effects("gimbal_center_of_mass_offset:g1=0.02/-0.01")
    gimbal, rotor = platform.gimbals[0], platform.rotors[0]
    moment = 0.02 * rotor.axis - 0.01 * np.cross(gimbal.axis, rotor.axis)
    turned = rotate(from_rotation_vector(0.7 * gimbal.axis), moment)
    change = mass_moment(with_effects(platform, (effect,))) - mass_moment(platform)
    error = np.abs(change - (turned - moment)).max()
    agrees("gimbal_center_of_mass_offset: m r at an angle", error, 1e-12, "kg m")


def mass_moment(platform: Platform) -> np.ndarray:
    """(3,) m r with the first gimbal at 0.7 rad [kg m]."""
    machine = compile_model(platform)
    model, data = machine.model, mujoco.MjData(machine.model)
    data.qpos[machine.gimbal_qpos[0]] = 0.7
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    anchor = data.xanchor[model.body_jntadr[machine.base_body]]
    mass = model.body_subtreemass[machine.base_body]
    return mass * (data.subtree_com[machine.base_body] - anchor)


def gimbal_angles(platform: Platform, text: str, rates: np.ndarray) -> np.ndarray:
    """(m, gimbals) tick by tick under rates (m, gimbals)."""
    effects = parse_effects(text) if text else ()
    plant = SimulatedPlant(with_effects(platform, effects))
    angles = []
    for k, rate in enumerate(rates):
        plant.read(k * platform.tick)
        angles.append(plant.truth()["truth_gimbal_angle"].value[0, 0])
        plant.write({"command_gimbal_rate": rate[None]})
    return np.array(angles)


WAVE = 0.3 * np.sin(0.05 * np.arange(400))[:, None] * np.ones(3)


def test_a_gimbal_with_play_turns_as_one_whose_gear_is_led_back(agrees):
    """It stands after a reversal until its gear has gone through the width of the play."""
    platform, half = load_platform("tas2"), 0.02
    gear = np.cumsum(WAVE[:, 1]) * platform.tick
    place, places = 0.0, []
    for angle in gear:
        if abs(angle - place) > half:
            place = angle - half * np.sign(angle - place)
        places.append(place)
    led = WAVE.copy()
    led[:, 1] = np.diff(places, prepend=0.0) / platform.tick
    found = gimbal_angles(platform, f"gimbal_backlash:g2={2.0 * half}", WAVE)
    error = np.abs(found - gimbal_angles(platform, "", led)).max()
    agrees("gimbal_backlash: angle of the gimbal behind its gear", error, 1e-12, "rad")
    assert np.abs(found - gimbal_angles(platform, "", WAVE)).max() > 0.5 * half


def test_a_gimbal_with_friction_turns_as_one_that_is_told_less(agrees):
    platform, less = load_platform("tas2"), WAVE.copy()
    less[:, 0] = np.where(np.abs(WAVE[:, 0]) > 0.02, WAVE[:, 0] - 0.02 * np.sign(WAVE[:, 0]), 0.0)
    found = gimbal_angles(platform, "gimbal_friction:g1=0.1", WAVE)  # 5 N m s/rad to hold it
    error = np.abs(found - gimbal_angles(platform, "", less)).max()
    agrees("gimbal_friction: angle of the gimbal", error, 1e-12, "rad")
    assert np.abs(found - gimbal_angles(platform, "", WAVE)).max() > 0.01
