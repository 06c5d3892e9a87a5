"""Four gyros with wheels of variable speed in Basilisk, beside the same on `astros`.

Needs the extra `peers`. Basilisk turns gimbals by torque, so here ours are free joints under the
same sampled servo; its hub is free and feels no gravity, so ours is balanced and weightless.
"""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.effects.motion import apart
from twin.model import compile_model
from twin.platform import Platform, load_platform

pytest.importorskip("Basilisk", reason="the extra `peers` is not installed")

SECONDS, TICK, STEP = 300.0, 0.02, 0.005
STIFFNESS = 0.7
"""Of the servos [N m s/rad]: enough to turn the gimbals nearly as told."""
RATE = np.array([0.01, -0.02, 0.03])
SPEED = np.array([100.0, 150.0, -120.0, 200.0])
GIMBAL = np.diag([0.01, 0.01, 0.01])
WHEEL = np.diag([0.01, 0.0055, 0.0055])
"""About spin axis, across, gimbal axis [kg m^2], as the MJCF has them."""
MASS, PLACE = 5.0, np.array([[0.3, 0, 0.22], [0, 0.3, 0.22], [-0.3, 0, 0.22], [0, -0.3, 0.22]])
"""Of gimbal and wheel together [kg], and where they stand [m]."""

Array = np.ndarray


def torques(time: float, gimbal_rate: Array) -> tuple[Array, Array]:
    """On gimbals and wheels [N m]."""
    wanted = 0.2 * np.sin(time * np.array([0.11, 0.17, 0.23, 0.31]) + 0.5)
    wheels = 0.02 * np.sin(time * np.array([0.37, 0.29, 0.19, 0.13]))
    return STIFFNESS * (wanted - gimbal_rate), wheels


def ours(platform: Platform) -> tuple[Array, Array]:
    """Attitude and gimbal angles at the end."""
    machine = compile_model(platform)
    model = machine.model
    model.dof_armature[machine.gimbal_dof] = 0.0
    data = mujoco.MjData(model)
    data.qpos[machine.base_qpos] = [1.0, 0.0, 0.0, 0.0]
    data.qvel[machine.base_dof] = RATE
    data.qvel[machine.wheel_dof] = SPEED
    for k in range(round(SECONDS / TICK)):
        gimbals, wheels = torques(k * TICK, data.qvel[machine.gimbal_dof])
        data.qfrc_applied[machine.gimbal_dof] = gimbals
        data.qfrc_applied[machine.wheel_dof] = wheels
        mujoco.mj_step(model, data, round(TICK / STEP))
    return data.qpos[machine.base_qpos].copy(), data.qpos[machine.gimbal_qpos].copy()


