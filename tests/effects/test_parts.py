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


def test_a_coil_of_another_gain_turns_the_table_as_another_command():
    table = load_platform("cubesat")
    told = np.array([[0.3, -0.2, 0.1]])
    askew = rates_after(table, "magnetorquer_gain=0.1/-0.2/0.3", "command_dipole", told)
    plain = rates_after(table, "", "command_dipole", told * [1.1, 0.8, 1.3])
    np.testing.assert_allclose(askew, plain, rtol=1e-12)
    unaware = rates_after(table, "", "command_dipole", told)
    assert np.abs(askew - unaware).max() > 0.05 * np.abs(plain).max()


@pytest.mark.parametrize("name", ["whorl1", "astros:mode_c"])
def test_an_askew_thruster_gives_the_torque_of_its_turned_force(name):
    machine = replace(load_platform(name), center_of_mass_offset=np.zeros(3))
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
    np.testing.assert_allclose(askew[0], forces[0, 0] * turned @ answer, atol=1e-4 * size)
    np.testing.assert_allclose(askew[1:], plain[1:], atol=1e-12 * size)
    assert np.abs(askew[0] - plain[0]).max() > 0.01 * size


def test_an_unbalanced_gimbal_weighs_where_its_angle_turns_it():
    platform = load_platform("tas2")
    (effect,) = parse_effects("gimbal_center_of_mass_offset:g1=0.02/-0.01")
    gimbal, rotor = platform.gimbals[0], platform.rotors[0]
    moment = 0.02 * rotor.axis - 0.01 * np.cross(gimbal.axis, rotor.axis)
    turned = rotate(from_rotation_vector(0.7 * gimbal.axis), moment)
    change = mass_moment(with_effects(platform, (effect,))) - mass_moment(platform)
    np.testing.assert_allclose(change, turned - moment, atol=1e-12)


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
