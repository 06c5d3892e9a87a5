"""The simulated machine against physics written down a second time, and against what is kept."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import DOP853

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import AttitudeFilter
from twin.loop import fly
from twin.model import Machine, compile_model, mass_properties
from twin.plant.simulated import InitialState, SimulatedPlant
from twin.platform import Platform, load_platform
from twin.reference import Multisine
from twin.rotation import conjugate, multiply, rotate, to_rotation_vector
from twin.stream.recorder import MemoryRecorder

SECONDS = 300.0


def gyrostat(platform: Platform, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Euler's equations of a body with wheels under gravity, state q, w, Omega."""
    q, rate, spin = state[:4] / np.linalg.norm(state[:4]), state[4:7], state[7:]
    axes = np.stack([wheel.axis for wheel in platform.wheels])
    rotor = np.array([wheel.inertia for wheel in platform.wheels])
    gravity_body = rotate(conjugate(q), np.array([0.0, 0.0, -platform.gravity]))
    momentum = platform.inertia @ rate + (rotor * spin) @ axes
    external = np.cross(platform.center_of_mass_offset, gravity_body)
    body = platform.inertia - axes.T @ np.diag(rotor) @ axes
    acceleration = np.linalg.solve(body, external - np.cross(rate, momentum) - torque @ axes)
    turn = 0.5 * multiply(q, np.concatenate([[0.0], rate]))
    return np.concatenate([turn, acceleration, torque / rotor - axes @ acceleration])


def integrate(platform: Platform, state: np.ndarray, torques: np.ndarray) -> np.ndarray:
    """The state after holding each row of `torques` for one control period."""
    for torque in torques:
        solver = DOP853(
            lambda _, y, u=torque: gyrostat(platform, y, u),
            0.0,
            state,
            platform.tick,
            first_step=platform.tick,
            rtol=1e-12,
            atol=1e-14,
        )
        while solver.status == "running":
            solver.step()
        state = solver.y
    return state


def test_closed_loop_attitude_agrees_with_an_independent_integration_after_300_s(agrees):
    platform = load_platform("sads")
    memory = MemoryRecorder(platform)
    fly(
        SimulatedPlant(platform),
        AttitudeFilter(),
        load_controller("quaternion_pd"),
        Multisine(),
        SimulatedClock(),
        duration=SECONDS,
        observers=[memory],
    )
    recording = memory.recording()
    applied = recording["command_wheel_torque"]
    assert applied.time[-1] == pytest.approx(SECONDS)
    start = np.concatenate([[1.0], np.zeros(9)])
    end = integrate(platform, start, applied.value[:-1])

    attitude = recording["truth_attitude"].value[-1]
    error = to_rotation_vector(multiply(conjugate(end[:4] / np.linalg.norm(end[:4])), attitude))
    degrees = float(np.degrees(np.linalg.norm(error)))
    agrees("sads: attitude after 300 s of closed loop, against DOP853", degrees, 5e-8, "deg")
    np.testing.assert_allclose(recording["truth_rate"].value[-1], end[4:7], atol=1e-7)
    np.testing.assert_allclose(recording["truth_wheel_speed"].value[-1], end[7:], atol=1e-5)


def vertical_momentum(machine: Machine, truth: dict[str, np.ndarray]) -> float:
    """About the CR, along the vertical: L_CR = L_CM + M c x v of all that floats."""
    model, data = machine.model, mujoco.MjData(machine.model)
    data.qpos[machine.base_qpos] = truth["truth_attitude"]
    data.qvel[machine.base_dof] = truth["truth_rate"]
    data.qvel[machine.wheel_dof] = truth["truth_wheel_speed"]
    data.qpos[machine.stage_qpos] = truth["truth_stage_position"]
    data.qvel[machine.stage_dof] = truth["truth_stage_speed"]
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    body = machine.base_body
    arm = data.subtree_com[body] - data.xanchor[model.body_jntadr[body]]
    carried = model.body_subtreemass[body] * np.cross(arm, data.subtree_linvel[body])
    return float((data.subtree_angmom[body] + carried)[2])


def test_momentum_about_the_vertical_is_kept_while_wheels_and_masses_move(agrees):
    # the CM hangs deep enough that the swing stays clear of the tilt stop
    platform = replace(load_platform("sads"), center_of_mass_offset=np.array([1e-4, -1e-4, -5e-3]))
    initial = InitialState(
        rate_body=np.array([0.01, -0.01, 0.03]), wheel_speed=np.array([2.0, -2.0, 15.0])
    )
    plant = SimulatedPlant(platform, initial=initial)
    plant.read(0.0)
    rotor = np.array([wheel.inertia for wheel in platform.wheels])
    start, largest, drift, moved = math.nan, 0.0, 0.0, 0.0
    for k in range(round(SECONDS / platform.tick)):
        time = k * platform.tick
        plant.read(time)
        truth = {name: samples.value[0, 0] for name, samples in plant.truth().items()}
        if k % 20 == 0:
            momentum = vertical_momentum(plant.machine, truth)
            start = momentum if k == 0 else start
            drift = max(drift, abs(momentum - start))
        carried = np.abs(truth["truth_wheel_speed"] * rotor).max()
        turning = np.linalg.norm(truth["truth_rate"] @ platform.inertia)
        largest = max(largest, float(carried), float(turning))
        moved = max(moved, float(np.abs(truth["truth_stage_position"]).max()))
        swing = time * np.array([[0.5, 0.4, 0.3]])
        plant.write(
            {
                "command_wheel_torque": np.array([[0.005, 0.005, 0.05]]) * np.sin(swing),
                "command_stage_position": 5e-4 * np.sin(swing),
            }
        )
    share = drift / largest
    agrees("sads: momentum about the vertical over 300 s", share, 4e-11, "of the largest momentum")
    assert moved > 4e-4, "the masses must have moved for this to say anything"


def test_compiled_machine_has_the_stated_mass_properties_in_every_variant():
    for name in ("sads", "sads:table1", "sads:table3"):
        platform = load_platform(name)
        machine = compile_model(platform)
        found = mass_properties(machine.model, machine.base_body)
        assert found.mass == pytest.approx(platform.mass, rel=1e-12)
        np.testing.assert_allclose(found.inertia, platform.inertia, atol=1e-12 * 12)
        np.testing.assert_allclose(
            found.center_of_mass_offset, platform.center_of_mass_offset, atol=1e-14
        )
