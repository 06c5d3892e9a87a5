"""A simulation's true states, as streams: what the sensors see before any fault."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.effects import Effect
from twin.model import Machine
from twin.plant.derived import derived_streams
from twin.plant.mass_moment import MassMoment
from twin.platform import Sensor
from twin.signals import Samples

Array = NDArray[np.float64]
Columns = slice | NDArray[np.intp]


class Truth:
    """Reads streams out of MuJoCo's states (..., nq + nv)."""

    def __init__(
        self,
        machine: Machine,
        offset: Array | None = None,
        own: Sequence[mujoco.MjModel] = (),
        effects: Sequence[Effect] | None = None,
    ) -> None:
        """Of runs of one machine.

        Args:
            machine: of all runs.
            offset: (3,) or (n, 3) m r with every joint at its zero [kg m]; None: as the platform
                states.
            own: (n,) model of each run, where they differ.
            effects: of all runs at once; None: the machine's.
        """
        nq = machine.model.nq
        base_dof = slice(nq + machine.base_dof.start, nq + machine.base_dof.stop)
        self._turns = turns = machine.platform.base.kind != "hinge"
        self._columns: dict[str, Columns] = {
            "wheel_speed": _tight(nq + machine.wheel_dof),
            "gimbal_angle": _tight(machine.gimbal_qpos),
            "gimbal_rate": _tight(nq + machine.gimbal_dof),
            "stage_position": _tight(machine.stage_qpos),
            "stage_speed": _tight(nq + machine.stage_dof),
            "heading": _tight(machine.heading_qpos),
        }
        if turns:
            self._columns |= {"attitude": machine.base_qpos, "gyro": base_dof}
        else:
            self._columns |= {"joint_angle": machine.base_qpos, "joint_rate": base_dof}
        self._names = {
            ("truth_rate" if stream == "gyro" else f"truth_{stream}"): columns
            for stream, columns in self._columns.items()
            if not isinstance(columns, np.ndarray) or columns.size
        }
        self._derived = derived_streams(machine)
        self._shown = [name for name in ("position", "velocity") if machine.place_qpos.size]
        stated = machine.platform.center_of_mass_offset
        self._mass_moment = MassMoment(
            machine,
            stated if offset is None else offset,
            own or (machine.model,),
            machine.effects if effects is None else effects,
        )
        self._inertia = _inertia_law(machine)
        self._last: tuple[Array, Array] | None = None

    def true(self, stream: str, states: Array) -> Array:
        """A stream that stands in the state, `stage_speed` among them, (n, m, k)."""
        return states[..., self._columns[stream]]

    def motion(self, states: Array) -> tuple[Array, Array]:
        """Attitude (n, m, 4) and rate (n, m, 3) of a ball joint, angle and rate (n, m, 1) of a
        hinge."""
        names = ("attitude", "gyro") if self._turns else ("joint_angle", "joint_rate")
        position, rate = (self.true(name, states) for name in names)
        return position, rate

    def measured(self, sensor: Sensor, states: Array, before: Array) -> Array:
        """What a perfect sensor would show in each of `states` (n, m, nq + nv), shape (n, m, k).

        `before` (n, b, nq + nv) are the states one physics step after the other before the first,
        as many as the longest window of a sensor takes.
        """
        if sensor.stream in self._columns:
            return self.true(sensor.stream, states)
        return self._derived[sensor.stream](sensor, states, before)

    def at(
        self, time: float, qpos: Array, qvel: Array, valid: NDArray[np.bool_]
    ) -> dict[str, Samples]:
        """All `truth_*` streams at one instant; one sample each."""
        states = np.concatenate([qpos, qvel], axis=1)
        stamp = np.full((len(states), 1), time)
        mask = valid[:, None].copy()
        streams = {
            name: Samples(states[:, None, columns], stamp, mask)
            for name, columns in self._names.items()
        }
        for name in self._shown:
            seen = self._derived[name](None, states[:, None], states[:, None])
            streams[f"truth_{name}"] = Samples(seen, stamp, mask)
        with np.errstate(all="ignore"):  # a run that was stopped may stand anywhere
            offset = self._mass_moment.at(time, qpos, qvel)
        inertia = self._inertia_at(states[:, self._columns["stage_position"]])
        streams["truth_center_of_mass_offset"] = Samples(offset[:, None], stamp, mask)
        streams["truth_inertia"] = Samples(inertia[:, None], stamp, mask)
        return streams

    def _inertia_at(self, stages: Array) -> Array:
        """J at these stage positions; stages stand still most of the time."""
        if self._last is None or not np.array_equal(stages, self._last[0]):
            self._last = stages, self._inertia(stages)
        return self._last[1]


def _tight(index: NDArray[np.intp]) -> Columns:
    """A slice where the columns are neighbours: a view instead of a copy."""
    if index.size and (np.diff(index) == 1).all():
        return slice(int(index[0]), int(index[-1]) + 1)
    return index


def _inertia_law(machine: Machine) -> Callable[[Array], Array]:
    """J as xx yy zz xy xz yz (n, 6) as a function of stage positions (n, s)."""
    platform, riding = machine.platform, machine.sliding
    linear = np.einsum(
        "b,bsij->sij", riding.mass, 2.0 * _spread(riding.home[:, None], riding.travel)
    )
    square = np.einsum(
        "b,bstij->stij", riding.mass, _spread(riding.travel[:, :, None], riding.travel[:, None])
    )

    def inertia(position: Array) -> Array:
        change = np.einsum("ns,si->ni", position, _six(linear))
        squares = np.einsum("ns,nt,sti->ni", position, position, _six(square))
        return _six(platform.inertia) + change + squares

    return inertia


def _spread(a: Array, b: Array) -> Array:
    """(a . b) I - (a b^T + b a^T) / 2, the polar form of the parallel-axis term, (..., 3, 3)."""
    outer = np.einsum("...i,...j->...ij", a, b)
    dot = np.einsum("...i,...i->...", a, b)
    return dot[..., None, None] * np.eye(3) - 0.5 * (outer + outer.swapaxes(-1, -2))


def _six(tensor: Array) -> Array:
    """xx yy zz xy xz yz of symmetric tensors (..., 3, 3)."""
    rows, columns = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
    return tensor[..., rows, columns]
