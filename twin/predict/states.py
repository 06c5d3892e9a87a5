"""States at the starts of segments, pushes along a log, and first-order responses to both."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.effects import State
from twin.effects.on_body import TorqueLaw
from twin.errors import TwinError
from twin.model import Machine

Array = NDArray[np.float64]
STEP = 1e-6
"""Of finite differences of a state [SI]."""
Factored = tuple[float, TorqueLaw]
"""A torque on the base, so many times."""


@dataclass(frozen=True)
class States:
    """One state a row, any leading axes.

    A change of one is (turn about body axes or change of the angle, change of the rate, change of
    the wheels' speeds, change of the gimbals' angles), `width` numbers.
    """

    position: Array
    """(..., 1) angle of a hinge [rad], (..., 4) attitude of a ball, or (..., 3) x, y and heading on
    a floor [m, m, rad]."""
    rate: Array
    """(..., k) [rad/s], body axes; on a floor of x, y and heading."""
    wheel_speed: Array
    """(..., w) [rad/s]; width 0 where the wheels are not predicted."""
    gimbal_angle: Array
    """(..., g) [rad]."""

    @property
    def width(self) -> int:
        """Numbers of a change."""
        return 2 * self.rate.shape[-1] + self.wheel_speed.shape[-1] + self.gimbal_angle.shape[-1]

    def __getitem__(self, rows: Any) -> "States":
        """Those at an index of leading axes."""
        return States(*(part[rows] for part in self._parts))

    @property
    def flat(self) -> "States":
        """With one leading axis."""
        rows = int(np.prod(self.rate.shape[:-1]))
        return States(*(part.reshape(rows, part.shape[-1]) for part in self._parts))

    def batched(self) -> "States":
        """With a leading axis of length 1."""
        return self[None]

    def moved(self, change: Array) -> "States":
        """After a change (..., width); leading axes broadcast."""
        k, w = self.rate.shape[-1], self.wheel_speed.shape[-1]
        turn = change[..., :k]
        if self.position.shape[-1] == 4:
            position = rotation.multiply(self.position, rotation.from_rotation_vector(turn))
        else:
            position = self.position + turn
        return States(
            position,
            self.rate + change[..., k : 2 * k],
            self.wheel_speed + change[..., 2 * k : 2 * k + w],
            self.gimbal_angle + change[..., 2 * k + w :],
        )

    def less(self, other: "States") -> Array:
        """The change (..., width) that leads from another state to this one."""
        if self.position.shape[-1] == 4:
            between = rotation.multiply(rotation.conjugate(other.position), self.position)
            turn = rotation.to_rotation_vector(between)
        else:
            turn = self.position - other.position
        rest = zip(self._parts[1:], other._parts[1:], strict=True)
        return np.concatenate([turn, *(mine - others for mine, others in rest)], axis=-1)

    def with_time(self, time: Array, change: Array | None = None) -> State:
        """(n, .) as a torque law takes them, at some times (n,) [s].

        Args:
            time: of each.
            change: (n, k) of the rate, over the step in whose middle each is.
        """
        return State(self.position, self.rate, self.wheel_speed, time, change)

    @staticmethod
    def joined(several: Sequence["States"]) -> "States":
        """Those of the first axis in a row."""
        return States(*map(np.concatenate, zip(*(item._parts for item in several), strict=True)))

    @property
    def _parts(self) -> tuple[Array, Array, Array, Array]:
        return self.position, self.rate, self.wheel_speed, self.gimbal_angle


@dataclass(frozen=True)
class PathForces:
    """Forces that are known beforehand, and torques that answer to the path that they make.

    Dry friction near rest changes from one end to the other within what a path is known to: along a
    fixed path it is a guess, and the path that it makes another one, which does not meet the first.
    """

    force: Array
    """(S, steps, nv) generalised force, constant over each step."""
    laws: tuple[Factored, ...] = ()

    def along(self, machine: Machine, path: States, times: Array) -> Array:
        """(S, steps, nv) of all, along a path.

        Args:
            machine: that is pushed.
            path: (1, S, steps + 1, .).
            times: (S, steps) at which the steps begin [s].
        """
        return self.force + forces_along(self.laws, machine, path, times)

    def slopes(self, path: States, times: Array) -> Array:
        """(S, steps, k, 2 k + w) d torque of the laws on the base by its turn, its rate and the
        wheels' speeds, in the middle of each step of a path.

        Args:
            path: (S, steps + 1, .).
            times: (S, steps) at which the steps begin [s].
        """
        before, after = path[:, :-1], path[:, 1:]
        middle = before.moved(0.5 * after.less(before)).flat
        k = middle.rate.shape[-1]
        change = (after.rate - before.rate).reshape(-1, k)
        shown = 2 * k + middle.wheel_speed.shape[-1]
        nudges = STEP * np.eye(shown, middle.width)
        columns = [
            torque_of(self.laws, middle.moved(nudge).with_time(times.ravel(), change))
            - torque_of(self.laws, middle.moved(-nudge).with_time(times.ravel(), change))
            for nudge in nudges
        ]
        slopes = np.stack(columns, axis=-1) / (2.0 * STEP)
        return slopes.reshape(*times.shape, k, shown)


def torque_of(laws: Sequence[Factored], state: State) -> Array:
    """(n, k) of laws [N m]."""
    return np.asarray(sum(factor * law(state) for factor, law in laws))


def forces_along(laws: Sequence[Factored], machine: Machine, path: States, times: Array) -> Array:
    """(S, steps, nv) of laws along a path, as for `PathForces.along`."""
    force = np.zeros((*times.shape, machine.model.nv))
    if laws:
        before, after = path[0, :, :-1], path[0, :, 1:]
        middle = before.moved(0.5 * after.less(before)).flat
        change = (after.rate - before.rate).reshape(len(middle.rate), -1)
        torque = torque_of(laws, middle.with_time(times.ravel(), change))
        force[..., machine.base_dof] = torque.reshape(*times.shape, -1)
    return force


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
    carried: Array, answer: Array, push: PathForces, machine: Machine, path: States, begins: Array
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