def theirs(platform: Platform) -> tuple[Array, Array]:
    """The same, all of it Basilisk's own code."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import spacecraft, svIntegrators, vscmgStateEffector
    from Basilisk.utilities import SimulationBaseClass, macros

    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("all")
    process.addTask(simulation.CreateNewTask("dynamics", macros.sec2nano(STEP)))
    hub = spacecraft.Spacecraft()
    integrator = svIntegrators.svIntegratorRK4(hub)
    hub.setIntegrator(integrator)
    effector = vscmgStateEffector.VSCMGStateEffector()
    for vscmg in _gyros(platform, messaging.VSCMGConfigMsgPayload):
        effector.AddVSCMG(vscmg)
    hub.addStateEffector(effector)
    mass, center, inertia = _hub(platform)
    hub.hub.mHub = mass
    hub.hub.r_BcB_B = center[:, None].tolist()
    hub.hub.IHubPntBc_B = inertia.tolist()
    hub.hub.omega_BN_BInit = RATE[:, None].tolist()
    message = messaging.VSCMGArrayTorqueMsg()
    effector.cmdsInMsg.subscribeTo(message)
    simulation.AddModelToTask("dynamics", effector, 2)
    simulation.AddModelToTask("dynamics", hub, 1)
    simulation.InitializeSimulation()

    def state(name: str) -> Array:
        return np.array(hub.dynManager.getStateObject(name).getState()).ravel()

    for k in range(round(SECONDS / TICK)):
        rate = state(effector.nameOfVSCMGGammaDotsState) if k else np.zeros(4)
        gimbals, wheels = torques(k * TICK, rate)
        payload = messaging.VSCMGArrayTorqueMsgPayload(
            gimbalTorque=gimbals.tolist(), wheelTorque=wheels.tolist()
        )
        message.write(payload, simulation.TotalSim.CurrentNanos)
        simulation.ConfigureStopTime(macros.sec2nano((k + 1) * TICK))
        simulation.ExecuteSimulation()
    sigma = np.array(hub.scStateOutMsg.read().sigma_BN)
    square = sigma @ sigma
    attitude = np.array([1.0 - square, *(2.0 * sigma)]) / (1.0 + square)
    return attitude, state(effector.nameOfVSCMGGammasState)


def _axes(platform: Platform) -> list[Array]:
    """Columns: spin axis, across, gimbal axis of each, at its angle 0."""
    carried = {wheel.gimbal: wheel.axis for wheel in platform.wheels}
    pairs = [(carried[gimbal.name], gimbal.axis) for gimbal in platform.gimbals]
    return [np.stack([spin, np.cross(g, spin), g], axis=1) for spin, g in pairs]


def _gyros(platform: Platform, new: Callable) -> list:
    found = []
    for axes, place, speed in zip(_axes(platform), PLACE, SPEED, strict=True):
        one = new()
        spin, across, gimbal = (axes[:, [i]].tolist() for i in range(3))
        one.rGB_B = place[:, None].tolist()
        one.gsHat0_B, one.gtHat0_B, one.ggHat_B = spin, across, gimbal
        one.w2Hat0_B, one.w3Hat0_B = across, gimbal
        one.rGcG_G = [[0.0], [0.0], [0.0]]
        one.massV, one.massG, one.massW = MASS, 0.4 * MASS, 0.6 * MASS
        one.IG1, one.IG2, one.IG3 = np.diag(GIMBAL)
        one.IW1, one.IW2, one.IW3 = np.diag(WHEEL)
        one.IV1, one.IV2, one.IV3 = np.diag(GIMBAL + WHEEL)
        one.Omega = float(speed)
        # negative: no limit, no friction
        one.u_s_max = one.u_g_max = one.Omega_max = one.gammaDot_max = -1.0
        one.gimbalLinearFrictionRatio = one.wheelLinearFrictionRatio = -1.0
        found.append(one)
    return found


def _hub(platform: Platform) -> tuple[float, Array, Array]:
    """Mass, centre and inertia about it of what is left without the gyros."""

    def spread(mass: float, at: Array) -> Array:
        return mass * (at @ at * np.eye(3) - np.outer(at, at))

    mass = platform.mass - MASS * len(PLACE)
    center = -MASS * PLACE.sum(axis=0) / mass
    inertia = platform.inertia - spread(mass, center)
    for axes, place in zip(_axes(platform), PLACE, strict=True):
        inertia = inertia - axes @ (GIMBAL + WHEEL) @ axes.T - spread(MASS, place)
    return mass, center, inertia


def test_a_machine_with_four_gyros_turns_as_in_basilisk(agrees):
    platform = replace(
        load_platform("astros"),
        center_of_mass_offset=np.zeros(3),
        gravity=0.0,
        tilt_limit=np.inf,
        step=STEP,
        sensors={},
        effects=(),
    )
    (attitude, angles), (expected, gimbals) = ours(platform), theirs(platform)
    print(f"turned by {np.degrees(apart(np.array([1.0, 0, 0, 0]), attitude)):.0f} deg in the end,")
    print(f"gimbals at {np.degrees(angles).round(0)} deg")
    error = np.degrees(apart(expected, attitude))
    agrees("four gyros of variable speed: attitude after 300 s, Basilisk", error, 2e-8, "deg")
    error = np.degrees(np.abs(angles - gimbals).max())
    agrees("four gyros of variable speed: gimbals after 300 s, Basilisk", error, 4e-8, "deg")
