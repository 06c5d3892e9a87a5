"""J and m r from the balance of angular momentum, by linear least squares.

About the centre of rotation, in world axes, with R = R(q):

    R (J w + sum a_i I_i Omega_i) - integral R (m r x g_body) dt - integral T_applied dt = constant

It is linear in J and m r, and nothing is differentiated. Motion and wheel speeds are smoothed
first; the noise that is left in w makes J a little small, so this is where a fit starts, and a
cross-check of it. It is the momentum integral of J. L. Schwartz and C. D. Hall (AAS 04-122), with
the constant as three more unknowns in place of differences between neighbours.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.stats import t as student

from twin import rotation
from twin.errors import UsageError
from twin.model import Machine
from twin.noise.stream import angles
from twin.predict.base import ENTRIES, BaseParameters, hinge_axis
from twin.predict.drive import Inputs
from twin.predict.motion import Motion
from twin.recording import Recording

Array = NDArray[np.float64]

INTERVAL = 0.25
"""Between the instants at which the balance is taken [s]."""
BLOCK = 10.0
"""What is left is taken for independent between blocks of this length [s]."""


@dataclass(frozen=True)
class MomentumFit:
    """The least-squares solution."""

    theta: Array
    """(p,) base parameters."""
    covariance: Array
    """(p, p), from the scatter of the blocks' own gradients."""
    quantile: float
    """Half a 95 % interval is this many standard deviations."""
    normal: Array
    """(p, p) of unit-variance equations, for the excitation."""


@dataclass(frozen=True)
class _Balance:
    """target = columns theta, up to a constant, block by block."""

    target: Array
    columns: Array
    block: NDArray[np.intp]
    per_instant: int


def momentum_fit(logs: list[tuple[Recording, Motion]], base: BaseParameters) -> MomentumFit:
    """Fit logs together.

    Args:
        logs: each with its smoothed motion.
        base: the parameters sought.

    Raises:
        UsageError: nothing that could be sought shows in the logs, be they too short or still.
    """
    balances = [_balance(recording, motion, base) for recording, motion in logs]
    columns = np.concatenate([b.columns for b in balances])
    target = np.concatenate([b.target for b in balances])
    counts = np.cumsum([0] + [b.block[-1] + 1 for b in balances])
    block = np.concatenate([b.block + n for b, n in zip(balances, counts, strict=False)])
    if not np.any(columns):
        raise UsageError(
            f"the logs are too short to tell anything of the motion of {base.machine.platform.name}"
            ", or nothing moves in them; record some ten seconds of motion"
        )
    # held weakly where they were stated, so that what does not show stays there
    weak = np.diag(1e-6 * np.linalg.norm(columns * base.scale, axis=0).max() / base.scale)
    stacked = np.concatenate([columns, weak])
    right = np.concatenate([target - columns @ base.as_stated, np.zeros(len(weak))])
    change = np.linalg.lstsq(stacked * base.scale, right, rcond=None)[0] * base.scale
    left = right[: len(target)] - columns @ change
    scaled = stacked * base.scale
    inverse = np.linalg.inv(scaled.T @ scaled) * np.outer(base.scale, base.scale)
    scores = np.zeros((counts[-1], len(change)))
    np.add.at(scores, block, columns * left[:, None])
    unknowns = len(change) + sum(b.per_instant for b in balances)
    freedom = max(len(scores) - unknowns, 1)
    covariance = inverse @ (scores.T @ scores) @ inverse * len(scores) / freedom
    variance = float(left @ left) / max(len(left) - unknowns, 1)
    return MomentumFit(
        base.as_stated + change,
        covariance,
        float(student.ppf(0.975, freedom)),
        columns.T @ columns / max(variance, 1e-300),
    )


def gyro_bias(recording: Recording) -> Array:
    """(3,) mean of the gyro less that of the rate by which the attitude turns [rad/s]; 0 without
    both."""
    if "gyro" not in recording or "attitude" not in recording:
        return np.zeros(3)
    gyro, attitude = recording["gyro"], recording["attitude"]
    turned = angles(attitude.value)[-1]
    first, last = attitude.time[0], attitude.time[-1]
    inside = (gyro.time >= first) & (gyro.time <= last)
    if inside.sum() < 2:
        return np.zeros(3)
    time = gyro.time[inside]
    mean = np.trapezoid(gyro.value[inside], time, axis=0) / (time[-1] - time[0])
    return mean - turned / (last - first)


