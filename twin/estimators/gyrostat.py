"""A body with wheels, gimbals and sliding masses as a filter moves it, by its momentum.

    H = J w + A h + s      momentum about the CR, body axes
    dH/dt = M x g - w x H,  dh/dt = u

h is the momentum of each wheel about its own axis, its share of the body's turning included, so
that J is without that; s is what rotors at a fixed speed, turning gimbals and moving masses hold; M
is m r with the masses where they are. Runs come first, (n, ...).
"""

import copy
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.model import Machine, Sliding, compile_model
from twin.platform import Platform
from twin.rotation import cross, from_rotation_vector, multiply, skew, vertical_body

Array = NDArray[np.float64]


class Parts(NamedTuple):
    """What the parts are between two ticks."""

    inertia: Array
    """(n, 3, 3) J without the wheels' turning about their own axes [kg m^2]."""
    inverse: Array
    """(n, 3, 3) of it."""
    axes: Array
    """(n, 3, w) A: the wheels' axes, side by side."""
    held: Array
    """(n, 3) s [N m s]."""
    moved: Array
    """(n, 3) what the masses add to m r [kg m]."""


class Motion(NamedTuple):
    """Where the body is and how it turns."""

    attitude: Array
    """(n, 4)."""
    momentum: Array
    """(n, 3) H [N m s]."""
    spins: Array
    """(n, w) h [N m s]."""


