"""A log as the balance of angular momentum needs it: motion, and what parts hold, on one grid.

About the centre of rotation, in body axes, with H = J w + c:

    dH/dt + w x H = (m r + d) x g + T

c and d are what wheels, rotors, gimbals and sliding masses add to J w and to m r, known from the
machine as stated; g is gravity in body axes, T what was commanded to act from outside.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.errors import UsageError
from twin.model import Machine
from twin.noise.stream import angles
from twin.predict.base import hinge_axis
from twin.predict.inputs import Inputs
from twin.predict.logs import Motion
from twin.recording import Recording, Series
from twin.stop import check

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """Of one log; body axes."""

    time: Array
    """(m,) uniform [s]."""
    attitude: Array
    """(m, 4)."""
    rate: Array
    """(m, 3) [rad/s]."""
    carried: Array
    """(m, 3) c [N m s]."""
    moved: Array
    """(m, 3) d [kg m]."""
    torque: Array
    """(m, 3) T [N m]."""
    gravity: Array
    """(m, 3) [m/s^2]."""
    axis: Array | None
    """(3,) of a hinge, about which alone the balance holds; None on a ball."""

    @property
    def step(self) -> float:
        """[s]."""
        return float(self.time[1] - self.time[0])

    def every(self, stride: int) -> "Track":
        """Instants per block."""
        parts = (self.time, self.attitude, self.rate, self.carried, self.moved, self.torque)
        return Track(*(part[::stride] for part in (*parts, self.gravity)), axis=self.axis)


def track_of(machine: Machine, recording: Recording, motion: Motion, *, raw: bool = False) -> Track:
    """Along a motion.

    Args:
        machine: as stated.
        recording: the log.
        motion: of its base.
        raw: take wheel speeds as they were read, not smoothed.

    Raises:
        Stopped: a stop was requested.
    """
    check()
    inputs = Inputs(machine, recording)
    time, axis = motion.time, None
    position, velocity, _ = inputs.joint_states(time)
    if raw and "wheel_speed" in recording:
        velocity[:, machine.wheel_dof] = recording["wheel_speed"].interpolated_at(time)
    attitude, rate = motion.position, motion.rate
    velocity[:, machine.base_dof] = rate
    position[:, machine.base_qpos] = attitude
    whole, moment, passive = _as_stated(machine, position, velocity)
    torque = inputs.commanded(np.append(time, 2.0 * time[-1] - time[-2]), motion)
    torque = torque[:, machine.base_dof] + passive
    stated = machine.platform.inertia
    if machine.platform.base.kind == "hinge":
        axis = hinge_axis(machine)
        attitude, rate = rotation.from_rotation_vector(attitude * axis), rate * axis
        carried, torque = whole * axis - (axis @ stated @ axis) * rate, torque * axis
    else:
        carried = whole - rate @ stated
    down = np.broadcast_to([0.0, 0.0, -machine.platform.gravity], rate.shape)
    return Track(
        time,
        attitude,
        rate,
        carried,
        moment - machine.platform.center_of_mass_offset,
        torque,
        rotation.rotate(rotation.conjugate(attitude), down),
        axis,
    )


def raw_motion(recording: Recording, kind: str) -> Motion:
    """Rates and positions as they were read, on the gyro's own grid: nothing is smoothed.

    The gyro's bias, as the attitude has it, is taken out, as a lab does before a run.

    Args:
        recording: the log.
        kind: of its base, `ball` or `hinge`.

    Raises:
        UsageError: the log lacks one of the two.
    """
    names = ("joint_rate", "joint_angle") if kind == "hinge" else ("gyro", "attitude")
    for name in names:
        if name not in recording or len(recording[name]) < 2:
            raise UsageError(
                f"the log has no {name!r}: the method has no equation without both {names[0]!r} "
                f"and {names[1]!r}, of which prediction-error needs one"
            )
    gyro, shown = (recording[name] for name in names)
    begin, end = max(gyro.time[0], shown.time[0]), min(gyro.time[-1], shown.time[-1])
    period = float(np.median(np.diff(gyro.time)))
    time = np.arange(begin, end + 1e-9, period)
    rate = gyro.interpolated_at(time)
    if kind == "hinge":
        position = shown.interpolated_at(time)
    else:
        position = rotation.normalized(_continuous(shown).interpolated_at(time))
        rate = rate - gyro_bias(recording)
    return Motion(time, position, rate, np.gradient(rate, period, axis=0), 1)


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


def _continuous(attitude: Series) -> Series:
    """Without the changes of sign that mean nothing."""
    value = attitude.value
    turned = np.sum(value[1:] * value[:-1], axis=1) < 0.0
    sign = np.cumprod(np.concatenate([[1.0], np.where(turned, -1.0, 1.0)]))
    return Series(attitude.time, value * sign[:, None], attitude.columns, attitude.unit)


def _as_stated(machine: Machine, position: Array, velocity: Array) -> tuple[Array, Array, Array]:
    """Of the machine as stated, its joints at (m, nq) and (m, nv): angular momentum about the CR
    (m, k), m r (m, 3), body axes, and the torque (m, k) of the base joint's springs and dampers."""
    model, data = machine.model, mujoco.MjData(machine.model)
    base, dof = machine.base_body, machine.base_dof
    whole, moment = np.empty((len(position), dof.stop - dof.start)), np.empty((len(position), 3))
    product, passive = np.empty(model.nv), np.empty_like(whole)
    for row in range(len(position)):
        data.qpos[:], data.qvel[:] = position[row], velocity[row]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_passive(model, data)
        passive[row] = data.qfrc_passive[dof]
        data.qpos[machine.base_qpos] = model.qpos0[machine.base_qpos]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_mulM(model, data, product, velocity[row])
        whole[row] = product[dof]
        arm = data.subtree_com[base] - data.xanchor[model.body_jntadr[base]]
        moment[row] = model.body_subtreemass[base] * arm
    return whole, moment, passive