def _balance(recording: Recording, motion: Motion, base: BaseParameters) -> _Balance:
    machine = base.machine
    platform = machine.platform
    inputs = Inputs(machine, recording)
    stride = max(round(INTERVAL / float(np.median(np.diff(motion.time)))), 1)
    time = motion.time
    hinge = platform.base.kind == "hinge"
    axis = hinge_axis(machine) if hinge else np.zeros(3)
    if hinge:
        attitude = rotation.from_rotation_vector(motion.position * axis)
        rate = motion.rate * axis
    else:
        attitude, rate = motion.position, motion.rate - gyro_bias(recording)
    turn = rotation.matrix(attitude)
    joints_position, joints_velocity, _ = inputs.joint_states(time)
    joints_velocity[:, machine.base_dof] = motion.rate if hinge else rate
    whole, moment = _as_stated(machine, joints_position, joints_velocity)
    edges = np.append(time, 2.0 * time[-1] - time[-2])
    applied = inputs.commanded(edges, motion)[:, machine.base_dof]
    if hinge:
        whole, applied = whole * axis, applied * axis
        momentum = whole - (axis @ platform.inertia @ axis) * rate
    else:
        momentum, applied = whole - rate @ platform.inertia, rotation.rotate(attitude, applied)
    # what wheels and gimbals hold, and what they and sliding masses change of J and m r
    carried = moment - platform.center_of_mass_offset
    gravity = np.array([0.0, 0.0, -platform.gravity])
    push = rotation.cross(rotation.rotate(attitude, carried), gravity) + applied
    target = _integral(push, time) - rotation.rotate(attitude, momentum)
    entries = np.stack(
        [
            *(turn @ (rate @ _unit(i, j))[:, :, None] for i, j in ENTRIES),
            *(
                -_integral(rotation.cross(turn[:, :, i], gravity), time)[:, :, None]
                for i in range(3)
            ),
        ],
        axis=-1,
    )[:, :, 0, :]
    if hinge:
        target, entries = (target @ axis)[:, None], np.einsum("mie,i->me", entries, axis)[:, None]
    target, entries = target[::stride], entries[::stride]
    # the constants, one a component, are taken out by the mean
    target = target - target.mean(axis=0)
    entries = entries - entries.mean(axis=0)
    # entries = stated + map (theta - as_stated)
    rest = base.entries(base.as_stated) - base.map @ base.as_stated
    block = ((time[::stride] - time[0]) / BLOCK).astype(np.intp)
    k = target.shape[1]
    return _Balance(
        (target - entries @ rest).ravel(),
        (entries @ base.map).reshape(-1, base.map.shape[1]),
        np.repeat(block, k),
        k,
    )


def _integral(values: Array, time: Array) -> Array:
    return np.asarray(cumulative_trapezoid(values, time, axis=0, initial=0.0), dtype=np.float64)


def _as_stated(machine: Machine, position: Array, velocity: Array) -> tuple[Array, Array]:
    """Of the machine as stated, its joints at (m, nq) and (m, nv): angular momentum about the CR
    (m, k) and m r (m, 3), body axes."""
    model, data = machine.model, mujoco.MjData(machine.model)
    base, dof = machine.base_body, machine.base_dof
    whole, moment = np.empty((len(position), dof.stop - dof.start)), np.empty((len(position), 3))
    product = np.empty(model.nv)
    for row in range(len(position)):
        data.qpos[:] = position[row]
        data.qpos[machine.base_qpos] = model.qpos0[machine.base_qpos]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_mulM(model, data, product, velocity[row])
        whole[row] = product[dof]
        arm = data.subtree_com[base] - data.xanchor[model.body_jntadr[base]]
        moment[row] = model.body_subtreemass[base] * arm
    return whole, moment


def _unit(i: int, j: int) -> Array:
    """The symmetric matrix with 1 at (i, j) and (j, i)."""
    unit = np.zeros((3, 3))
    unit[i, j] = unit[j, i] = 1.0
    return unit
