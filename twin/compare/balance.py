"""Two balances of the measured motion: angular momentum about the vertical, and energy.

No gravity torque acts about the vertical and no exchange inside changes the momentum there, so a
drift of it is an external torque. Energy less the work of the motors falls where something brakes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from twin import rotation
from twin.compare.account import Account
from twin.predict.parameters.base import ENTRIES, hinge_axis

Array = NDArray[np.float64]

MOVED = 1e-3
"""Sliding masses that move further [m] make the energy's balance more than this."""


@dataclass(frozen=True)
class Balance:
    """Of one log, on the grid of its smoothed motion."""

    time: Array
    """(m,) [s]."""
    momentum: Array | None
    """(m,) about the vertical, body and wheels [N m s]; None for a hinge."""
    energy: Array | None
    """(m,) less the work of the motors [J]; None where sliding masses moved."""


def balance(account: Account) -> Balance:
    """Balance a log's measured motion with the base and the biases of an account."""
    body, base = account.problem.bodies[0], account.problem.base
    machine, motion = body.machine, body.motion
    platform, time = machine.platform, motion.time
    entries = base.entries(account.theta)
    inertia = np.zeros((3, 3))
    for value, (i, j) in zip(entries[:6], ENTRIES, strict=True):
        inertia[i, j] = inertia[j, i] = value
    hinge = platform.base.kind == "hinge"
    axis = hinge_axis(machine) if hinge else np.zeros(3)
    attitude = rotation.from_rotation_vector(motion.position * axis) if hinge else motion.position
    bias = np.zeros(3)
    sensors = account.at.biases[0][: len(body.bias_names)]
    for name, value in zip(body.bias_names, sensors, strict=True):
        if name.startswith("gyro "):
            bias["xyz".index(name[-1])] = value
    rate = motion.rate * axis if hinge else motion.rate - bias
    vertical = rotation.vertical_body(attitude)
    position, velocity, _ = body.inputs.joint_states(time)
    stage = position[:, machine.stage_qpos]
    still = not stage.size or float(np.ptp(stage, axis=0).max()) < MOVED
    spin = velocity[:, machine.wheel_dof]
    rotor = np.array([wheel.inertia for wheel in platform.wheels])
    axes = np.array([wheel.axis for wheel in platform.wheels]).reshape(-1, 3)
    momentum = rate @ inertia + (spin * rotor) @ axes
    edges = np.append(time, 2.0 * time[-1] - time[-2])
    torque = body.inputs.commanded(edges, motion)
    power = np.sum(torque[:, machine.wheel_dof] * spin, axis=1)
    if hinge:
        power = power + (torque[:, machine.base_dof] * motion.rate)[:, 0]
    work = np.asarray(cumulative_trapezoid(power, time, initial=0.0), dtype=np.float64)
    kinetic = 0.5 * np.sum(rate * (rate @ inertia), axis=1)
    kinetic = kinetic + np.sum(spin * rotor * (rate @ axes.T), axis=1)
    kinetic = kinetic + 0.5 * np.square(spin) @ rotor
    height = platform.gravity * vertical @ entries[6:]
    driven = bool(np.any(torque)) or not platform.wheels
    about = None if hinge else np.sum(vertical * momentum, axis=1)
    return Balance(time, about, kinetic + height - work if still and driven else None)
