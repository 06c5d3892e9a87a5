"""What perturbations push a log's machine with, beside what the log drove it with."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.effects import State
from twin.effects.on_body import TorqueLaw
from twin.model import Machine
from twin.predict.path.states import STEP, States

Array = NDArray[np.float64]
Factored = tuple[float, TorqueLaw]
"""A torque on the base, so many times."""


@dataclass(frozen=True)
class Push:
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
        shown = 2 * k + middle.wheel_speed.shape[-1]
        nudges = STEP * np.eye(shown, middle.width)
        columns = [
            torque_of(self.laws, middle.moved(nudge).with_time(times.ravel()))
            - torque_of(self.laws, middle.moved(-nudge).with_time(times.ravel()))
            for nudge in nudges
        ]
        slopes = np.stack(columns, axis=-1) / (2.0 * STEP)
        return slopes.reshape(*times.shape, k, shown)


def torque_of(laws: Sequence[Factored], state: State) -> Array:
    """(n, k) of laws [N m]."""
    return np.asarray(sum(factor * law(state) for factor, law in laws))


def forces_along(laws: Sequence[Factored], machine: Machine, path: States, times: Array) -> Array:
    """(S, steps, nv) of laws along a path, as for `Push.along`."""
    force = np.zeros((*times.shape, machine.model.nv))
    if laws:
        before, after = path[0, :, :-1], path[0, :, 1:]
        middle = before.moved(0.5 * after.less(before)).flat
        torque = torque_of(laws, middle.with_time(times.ravel()))
        force[..., machine.base_dof] = torque.reshape(*times.shape, -1)
    return force
