"""Where the stop touches, and what the default step costs in accuracy."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.check.finding import Finding, judge
from twin.model import Machine, compile_model
from twin.platform import Platform

Array = NDArray[np.float64]

TILT_TOLERANCE = np.deg2rad(0.1)
"""Directions may differ by that much [rad]: a ring made of segments is no circle."""
STEP_TIME = 60.0
"""[s]."""
STEP_ERROR = np.deg2rad(1e-4)
"""Largest attitude error that the default step may add in STEP_TIME [rad]."""
_DIRECTIONS = 12


def check_stop(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """Lean the machine in twelve directions, each at another yaw, until something touches."""
    if platform.base.kind != "ball":
        return []
    angles = [_first_contact(platform, model, number) for number in range(_DIRECTIONS)]
    low, high, stated = min(angles), max(angles), platform.stop_angle
    if np.isinf(stated):
        return [
            judge(
                "no tilt stop",
                bool(np.isinf(low)),
                "none",
                "none" if np.isinf(low) else f"touches at {np.rad2deg(low):.3g} deg",
                "",
                "the MJCF has a tilt stop; add [tilt_stop] angle to platform.toml",
            )
        ]
    kind = "tilt" if platform.pitch_stop is None else "pitch"
    degrees = np.rad2deg([low, high, stated])
    meets = (
        f"touches between {degrees[0]:.4g} and {degrees[1]:.4g} deg of {kind}"
        if np.isfinite(high)
        else "tilts in some direction until it is upside down, and nothing touches"
        if kind == "tilt"
        else "lets its axis stand upright, and nothing touches"
    )
    return [
        judge(
            f"{kind} stop, any direction",
            max(stated - low, high - stated) <= TILT_TOLERANCE,
            [stated, stated],
            [low, high],
            "rad",
            f"the MJCF {meets}, platform.toml says {degrees[2]:.4g} deg; mend the contact pair or "
            f"{kind}_stop.angle",
        )
    ]


def _first_contact(platform: Platform, model: mujoco.MjModel, number: int) -> float:
    """Smallest lean [rad] in a numbered direction at which anything touches; inf without one.

    With a pitch stop the axis goes up or down, each time at another roll.
    """
    azimuth = number * (2.0 * np.pi / _DIRECTIONS)
    data = mujoco.MjData(model)
    start = int(model.jnt_qposadr[model.joint(platform.base.joint).id])
    turned = rotation.from_rotation_vector(np.array([0.0, 0.0, 2.4 * azimuth]))
    across, furthest = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]), np.pi
    if platform.pitch_stop is not None:
        axis, furthest = platform.pitch_stop.axis, 0.5 * np.pi
        across = (-1.0) ** number * np.cross([0.0, 0.0, 1.0], rotation.rotate(turned, axis))
        turned = rotation.multiply(turned, rotation.from_rotation_vector(azimuth * axis))

    def touches(angle: float) -> bool:
        lean = rotation.from_rotation_vector(angle * across)
        data.qpos[start : start + 4] = rotation.multiply(lean, turned)
        mujoco.mj_fwdPosition(model, data)
        return bool(np.any(data.contact.dist[: data.ncon] <= 0.0))

    coarse = np.linspace(0.0, furthest, 181)
    hit = next((i for i, angle in enumerate(coarse) if touches(float(angle))), None)
    if hit is None:
        return np.inf
    if hit == 0:
        return 0.0
    free, touching = float(coarse[hit - 1]), float(coarse[hit])
    for _ in range(40):
        middle = 0.5 * (free + touching)
        free, touching = (free, middle) if touches(middle) else (middle, touching)
    return touching


def check_step(platform: Platform) -> list[Finding]:
    """Run at the default step and at half of it; the difference is the default step's error."""
    machine = compile_model(platform)
    machine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    whole, half = _fly(machine, 1), _fly(machine, 2)
    if platform.base.kind != "hinge":
        angle = rotation.to_rotation_vector(
            rotation.multiply(rotation.conjugate(half[0]), whole[0])
        )
    else:
        angle = whole[0] - half[0]
    attitude, rate = float(np.linalg.norm(angle)), float(np.max(np.abs(whole[1] - half[1])))
    span = f"{platform.step:g} s steps"
    return [
        judge(
            f"{platform.name}: attitude error of {span}",
            attitude <= STEP_ERROR,
            STEP_ERROR,
            attitude,
            "rad",
            f"halving the step changes the attitude by {np.rad2deg(attitude):.3g} deg in "
            f"{STEP_TIME:g} s; choose a smaller simulation.step",
        ),
        Finding(f"{platform.name}: rate error of {span}", True, None, rate, "rad/s"),
    ]


def _fly(machine: Machine, halvings: int) -> tuple[Array, Array]:
    """Base position and rate after STEP_TIME from a tilted, turning start, wheels half spun up.

    The wheels' torques are sines held over a control tick, gimbals turn slowly; contacts are off.
    """
    platform, model = machine.platform, machine.model
    model.opt.timestep = platform.step / halvings
    data = mujoco.MjData(model)
    momentum = np.array([wheel.momentum_limit for wheel in platform.wheels])
    limit = np.array([wheel.torque_limit for wheel in platform.wheels])
    speed = np.array([wheel.speed_limit for wheel in platform.wheels])
    frequency = 0.5 + 0.4 * np.arange(len(limit))  # [rad/s]
    amplitude = np.minimum(0.2 * limit, 0.1 * momentum * frequency)
    if platform.base.kind != "hinge":
        data.qpos[machine.base_qpos] = rotation.from_rotation_vector(np.array([0.1, 0.05, 0.0]))
        data.qvel[machine.base_dof] = (0.1, -0.05, 0.08)
    else:
        data.qpos[machine.base_qpos] = 1.0
    data.qvel[machine.wheel_dof] = 0.5 * speed
    data.qvel[machine.rotor_dof] = [rotor.speed for rotor in platform.rotors]
    data.qpos[machine.gimbal_qpos] = [gimbal.home for gimbal in platform.gimbals]
    data.qvel[machine.gimbal_dof] = [min(0.1, gimbal.rate) for gimbal in platform.gimbals]
    for tick in range(round(STEP_TIME / platform.tick)):
        data.ctrl[machine.wheel_actuator] = amplitude * np.sin(frequency * tick * platform.tick)
        mujoco.mj_step(model, data, platform.steps_per_tick * halvings)
    return data.qpos[machine.base_qpos].copy(), data.qvel[machine.base_dof].copy()
