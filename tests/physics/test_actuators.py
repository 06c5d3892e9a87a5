"""What each kind of actuator gives to a machine, and what it cannot."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.special import ellipj, ellipk

from tests.physics.motion import rigid, run
from twin.model import compile_model
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.rotation import from_rotation_vector, rotate


def afloat(name: str) -> Platform:
    """A machine whose CM lies in the CR, and which nothing stops or weighs down."""
    return replace(
        load_platform(name),
        center_of_mass_offset=np.zeros(3),
        gravity=0.0,
        tilt_limit=np.inf,
        pitch_stop=None,
        sensors={},
        effects=(),
    )


def momentum(plant: SimulatedPlant) -> np.ndarray:
    """(3,) of all that floats, about the CR, room axes: L_CM + M c x v [N m s]."""
    machine = plant.machine
    model, data, body = machine.model, mujoco.MjData(machine.model), machine.base_body
    (data.qpos[:],), (data.qvel[:],) = plant.state
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    arm = data.subtree_com[body] - data.xanchor[model.body_jntadr[body]]
    carried = model.body_subtreemass[body] * np.cross(arm, data.subtree_linvel[body])
    return data.subtree_angmom[body] + carried


def waves(name: str, platform: Platform, time: float) -> np.ndarray:
    """(1, k) a tenth of what each part can do, each at a pace of its own."""
    size = {
        "command_wheel_torque": [0.1 * wheel.torque_limit for wheel in platform.wheels],
        "command_stage_position": [0.1 * stage.travel[1] for stage in platform.stages],
        "command_gimbal_rate": [0.1 * gimbal.rate for gimbal in platform.gimbals],
        "command_dipole": [0.1, 0.1, 0.1],
    }[name]
    return np.array([size]) * np.sin(time * (0.5 - 0.1 * np.arange(len(size))) + 0.3)


WITHIN = {
    "wheels of whorl1": ("whorl1", "command_wheel_torque", 1e-11),
    "stages of sads": ("sads", "command_stage_position", 1e-11),
    "gimbals of tas2, rotors at constant speed": ("tas2", "command_gimbal_rate", 1e-11),
    "gimbals of astros, wheels left alone": ("astros", "command_gimbal_rate", 1e-11),
    "wheels of astros on their gimbals": ("astros", "command_wheel_torque", 1e-11),
}


@pytest.mark.parametrize("what", WITHIN)
def test_what_acts_within_a_machine_leaves_its_momentum_alone(what, agrees):
    """All three parts of it, in the room, while nothing from outside acts."""
    name, command, tolerance = WITHIN[what]
    platform = replace(afloat(name), step=0.005)
    rate = np.array([0.01, -0.02, 0.03])
    plant = SimulatedPlant(platform, initial=InitialState(rate_body=rate))
    plant.read(0.0)
    first, largest, drift = momentum(plant), 0.0, 0.0
    for k in range(round(60.0 / platform.tick)):
        now = k * platform.tick
        plant.write({command: waves(command, platform, now)})
        plant.read(now + platform.tick)
        if k % 10 == 0:
            present = momentum(plant)
            drift = max(drift, float(np.linalg.norm(present - first)))
            largest = max(largest, float(np.linalg.norm(present)))
    parts = [rotor.momentum for rotor in platform.rotors]
    parts += [wheel.inertia * wheel.home for wheel in platform.wheels]
    largest = max(largest, *np.abs(parts)) if parts else largest
    agrees(f"momentum over 60 s: {what}", drift / largest, tolerance, "of the largest momentum")


@pytest.mark.parametrize("name", ["sads", "whorl1", "whorl2"])
def test_wheels_that_start_a_resting_body_take_what_they_give(name, agrees):
    """J w + sum a_i I_i W_i stays 0 in body axes, whatever the torques."""
    platform = afloat(name)
    _, true = run(
        platform,
        InitialState(wheel_speed=0.0),
        30.0,
        lambda now: {"command_wheel_torque": waves("command_wheel_torque", platform, now)},
    )
    axes = np.stack([wheel.inertia * wheel.axis for wheel in platform.wheels])
    body, wheels = true["rate"] @ platform.inertia, true["wheel_speed"] @ axes
    error = np.abs(body + wheels).max() / np.abs(wheels).max()
    agrees(f"{name}: exchange of momentum between body and wheels", error, 1e-11)


def test_coils_turn_nothing_about_the_field(agrees):
    platform = replace(afloat("cubesat"), magnetic_field=np.array([2e-5, -1e-5, 4e-5]))
    field = platform.magnetic_field / np.linalg.norm(platform.magnetic_field)
    plant = SimulatedPlant(platform, initial=InitialState(rate_body=np.array([0.01, 0.02, 0.05])))
    plant.read(0.0)
    first, last, drift, given = momentum(plant), np.zeros(3), 0.0, 0.0
    for k in range(round(60.0 / platform.tick)):
        now = k * platform.tick
        plant.write({"command_dipole": waves("command_dipole", platform, now)})
        plant.read(now + platform.tick)
        last = momentum(plant)
        drift = max(drift, abs(float((last - first) @ field)))
        given = max(given, float(np.linalg.norm(last - first)))
    agrees("coils of cubesat: momentum about the field over 60 s", drift / given, 1e-11)


def test_a_coil_in_a_field_swings_as_a_compass_needle(agrees):
    """J t'' = -m B sin(t): a pendulum, whatever its amplitude."""
    inertia, moment, field, amplitude = 0.035, 0.5, 4e-4, 2.0
    platform = replace(
        rigid(np.diag([0.02, 0.022, inertia])), magnetic_field=np.array([field, 0.0, 0.0])
    )
    start = from_rotation_vector(np.array([0.0, 0.0, amplitude]))
    dipole = {"command_dipole": np.array([[moment, 0.0, 0.0]])}
    time, true = run(platform, InitialState(attitude=start), 300.0, lambda _: dipole)
    pace, modulus = np.sqrt(moment * field / inertia), np.sin(0.5 * amplitude) ** 2
    sn = ellipj(ellipk(modulus) - pace * time, modulus)[0]
    expected = 2.0 * np.arcsin(np.sqrt(modulus) * sn)
    pointing = rotate(true["attitude"], np.array([1.0, 0.0, 0.0]))
    error = np.abs(np.arctan2(pointing[:, 1], pointing[:, 0]) - expected).max()
    agrees("coil in a field: swing of 2 rad over 300 s, by elliptic functions", error, 1e-11, "rad")


@pytest.mark.parametrize("name", ["whorl1", "astros"])
def test_thrusters_that_push_about_the_vertical_spin_the_body_evenly(name, agrees):
    """Its wheels are held by nothing: those along the axis do not follow."""
    platform = afloat(name)
    inertia = np.diag(np.diag(platform.inertia))
    platform = replace(platform, inertia=inertia, gas=None)
    arms = np.array([np.cross(one.point, one.direction) for one in platform.thrusters])
    force, left = nnls(arms.T, np.array([0.0, 0.0, 0.02]))
    assert left < 1e-12
    still = InitialState(wheel_speed=0.0)
    told = {"command_thruster": force[None]}
    time, true = run(platform, still, 30.0, lambda _: told)
    heavy = inertia[2, 2] - sum(w.inertia * w.axis[2] ** 2 for w in platform.wheels)
    expected = 0.02 / heavy * time
    error = np.abs(true["rate"][:, 2] - expected).max() / expected[-1]
    agrees(f"thrusters of {name}: even spin-up", error, 1e-11)


def test_thrusters_push_a_floating_machine_evenly_across_the_floor(agrees):
    platform = replace(afloat("astros:mode_c"), gas=None)
    arms = np.array([np.cross(one.point, one.direction) for one in platform.thrusters])
    directions = np.array([one.direction for one in platform.thrusters])
    wanted = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    force, left = nnls(np.hstack([directions, arms]).T, wanted)
    assert left < 1e-12
    told = {"command_thruster": force[None]}
    time, true = run(platform, InitialState(wheel_speed=0.0), 20.0, lambda _: told)
    machine = compile_model(platform)
    expected = 0.3 / machine.model.body_subtreemass[0] * time
    error = np.abs(true["velocity"][:, 0] - expected).max() / expected[-1]
    agrees("thrusters of astros:mode_c: even push across the floor", error, 1e-11)
