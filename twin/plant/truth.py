"""A simulation's true states as streams: what the sensors see before any fault.

Streams that stand in no column of MuJoCo's state: what a perfect sensor makes of it.
Specific force is the mean over the physics step before the sample, or over as many of them as fill
the sensor's window, as an accelerometer that sums up velocity increments gives it.

Where the centre of mass is, as gravity feels it: m r of what joints carry, and of effects.
Exact for slides and hinges, however they stand on each other: masses on stages, a gyro that is not
balanced about its gimbal, an unbalanced wheel, a liquid that swings. What no body of MuJoCo's
carries (a drift, a structure that sags), the effect itself tells.
"""

import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.drives import floating
from twin.effects import BodyEffect, Effect, State
from twin.model import Machine
from twin.platform import Sensor
from twin.rotation import conjugate, cross, rotate, to_euler_zyx
from twin.signals import Samples

Array = NDArray[np.float64]


_EPS = 1e-9
Derived = Callable[[Sensor | None, Array, Array], Array]
"""Of a sensor, states (n, m, nq + nv) and those before them (n, b, nq + nv): (n, m, k)."""


def window_steps(sensor: Sensor, step: float) -> int:
    """Physics steps that hold a sensor's window, at least one."""
    return max(math.ceil(sensor.window / step - _EPS), 1)


def derived_streams(machine: Machine, models: Sequence[mujoco.MjModel] = ()) -> dict[str, Derived]:
    """By stream, those that this machine can have; `models`: one a run, where they
    differ."""
    if machine.platform.base.kind == "hinge":
        return {}
    streams = _Derived(machine, models)
    return {
        "inclinometer": streams.inclinometer,
        "accelerometer": streams.accelerometer,
        "magnetometer": streams.magnetometer,
        "position": streams.position,
        "velocity": streams.velocity,
    }


def site_places(machine: Machine) -> dict[str, Array]:
    """(3,) from the CR to each site, body axes [m]."""
    model = machine.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    anchor = data.xanchor[model.body_jntadr[machine.base_body]]
    return {model.site(i).name: data.site_xpos[i] - anchor for i in range(model.nsite)}


def specific_force(attitude: Array, push: Array, rate: Array, turning: Array, site: Array) -> Array:
    """What an accelerometer feels, body axes [m/s^2].

    Args:
        attitude: (..., 4).
        push: (..., 3) acceleration of the CR less gravity's, in the room [m/s^2].
        rate: (..., 3) [rad/s], body axes.
        turning: (..., 3) its derivative [rad/s^2].
        site: (3,) from the CR [m].
    """
    felt = rotate(conjugate(attitude), push)
    return felt + cross(turning, site) + cross(rate, cross(rate, site))


def elevations(force: Array, gravity: float) -> Array:
    """Roll and pitch (..., 2) that specific force (..., 3) makes believe [rad]."""
    level = np.clip(force / gravity, -1.0, 1.0)
    return np.stack([np.arcsin(level[..., 1]), -np.arcsin(level[..., 0])], axis=-1)


class _Derived:
    def __init__(self, machine: Machine, models: Sequence[mujoco.MjModel] = ()) -> None:
        model, nq = machine.model, machine.model.nq
        self._step = machine.platform.step
        self._gravity = machine.platform.gravity
        self._field = machine.platform.magnetic_field
        self._lifted = 0.0 - np.array([item.opt.gravity for item in models or (model,)])
        self._attitude = machine.base_qpos
        self._rate = slice(nq + machine.base_dof.start, nq + machine.base_dof.stop)
        self._place = machine.place_qpos
        self._speed = nq + machine.place_dof
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        anchor = data.xanchor[model.body_jntadr[machine.base_body]]
        self._height = float(anchor[2])
        self._sites = site_places(machine)

    def accelerometer(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Specific force at the sensor's site, body axes [m/s^2]."""
        assert sensor is not None
        steps, window = window_steps(sensor, self._step), max(sensor.window, self._step)
        moving = np.concatenate([before[:, before.shape[1] - steps :], states], axis=1)
        earlier = moving[:, :-steps]
        too_early = steps - window / self._step
        if too_early > _EPS:
            later = moving[:, 1 : moving.shape[1] - steps + 1]
            earlier = earlier + too_early * (later - earlier)
        rate, site = states[..., self._rate], self._sites[sensor.site]
        turning = (rate - earlier[..., self._rate]) / window
        push = np.zeros_like(rate)
        push[:] = self._lifted[:, None]
        if self._speed.size:
            gained = states[..., self._speed] - earlier[..., self._speed]
            push[..., : self._speed.size] += gained / window
        return specific_force(states[..., self._attitude], push, rate, turning, site)

    def inclinometer(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Elevations roll and pitch that specific force makes believe [rad]."""
        return elevations(self.accelerometer(sensor, states, before), self._gravity)

    def magnetometer(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """The field in body axes [T]."""
        del sensor, before
        return rotate(conjugate(states[..., self._attitude]), self._field)

    def position(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Of the CR in the room [m]."""
        del sensor, before
        place = np.empty((*states.shape[:-1], 3))
        place[..., 2] = self._height
        place[..., : self._place.size] = states[..., self._place]
        return place

    def velocity(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Of the CR in the room [m/s]."""
        del sensor, before
        speed = np.zeros((*states.shape[:-1], 3))
        speed[..., : self._speed.size] = states[..., self._speed]
        return speed


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
        models: Sequence[mujoco.MjModel],
        effects: Sequence[Effect],
    ) -> None:
        """Of runs that stand anywhere.

        Args:
            machine: of all runs.
            stated: (3,) or (n, 3) m r with every joint at its zero [kg m].
            models: (n,) model of each run, or the one of all.
            effects: of all runs at once.
        """
        model, self._stated = machine.model, stated
        of_model = {id(item): _carried(item, machine.base_body) for item in models}
        pairs = [of_model[id(item)] for item in models]
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


Columns = slice | NDArray[np.intp]


class Truth:
    """Reads streams out of MuJoCo's states (..., nq + nv)."""

    def __init__(
        self,
        machine: Machine,
        offset: Array | None = None,
        models: Sequence[mujoco.MjModel] = (),
        effects: Sequence[Effect] | None = None,
    ) -> None:
        """Of runs of one machine.

        Args:
            machine: of all runs.
            offset: (3,) or (n, 3) m r with every joint at its zero [kg m]; None: as the platform
                states.
            models: (n,) model of each run, where they differ.
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
        base = machine.platform.base
        # a ball that is locked turns with the lower stage, and carries its inertia
        self._turned_along = base.joint in base.locked and bool(machine.heading_qpos.size)
        if turns:
            self._columns |= {"attitude": machine.base_qpos, "gyro": base_dof}
        else:
            self._columns |= {"joint_angle": machine.base_qpos, "joint_rate": base_dof}
        self._names = {
            ("truth_rate" if stream == "gyro" else f"truth_{stream}"): columns
            for stream, columns in self._columns.items()
            if not isinstance(columns, np.ndarray) or columns.size
        }
        self._derived = derived_streams(machine, models)
        self._shown = [name for name in ("position", "velocity") if machine.place_qpos.size]
        stated = machine.platform.center_of_mass_offset
        self._mass_moment = MassMoment(
            machine,
            stated if offset is None else offset,
            models or (machine.model,),
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
        if self._turned_along:
            yaw = to_euler_zyx(states[:, None, self._columns["attitude"]])[..., :1]
            streams["truth_heading"] = Samples(yaw, stamp, mask)
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