@dataclass(frozen=True)
class Gyrostat:
    """One machine's numbers."""

    inertia: Array
    """(3, 3) J with the stages at 0 [kg m^2]."""
    gravity: float
    """[m/s^2]."""
    wheel_inertia: Array
    """(w,) about their axes [kg m^2]."""
    axes: Array
    """(w + rotors, 3) spin axes at gimbal angle 0."""
    turned: Array
    """(w + rotors, 3) gimbal axis x spin axis; 0 where no gimbal carries it."""
    gimbal: NDArray[np.intp]
    """(w + rotors,) which gimbal; 0 where none."""
    gimbal_axes: Array
    """(gimbals, 3)."""
    gimbal_inertia: Array
    """(gimbals,) of each about its axis, with what it carries [kg m^2]."""
    rotor_momentum: Array
    """(rotors,) [N m s]."""
    riding: Sliding
    """The bodies on the stages."""

    @classmethod
    def of(cls, platform: Platform) -> "Gyrostat":
        """Of a platform, whose CM is not asked for."""
        spinning = (*platform.wheels, *platform.rotors)
        names = [gimbal.name for gimbal in platform.gimbals]
        carriers = [None if s.gimbal is None else names.index(s.gimbal) for s in spinning]
        axes = np.array([s.axis for s in spinning]).reshape(-1, 3)
        machine = compile_model(platform)
        turned = np.zeros_like(axes)
        for row, carrier in enumerate(carriers):
            if carrier is not None:
                turned[row] = np.cross(platform.gimbals[carrier].axis, axes[row])
        return cls(
            inertia=platform.inertia,
            gravity=platform.gravity,
            wheel_inertia=np.array([wheel.inertia for wheel in platform.wheels]),
            axes=axes,
            turned=turned,
            gimbal=np.array([carrier or 0 for carrier in carriers], dtype=np.intp),
            gimbal_axes=np.array([gimbal.axis for gimbal in platform.gimbals]).reshape(-1, 3),
            gimbal_inertia=_gimbal_inertia(machine),
            rotor_momentum=np.array([rotor.momentum for rotor in platform.rotors]),
            riding=machine.sliding,
        )

    def parts(
        self,
        stages: tuple[Array, Array],
        gimbals: tuple[Array, Array],
        period: float,
        at: float = 0.5,
    ) -> Parts:
        """The parts between two ticks.

        Args:
            stages: positions at both, (n, stages) [m].
            gimbals: angles at both, (n, gimbals) [rad].
            period: between them [s].
            at: where between them the axes are taken: 0 the first, 1 the second.
        """
        n, wheels = len(gimbals[0]), len(self.wheel_inertia)
        axes = np.broadcast_to(self.axes, (n, *self.axes.shape))
        if self.turned.any():
            angles = (1.0 - at) * gimbals[0] + at * gimbals[1]
            angle = angles[:, self.gimbal, None]
            fixed = ~np.any(self.turned, axis=1, keepdims=True)
            axes = np.where(fixed, axes, axes * np.cos(angle) + self.turned * np.sin(angle))
        spin, rotor = axes[:, :wheels], axes[:, wheels:]
        inertia = self.inertia - np.einsum("w,nwi,nwj->nij", self.wheel_inertia, spin, spin)
        held = np.einsum("r,nri->ni", self.rotor_momentum, rotor)
        if period > 0.0:
            swept = (gimbals[1] - gimbals[0]) * self.gimbal_inertia
            held = held + np.einsum("ng,gi->ni", swept, self.gimbal_axes) / period
        riding = self.riding
        path = np.einsum("ns,bsi->nbi", 0.5 * (stages[0] + stages[1]), riding.travel)
        moved = np.einsum("b,nbi->ni", riding.mass, path)
        if path.any():
            place = riding.home + path
            gone = np.einsum("ns,bsi->nbi", stages[1] - stages[0], riding.travel)
            inertia = inertia + np.einsum("b,nbij->nij", riding.mass, _spread(place))
            inertia = inertia - np.einsum("b,bij->ij", riding.mass, _spread(riding.home))
            if period > 0.0:
                swept = np.einsum("b,nbi->ni", riding.mass, cross(place, gone))
                held = held + swept / period
        return Parts(inertia, np.linalg.inv(inertia), spin.transpose(0, 2, 1), held, moved)

    def down(self, attitude: Array) -> Array:
        """g in body axes, (n, 3) [m/s^2]."""
        return -self.gravity * vertical_body(attitude)

    def moved(
        self, motion: Motion, moment: Array, parts: Parts, torque: Array, period: float
    ) -> Motion:
        """After a period [s] under the wheels' torques u (n, w) [N m]; m r without `parts.moved`.

        H by fourth-order Runge-Kutta; the attitude by the mean of its rates, and the coning of a
        rate that changes evenly.
        """
        whole = moment + parts.moved

        def pull(at: Motion) -> tuple[Array, Array]:
            rate = rate_of(parts, at)
            return cross(whole, self.down(at.attitude)) - cross(rate, at.momentum), rate

        def onward(rate: Array, change: Array, step: float) -> Motion:
            return Motion(
                multiply(motion.attitude, from_rotation_vector(step * rate)),
                motion.momentum + step * change,
                motion.spins + step * torque,
            )

        first, begin = pull(motion)
        second, early = pull(onward(begin, first, 0.5 * period))
        third, late = pull(onward(early, second, 0.5 * period))
        fourth, end = pull(onward(late, third, period))
        change = (first + 2.0 * (second + third) + fourth) / 6.0
        rate = (begin + 2.0 * (early + late) + end) / 6.0
        coning = (period / 12.0) * cross(begin, end)
        return onward(rate + coning, change, period)

    def slope(self, motion: Motion, moment: Array, parts: Parts) -> Array:
        """F (n, 12 + w, 12 + w) of the errors of attitude, H, gyro bias, m r and h."""
        inverse, axes = parts.inverse, parts.axes
        rate = rate_of(parts, motion)
        g, momentum = skew(self.down(motion.attitude)), skew(motion.momentum)
        size = 12 + axes.shape[2]
        out = np.zeros((len(rate), size, size))
        out[:, :3, :3] = -skew(rate)
        out[:, :3, 3:6] = inverse
        out[:, 3:6, :3] = skew(moment + parts.moved) @ g
        out[:, 3:6, 3:6] = momentum @ inverse - skew(rate)
        out[:, 3:6, 9:12] = -g
        out[:, :6, 12:] = -out[:, :6, 3:6] @ axes
        out[:, 3:6, 12:] -= skew(rate) @ axes
        return out


def _gimbal_inertia(machine: Machine) -> Array:
    """Of each gimbal about its axis, without the armature that prescribes its motion."""
    bare = copy.copy(machine.model)
    bare.dof_armature[:] = 0.0
    mujoco.mj_setConst(bare, mujoco.MjData(bare))
    return np.asarray(bare.dof_M0[machine.gimbal_dof], dtype=np.float64)


def rate_of(parts: Parts, motion: Motion) -> Array:
    """w (n, 3) [rad/s]."""
    spun = np.einsum("niw,nw->ni", parts.axes, motion.spins)
    return np.einsum("nij,nj->ni", parts.inverse, motion.momentum - spun - parts.held)


def _spread(place: Array) -> Array:
    """|p|^2 1 - p p^T, (..., 3, 3)."""
    square = np.einsum("...i,...i->...", place, place)
    return square[..., None, None] * np.eye(3) - place[..., None] * place[..., None, :]
