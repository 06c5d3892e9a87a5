"""What a joint takes of the motion, as numbers to be fitted beside the base: damping, stiffness.

A joint parameter is fitted where the MJCF states one that is not 0: whoever writes
`damping="0.05"` says that there is damping, and roughly how much.
"""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.model import Machine
from twin.predict.path.states import States

Array = NDArray[np.float64]

Kind = Literal["damping", "quadratic damping", "stiffness"]

UNITS: dict[Kind, str] = {
    "damping": "N m s",
    "quadratic damping": "N m s^2",
    "stiffness": "N m",
}


@dataclass(frozen=True)
class JointParameter:
    """One number of the base joint or of a wheel's, on all its axes alike."""

    kind: Kind
    joint: str
    stated: float
    """As the MJCF has it."""
    dofs: tuple[int, ...]
    wheel: int | None
    """Which one; None: the base joint."""
    rest: Array
    """Where the base joint's spring is at rest: (1,) [rad] or (4,)."""

    @property
    def name(self) -> str:
        """`damping of axle`."""
        return f"{self.kind} of {self.joint}"

    @property
    def unit(self) -> str:
        """SI."""
        return UNITS[self.kind]

    def put(self, model: mujoco.MjModel, value: float) -> None:
        """Give a compiled model another value."""
        dofs = list(self.dofs)
        if self.kind == "damping":
            model.dof_damping[dofs] = value
        elif self.kind == "quadratic damping":
            model.dof_dampingpoly[dofs, 0] = value
        else:
            model.jnt_stiffness[model.dof_jntid[dofs[0]]] = value

    def torque(self, path: States) -> Array:
        """(..., axes) at value 1, along a path (..., .)."""
        if self.kind == "stiffness":
            if len(self.rest) == 4:
                turned = rotation.multiply(rotation.conjugate(self.rest), path.position)
                return -rotation.to_rotation_vector(turned)
            return self.rest - path.position
        rate = path.rate if self.wheel is None else path.wheel_speed[..., [self.wheel]]
        return -rate if self.kind == "damping" else -rate * np.abs(rate)


def joint_parameters(machine: Machine, wheels: bool) -> tuple[JointParameter, ...]:
    """Those of the base joint, and the damping of wheels whose motion is predicted."""
    model, platform = machine.model, machine.platform
    base = tuple(range(machine.base_dof.start, machine.base_dof.stop))
    rest = model.qpos_spring[machine.base_qpos].copy()
    joint = platform.base.joint
    stiffness = float(model.jnt_stiffness[model.dof_jntid[base[0]]])
    found = [
        *_dampings(model, joint, base, None, rest),
        JointParameter("stiffness", joint, stiffness, base, None, rest),
    ]
    for index, wheel in enumerate(platform.wheels if wheels else ()):
        found += _dampings(model, wheel.name, (int(machine.wheel_dof[index]),), index, rest)
    return tuple(parameter for parameter in found if parameter.stated != 0.0)


def joint_forces(joints: tuple[JointParameter, ...], machine: Machine, path: States) -> Array:
    """(S, steps, nv, p) generalised force by each at value 1, along a path (1, S, steps + 1, .)."""
    first, last = path[0, :, :-1], path[0, :, 1:]
    force = np.zeros((*first.rate.shape[:2], machine.model.nv, len(joints)))
    for place, joint in enumerate(joints):
        mean = 0.5 * (joint.torque(first) + joint.torque(last))
        force[:, :, list(joint.dofs), place] = mean
    return force


def _dampings(
    model: mujoco.MjModel, joint: str, dofs: tuple[int, ...], wheel: int | None, rest: Array
) -> list[JointParameter]:
    linear, quadratic = float(model.dof_damping[dofs[0]]), float(model.dof_dampingpoly[dofs[0], 0])
    return [
        JointParameter("damping", joint, linear, dofs, wheel, rest),
        JointParameter("quadratic damping", joint, quadratic, dofs, wheel, rest),
    ]
