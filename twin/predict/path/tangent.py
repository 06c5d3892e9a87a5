"""How small changes of a path's start, and small forces along it, change it, to first order."""

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.model import Machine
from twin.predict.path.push import Push, torque_of
from twin.predict.path.states import States

Array = NDArray[np.float64]


def carried_states(reach: Array) -> Array:
    """Changes (S, steps, x, x) of the state from one instant to the next.

    Args:
        reach: (S, steps + 1, x, x) change of the state at each instant by that at the first.

    Raises:
        TwinError: a motion that forgets its start within a segment, down to the last digit.
    """
    before, after = reach[:, :-1].swapaxes(-1, -2), reach[:, 1:].swapaxes(-1, -2)
    try:
        return np.asarray(np.linalg.solve(before, after), dtype=np.float64).swapaxes(-1, -2)
    except np.linalg.LinAlgError:
        raise TwinError(
            "the motion of a machine with such parameters cannot be followed: it is damped so"
            " strongly that nothing is left of its start after a moment; look at the damping and"
            " the friction that the platform states"
        ) from None


def reached(carried: Array) -> Array:
    """Changes (S, steps + 1, x, x) of the state at each instant by that at the first.

    Args:
        carried: (S, steps, x, x) change of the state from one instant to the next.
    """
    segments, steps, x, _ = carried.shape
    reach = np.empty((segments, steps + 1, x, x))
    reach[:, 0] = np.eye(x)
    for k in range(steps):
        reach[:, k + 1] = carried[:, k] @ reach[:, k]
    return reach


def carried_forces(carried: Array, answer: Array, forces: Array, step: float) -> Array:
    """Changes (S, steps + 1, x, a) of the state at each instant.

    Half of a step's impulse acts before it, half after: exact to second order in the step.

    Args:
        carried: (S, steps, x, x) change of the state from one instant to the next.
        answer: (S, steps or 1, x, nv) change of the state by a unit impulse on each degree of
            freedom.
        forces: (S, steps, nv, a), constant over each step.
        step: [s].
    """
    segments, steps, x, _ = carried.shape
    half = 0.5 * step * (answer @ forces)
    change = np.zeros((segments, steps + 1, x, forces.shape[-1]))
    for k in range(steps):
        change[:, k + 1] = carried[:, k] @ (change[:, k] + half[:, k]) + half[:, k]
    return change


def carried_answers(
    carried: Array, answer: Array, push: Push, machine: Machine, path: States, begins: Array
) -> Array:
    """Changes (S, steps + 1, x) of the state at each instant by what answers to the path, and so to
    its changes.

    Args:
        carried, answer: as for `carried_forces`.
        push: its laws count, its forces do not.
        machine: that is pushed.
        path: (1, S, steps + 1, .) without it.
        begins: (S, steps) at which the steps begin [s].
    """
    segments, steps, x, _ = carried.shape
    half = 0.5 * float(begins[0, 1] - begins[0, 0]) * answer[..., machine.base_dof]
    change = np.zeros((segments, steps + 1, x))
    last: Array | None = None
    for k in range(steps):
        now = torque_of(push.laws, path[0, :, k].moved(change[:, k]).with_time(begins[:, k]))
        middle = now if last is None else 1.5 * now - 0.5 * last
        last = now
        pushed = np.einsum("sxb,sb->sx", half[:, min(k, half.shape[1] - 1)], middle)
        before = change[:, k] + pushed
        change[:, k + 1] = np.einsum("sxy,sy->sx", carried[:, k], before) + pushed
    return change
