"""How a machine's state answers an impulse on each joint, wherever its gimbals stand.

A joint that is prescribed takes no impulse. For a gimbal its column is that of a turn by one
radian: what is free keeps its momentum p = M v, so its velocity changes by -M^-1 (dp / d angle).
That is the torque of a gyro, h g x a, and where a motion is uncertain it is what counts.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.drives import PRESCRIBED_ARMATURE
from twin.model import Machine

Array = NDArray[np.float64]

TURN = 1e-4
"""Of the central difference [rad]."""


class Response:
    """Of a machine at given states of all its joints, (S, K, .)."""

    def __init__(self, machine: Machine, position: Array, velocity: Array, wheels: bool) -> None:
        """Measure M there.

        Args:
            machine: as stated.
            position: (S, K, nq).
            velocity: (S, K, nv).
            wheels: whether the wheels' speeds are states.
        """
        model = machine.model
        self._machine = machine
        self._wheels = machine.wheel_dof if wheels else machine.wheel_dof[:0]
        self._free = np.flatnonzero(model.dof_armature < 1e-3 * PRESCRIBED_ARMATURE)
        f, g = len(self._free), len(machine.gimbal_dof)
        self._mass = np.empty((*position.shape[:2], f, f))
        self._across = np.empty((*position.shape[:2], f, g))
        """How a gimbal's own turning drags the rest."""
        self._gyro = np.empty_like(self._across)
        """d p / d angle."""
        data = mujoco.MjData(model)
        for at in np.ndindex(position.shape[:2]):
            whole = mass_matrix(model, data, position[at])
            self._mass[at] = whole[np.ix_(self._free, self._free)]
            self._across[at] = whole[np.ix_(self._free, machine.gimbal_dof)]
            for column, place in enumerate(machine.gimbal_qpos):
                turned = position[at].copy()
                turned[place] += TURN
                after = mass_matrix(model, data, turned)[self._free] @ velocity[at]
                turned[place] -= 2.0 * TURN
                before = mass_matrix(model, data, turned)[self._free] @ velocity[at]
                self._gyro[at][:, column] = (after - before) / (2.0 * TURN)
        self._home = self._at_home(model)

    def of(self, model: mujoco.MjModel) -> Array:
        """(S, K, x, nv) change of the state by a unit impulse on each degree of freedom, a unit
        turn of each gimbal, the base being that of `model`."""
        machine = self._machine
        inverse = np.linalg.inv(self._mass + self._at_home(model) - self._home)
        base, gimbals = machine.base_dof, machine.gimbal_dof
        k, w, g = base.stop - base.start, len(self._wheels), len(gimbals)
        answer = np.zeros((*inverse.shape[:2], 2 * k + w + g, model.nv))
        bases = np.isin(self._free, np.arange(base.start, base.stop))
        moved = np.concatenate([np.flatnonzero(bases), np.searchsorted(self._free, self._wheels)])
        answer[:, :, k : 2 * k + w, self._free] = inverse[:, :, moved]
        if g:
            answer[:, :, :k, gimbals] = -(inverse @ self._across)[:, :, bases]
            answer[:, :, k : 2 * k + w, gimbals] = -(inverse @ self._gyro)[:, :, moved]
            answer[:, :, 2 * k + w :, gimbals] = np.eye(g)
        return answer

    def _at_home(self, model: mujoco.MjModel) -> Array:
        whole = mass_matrix(model, mujoco.MjData(model), model.qpos0)
        return whole[np.ix_(self._free, self._free)]


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData, position: Array) -> Array:
    """(nv, nv) of a model in a position (nq,), armatures in it [kg m^2, kg m or kg]."""
    data.qpos[:] = position
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    whole = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    return whole
