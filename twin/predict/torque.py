"""The torque that moves the base beyond what the model and the commands account for."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.predict.rollout import Predictor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unexplained:
    """Of a log, on the grid of its smoothed motion."""

    time: Array
    """(m,) [s]."""
    rate: Array
    """(m, k) [rad/s], body axes."""
    torque: Array
    """(m, k) [N m], body axes."""


def unexplained_torque(predictor: Predictor, model: mujoco.MjModel) -> Unexplained:
    """Inverse dynamics of the smoothed motion less the commanded torque.

    For the eye only: it rests on a second derivative of the data, smoothed as the motion is, while
    every number of a report comes from predicted trajectories.
    """
    machine, motion = predictor.machine, predictor.motion
    period = float(motion.time[1] - motion.time[0])
    edges = np.append(motion.time - 0.5 * period, motion.time[-1] + 0.5 * period)
    torque = np.empty_like(motion.rate)
    data = mujoco.MjData(model)
    states = predictor.inputs.joint_states(motion.time)
    for i, (position, velocity, acceleration) in enumerate(zip(*states, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = position, velocity, acceleration
        data.qpos[machine.base_qpos] = motion.position[i]
        data.qvel[machine.base_dof] = motion.rate[i]
        data.qacc[machine.base_dof] = motion.acceleration[i]
        mujoco.mj_inverse(model, data)
        torque[i] = data.qfrc_inverse[machine.base_dof]
    applied = predictor.inputs.torque_on_joint(edges)
    return Unexplained(motion.time, motion.rate, torque - motion.smooth(applied))
