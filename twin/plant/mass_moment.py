"""Where the centre of mass is, as gravity feels it: m r of what joints carry, and of effects.

Exact for slides and hinges, however they stand on each other: masses on stages, a gyro that is not
balanced about its gimbal, an unbalanced wheel, a liquid that swings. What no body of MuJoCo's
carries (a drift, a structure that sags), the effect itself tells.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.drives import floating
from twin.effects import BodyEffect, Effect, State
from twin.model import Machine
from twin.rotation import cross

Array = NDArray[np.float64]

_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)

_BUS = -1
"""In place of a hinge, where a joint stands on none."""
_ON_AXIS = 1e-12
"""[m]: what a hinge turns and whose centre of mass is not farther from its axis is balanced."""


class MassMoment:
    """m r of n runs: at rest gravity turns the body by m r x g about the CR, body axes."""

    def __init__(
        self,
        machine: Machine,
        stated: Array,
        own: Sequence[mujoco.MjModel],
        effects: Sequence[Effect],
    ) -> None:
        """Of runs that stand anywhere.

        Args:
            machine: of all runs.
            stated: (3,) or (n, 3) m r with every joint at its zero [kg m].
            own: (n,) model of each run, or the one of all.
            effects: of all runs at once.
        """
        model, self._stated = machine.model, stated
        of_model = {id(one): _carried(one, machine.base_body) for one in own}
        pairs = [of_model[id(one)] for one in own]
        axes, arms = (np.stack(part) for part in zip(*pairs, strict=True))
        joints = _joints(model, machine.base_body)
        slides = model.jnt_type[joints] == _SLIDE
        counts = slides | arms.any(axis=(0, 2))
        under = [_hinge_below(model, joint, joints) for joint in joints]
        for k in reversed(range(len(joints))):
            if counts[k] and under[k] in joints:  # a hinge turns also what moves on it
                counts[joints.index(under[k])] = True
        kept = np.flatnonzero(counts).tolist()
        place = {joints[k]: number for number, k in enumerate(kept)}
        self._joints = [
            (bool(slides[k]), place.get(under[k], _BUS), axes[:, k], arms[:, k]) for k in kept
        ]
        self._columns = model.jnt_qposadr[[joints[k] for k in kept]]
        self._zero = model.qpos0[self._columns]
        on_body = (effect for effect in effects if isinstance(effect, BodyEffect))
        laws = (effect.mass_moment(machine.platform) for effect in on_body)
        self._laws = [law for law in laws if law is not None]
        self._base = machine.base_qpos, machine.base_dof, machine.wheel_dof
        self._last: tuple[Array, Array] | None = None

    def at(self, time: float, qpos: Array, qvel: Array) -> Array:
        """(n, 3) [kg m] where MuJoCo has qpos (n, nq) and qvel (n, nv)."""
        position = qpos[:, self._columns]
        if self._last is None or not np.array_equal(position, self._last[0]):
            self._last = position, self._stated + self._moved(position - self._zero)
        moment = self._last[1]
        if self._laws:
            base, rate, wheels = self._base
            now = np.full(len(qpos), time)
            state = State(qpos[:, base], qvel[:, rate], qvel[:, wheels], now)
            for law in self._laws:
                moment = moment + law(state)
        return moment

    def _moved(self, position: Array) -> Array:
        """(n, 3) change of m r as the joints leave their zeros by (n, joints) [m, rad].

        From the leaves to the bus: a slide adds m d u to the change of what it stands on, a hinge
        turns its arm and the changes on it alike. Nothing here depends on a run's company.
        """
        change = np.zeros((len(self._joints) + 1, len(position), 3))
        for k in reversed(range(len(self._joints))):
            slides, under, axis, arm = self._joints[k]
            angle = position[:, k, None].copy()  # sines of what lies apart may have other bits
            if slides:
                change[under] += angle * arm
                continue
            across = cross(axis, arm + change[k])
            turned = np.sin(angle) * across + 2.0 * np.sin(0.5 * angle) ** 2 * cross(axis, across)
            change[under] += change[k] + turned
        return change[_BUS]


def _joints(model: mujoco.MjModel, base_body: int) -> list[int]:
    """Ids of the slides and hinges on what `base_body` carries, those below first."""
    carried = set(floating(model, base_body).tolist()) - {base_body}
    return [
        joint
        for joint in range(model.njnt)
        if model.jnt_bodyid[joint] in carried and model.jnt_type[joint] in (_SLIDE, _HINGE)
    ]


def _hinge_below(model: mujoco.MjModel, joint: int, joints: list[int]) -> int:
    """The next of `joints` below one of them that is a hinge; else the base's."""
    while True:
        joint = int(model.dof_jntid[model.dof_parentid[model.jnt_dofadr[joint]]])
        if joint not in joints or model.jnt_type[joint] == _HINGE:
            return joint


def _carried(model: mujoco.MjModel, base_body: int) -> tuple[Array, Array]:
    """Axis (joints, 3), and arm (joints, 3) [kg m, or kg along a slide], room axes at qpos0.

    The arm of a hinge is the mass moment of all that it turns from its axis; of a slide, the mass
    along its axis.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    joints = _joints(model, base_body)
    arms = np.zeros((len(joints), 3))
    for k, joint in enumerate(joints):
        bodies = floating(model, int(model.jnt_bodyid[joint]))
        mass, axis = model.body_mass[bodies], data.xaxis[joint]
        if model.jnt_type[joint] == _SLIDE:
            arms[k] = mass.sum() * axis
            continue
        arm = mass @ (data.xipos[bodies] - data.xanchor[joint])
        if np.linalg.norm(np.cross(axis, arm)) > _ON_AXIS * mass.sum():
            arms[k] = arm
    return data.xaxis[joints], arms
