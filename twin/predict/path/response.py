"""How a machine's state answers an impulse on each joint, wherever its gimbals stand.

A joint that is prescribed takes no impulse. For a gimbal its column is that of a turn by one
radian: what is free keeps its momentum p = M v, so its velocity changes by -M^-1 (dp / d angle).
That is the torque of a gyro, h g x a, and where a motion is uncertain it is what counts.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.drives import PRESCRIBED_ARMATURE
from twin.model import Machine

Array = NDArray[np.float64]

TURN = 1e-4
"""Of the central difference [rad]."""


@dataclass(frozen=True)
class Masses:
    """Of the base and the wheels whose speeds are states, b numbers, at (S, K) states; what else
    moves freely goes along with them."""

    free: Array
    """(S, K, b, b)."""
    gyro: Array
    """(S, K, b, g) d momentum / d angle of each gimbal."""
    base: Array
    """(S, K, k, nv) momentum of the base by each joint's velocity."""


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
        bases = np.isin(self._free, np.arange(machine.base_dof.start, machine.base_dof.stop))
        self._bases = np.flatnonzero(bases)
        self._moved = np.concatenate([self._bases, np.searchsorted(self._free, self._wheels)])
        self._mass = np.empty((*position.shape[:2], f, f))
        self._base = np.empty((*position.shape[:2], len(self._bases), model.nv))
        self._across = np.empty((*position.shape[:2], f, g))
        """How a gimbal's own turning drags the rest."""
        self._gyro = np.empty_like(self._across)
        """d p / d angle."""
        self._turned = np.empty((*position.shape[:2], f, len(self._bases), g))
        """d M / d angle, the base's columns."""
        self._rate = velocity[..., machine.base_dof]
        data = mujoco.MjData(model)
        for at in np.ndindex(position.shape[:2]):
            whole = mass_matrix(model, data, position[at])
            self._mass[at] = whole[np.ix_(self._free, self._free)]
            self._base[at] = whole[machine.base_dof]
            self._across[at] = whole[np.ix_(self._free, machine.gimbal_dof)]
            for column, place in enumerate(machine.gimbal_qpos):
                turned = position[at].copy()
                turned[place] += TURN
                after = mass_matrix(model, data, turned)[self._free]
                turned[place] -= 2.0 * TURN
                change = (after - mass_matrix(model, data, turned)[self._free]) / (2.0 * TURN)
                self._gyro[at][:, column] = change @ velocity[at]
                self._turned[at][..., column] = change[:, machine.base_dof]
        self._home = self._at_home(model)

    def masses(self, model: mujoco.MjModel, rate: Array) -> Masses:
        """Where the response was measured, but the base that of `model`, at its rates (S, K, k)."""
        change = self._at_home(model) - self._home
        base = self._base.copy()
        base[..., self._free] += change[self._bases]
        whole, gyro = self._mass + change, self._gyro
        if gyro.shape[-1]:
            gyro = gyro + np.einsum("snfkg,snk->snfg", self._turned, rate - self._rate)
        if len(self._moved) < len(self._free):
            answer = np.linalg.inv(whole)[:, :, self._moved]
            free = np.asarray(np.linalg.inv(answer[..., self._moved]), dtype=np.float64)
            return Masses(free, free @ answer @ gyro, base)
        both = np.ix_(self._moved, self._moved)
        return Masses(whole[..., both[0], both[1]], gyro[:, :, self._moved], base)

    def of(self, model: mujoco.MjModel) -> Array:
        """(S, K, x, nv) change of the state by a unit impulse on each degree of freedom, a unit
        turn of each gimbal, the base being that of `model`."""
        machine = self._machine
        inverse = np.linalg.inv(self._mass + self._at_home(model) - self._home)
        gimbals = machine.gimbal_dof
        k, w, g = len(self._bases), len(self._wheels), len(gimbals)
        answer = np.zeros((*inverse.shape[:2], 2 * k + w + g, model.nv))
        answer[:, :, k : 2 * k + w, self._free] = inverse[:, :, self._moved]
        if g:
            answer[:, :, :k, gimbals] = -(inverse @ self._across)[:, :, self._bases]
            answer[:, :, k : 2 * k + w, gimbals] = -(inverse @ self._gyro)[:, :, self._moved]
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
