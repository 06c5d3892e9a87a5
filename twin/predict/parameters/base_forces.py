"""What a change of the base does to a motion, as forces: J and m r enter the equations linearly.

    torque = -(dJ dw/dt + w x dJ w) + d(m r) x g_body

along a path: to first order the same change of the motion as another J and m r, without a rollout.
"""

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.predict.parameters.base import ENTRIES, BaseParameters, hinge_axis
from twin.predict.parameters.joints import joint_forces
from twin.predict.path.states import States

Array = NDArray[np.float64]


def base_forces(
    base: BaseParameters, path: States, step: float, extra: Array | None = None
) -> Array:
    """(S, steps, nv, p) generalised force by each base parameter, along a path (1, S, ...).

    Args:
        base: J, m r and what else is fitted.
        path: that the machine takes.
        step: of its instants [s].
        extra: (S, steps, k) part of the angular acceleration that would be as it is for any J
            [rad/s^2].
    """
    machine = base.machine
    rate, angle = path.rate[0], path.position[0]
    hinge = angle.shape[-1] == 1
    axis = hinge_axis(machine) if hinge else np.zeros(3)
    attitude = rotation.from_rotation_vector(angle * axis) if hinge else angle
    turned = rate * axis if hinge else rate
    middle = rotation.normalized(attitude[:, :-1] + attitude[:, 1:])
    w = 0.5 * (turned[:, :-1] + turned[:, 1:])
    change = (rate[:, 1:] - rate[:, :-1]) / step - (0.0 if extra is None else extra)
    acceleration = change * axis if hinge else change
    gravity = -machine.platform.gravity * rotation.vertical_body(middle)
    entries = np.zeros((*w.shape, 9))
    for place, (i, j) in enumerate(ENTRIES):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        entries[..., place] = -(acceleration @ unit + rotation.cross(w, w @ unit))
    for i in range(3):
        entries[..., 6 + i] = rotation.cross(np.eye(3)[i], gravity)
    torque = entries @ base.map
    if hinge:
        torque = np.einsum("skip,i->skp", torque, axis)[:, :, None]
    force = np.zeros((*torque.shape[:2], machine.model.nv, torque.shape[-1]))
    force[:, :, machine.base_dof] = torque
    if base.joints:
        force[..., -len(base.joints) :] += joint_forces(base.joints, machine, path)
    return force
