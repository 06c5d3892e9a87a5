"""What a joint takes of the motion, as numbers to be fitted beside the base: damping, stiffness.

A joint parameter is fitted where the MJCF states one that is not 0: whoever writes
`damping="0.05"` says that there is damping, and roughly how much.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.model import Machine

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointParameter:
    """One number of one joint, on all its axes alike."""

    name: str
    unit: str
    stated: float
    """As the MJCF has it."""
    put: Callable[[mujoco.MjModel, float], None]
    """Gives a compiled model another value."""


def joint_parameters(machine: Machine, wheels: bool) -> tuple[JointParameter, ...]:
    """Those of the base joint, and of the wheels' joints where their motion is predicted."""
    model, platform = machine.model, machine.platform
    base = range(machine.base_dof.start, machine.base_dof.stop)
    joints = [(platform.base.joint, list(base))]
    if wheels:
        pairs = zip(platform.wheels, machine.wheel_dof.tolist(), strict=True)
        joints += [(wheel.name, [dof]) for wheel, dof in pairs]
    found: list[JointParameter] = []
    for name, dofs in joints:
        row = int(model.dof_jntid[dofs[0]])
        found += [
            JointParameter(f"damping of {name}", "N m s", *_entry("dof_damping", dofs, model)),
            JointParameter(
                f"quadratic damping of {name}", "N m s^2", *_entry("dof_dampingpoly", dofs, model)
            ),
            JointParameter(f"stiffness of {name}", "N m", *_entry("jnt_stiffness", [row], model)),
        ]
    return tuple(parameter for parameter in found if parameter.stated != 0.0)


def _entry(
    field: str, rows: list[int], model: mujoco.MjModel
) -> tuple[float, Callable[[mujoco.MjModel, float], None]]:
    """The value in these rows of a field (the first of a polynomial), and its setter."""

    def column(of: mujoco.MjModel) -> Array:
        values: Array = getattr(of, field)
        return values if values.ndim == 1 else values[:, 0]

    def put(into: mujoco.MjModel, value: float) -> None:
        column(into)[rows] = value

    return float(column(model)[rows[0]]), put
