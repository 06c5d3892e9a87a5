"""Parameters of a machine that are fitted: inertia, mass moment, stiffness and damping of joints.

J and m r about the centre of rotation are identifiable, the mass itself is not. A hinge shows J
about its axis and the two components of m r across it, unless it stands upright; a ball joint shows
all 6 + 3. A joint's damping or stiffness is fitted where the MJCF states one that is not 0.

A change of the base enters the equations of motion linearly, as a force along a path:

    torque = -(dJ dw/dt + w x dJ w) + d(m r) x g_body
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.errors import TwinError
from twin.model import Machine, MassProperties, set_mass_properties
from twin.predict.states import States

Array = NDArray[np.float64]
Kind = Literal["damping", "quadratic damping", "stiffness"]
UNITS: dict[Kind, str] = {
    "damping": "N m s",
    "quadratic damping": "N m s^2",
    "stiffness": "N m",
}
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Of the inertia tensor, in the order xx yy zz xy xz yz."""
WEAK = 1.0
"""A base parameter of which no standard deviation is stated has so many of its scales: what the
logs do not show stays where it is stated, and what they show does not notice."""
NAMES = ("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz", "mr_x", "mr_y", "mr_z")


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
    if platform.base.kind == "planar":
        return ()  # drag of pads is an effect's
    base = tuple(range(machine.base_dof.start, machine.base_dof.stop))
    rest = model.qpos_spring[machine.base_qpos].copy()
    joint = platform.base.joint
    stiffness = float(model.jnt_stiffness[model.dof_jntid[base[0]]])
    result = [
        *_dampings(model, joint, base, None, rest),
        JointParameter("stiffness", joint, stiffness, base, None, rest),
    ]
    for index, wheel in enumerate(platform.wheels if wheels else ()):
        result += _dampings(model, wheel.name, (int(machine.wheel_dof[index]),), index, rest)
    return tuple(parameter for parameter in result if parameter.stated != 0.0)


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


@dataclass(frozen=True)
class BaseParameters:
    """Fitted numbers theta and how J and m r follow from them: stated + map (theta - as_stated)."""

    machine: Machine
    names: tuple[str, ...]
    units: tuple[str, ...]
    as_stated: Array
    """(p,) as platform.toml states them."""
    scale: Array
    """(p,) a typical change of each, for finite differences and conditioning."""
    prior: Array
    """(p,) standard deviations about what is stated: those that platform.toml gives, else `WEAK` of
    the scales."""
    map: Array
    """(9, p) onto Jxx Jyy Jzz Jxy Jxz Jyz, mr_x mr_y mr_z."""
    joints: tuple[JointParameter, ...] = ()
    """What the last entries of theta are, as far as they are not J and m r."""
    with_mass: bool = False
    """Whether the first entry of theta is the mass, which `map` has no part in."""

    def with_joints(self, joints: tuple[JointParameter, ...]) -> "BaseParameters":
        """With parameters of joints as further entries of theta."""
        stated = np.array([joint.stated for joint in joints])
        return replace(
            self,
            names=self.names + tuple(joint.name for joint in joints),
            units=self.units + tuple(joint.unit for joint in joints),
            as_stated=np.concatenate([self.as_stated, stated]),
            scale=np.concatenate([self.scale, np.abs(stated)]),
            prior=np.concatenate([self.prior, WEAK * np.abs(stated)]),
            map=np.concatenate([self.map, np.zeros((9, len(joints)))], axis=1),
            joints=self.joints + joints,
        )

    def without(self, index: int) -> "BaseParameters":
        """With one entry of theta held as stated."""
        keep = np.arange(len(self.names)) != index
        return replace(
            self,
            names=tuple(compress(self.names, keep)),
            units=tuple(compress(self.units, keep)),
            as_stated=self.as_stated[keep],
            scale=self.scale[keep],
            prior=self.prior[keep],
            map=self.map[:, keep],
            with_mass=self.with_mass and index != 0,
        )

    @property
    def of_body(self) -> "BaseParameters":
        """J and m r alone."""
        result = self
        for _ in self.joints:
            result = result.without(len(result.names) - 1)
        return replace(result, joints=())

    @property
    def held_moment(self) -> str:
        """The moment of inertia of a ball that is held as stated; empty where none is."""
        held = [name for name in NAMES[:3] if name not in self.names]
        return held[0] if held and self.machine.platform.base.kind == "ball" else ""

    def entries(self, theta: Array) -> Array:
        """(9,) J and m r [kg m^2, kg m]."""
        return _stated(self.machine) + self.map @ (theta - self.as_stated)

    def theta(self, entries: Array) -> Array:
        """The numbers whose entries come nearest to (9,) J and m r."""
        change = entries - _stated(self.machine)
        return self.as_stated + np.linalg.lstsq(self.map, change, rcond=None)[0]

    def model(self, theta: Array) -> mujoco.MjModel:
        """A copy of the machine's model with these parameters.

        Raises:
            TwinError: a moment of inertia would not be positive.
        """
        entries = self.entries(theta)
        inertia = np.empty((3, 3))
        for value, (i, j) in zip(entries[:6], ENTRIES, strict=True):
            inertia[i, j] = inertia[j, i] = value
        offset = entries[6:]
        smallest = float(np.linalg.eigvalsh(inertia)[0])
        if smallest <= 0.0:
            raise TwinError(f"an inertia with principal moment {smallest:.3g} kg m^2 is no body's")
        # About a fixed point the mass itself does no work; enough of it keeps any m r physical.
        mass = max(self.machine.platform.mass, 4.0 * float(offset @ offset) / smallest)
        if self.machine.platform.base.kind == "planar":
            mass = float(theta[0]) if self.with_mass else self.machine.platform.mass
        model = copy.copy(self.machine.model)
        try:
            wanted = MassProperties(mass, inertia, offset)
            set_mass_properties(model, self.machine.base_body, wanted, rigid=False)
        except ValueError as problem:
            raise TwinError(f"the fitted base is no rigid body: {problem}") from None
        first = len(theta) - len(self.joints)
        for joint, value in zip(self.joints, theta[first:].tolist(), strict=True):
            joint.put(model, value)
        return model

    def table(self, theta: Array, covariance: Array, quantile: float) -> Mapping[str, Any]:
        """`base` of the command line's JSON: value, low, high; null where the log cannot see."""
        entries = self.entries(theta)
        spread = self.map @ covariance @ self.map.T
        half = quantile * np.sqrt(np.maximum(np.diag(spread), 0.0))
        seen = np.abs(self.map).sum(axis=1) > 0.0
        if self.machine.platform.base.kind == "hinge":
            # the others only follow, so that the body stays one
            axis = hinge_axis(self.machine)
            seen[:6] = [abs(axis[i] * axis[j]) > 1e-9 for i, j in ENTRIES]
        bounds = [
            [
                float(v + sign * h) if s else None
                for v, h, s in zip(entries, half, seen, strict=True)
            ]
            for sign in (-1.0, 1.0)
        ]
        values = [float(value) for value in entries]
        mass: dict[str, Any] = {}
        if self.with_mass:
            width = quantile * float(np.sqrt(max(covariance[0, 0], 0.0)))
            value = float(theta[0])
            mass = {
                "mass": {"value": value, "low": value - width, "high": value + width, "unit": "kg"}
            }
        return {
            **mass,
            "inertia": {
                "value": _square(values[:6]),
                "low": _square(bounds[0][:6]),
                "high": _square(bounds[1][:6]),
                "unit": "kg m^2",
            },
            "center_of_mass_offset": {
                "value": values[6:],
                "low": bounds[0][6:],
                "high": bounds[1][6:],
                "unit": "kg m",
            },
        }

    @property
    def not_excited(self) -> tuple[str, ...]:
        """Entries of J and m r that no motion of this joint shows."""
        weightless = not self.machine.platform.gravity
        if self.machine.platform.base.kind == "planar":
            return ("J but about the vertical", "m r along the vertical")
        if self.machine.platform.base.kind == "ball":
            return ("m r",) if weightless else ()
        axis = hinge_axis(self.machine)
        hidden = [f"J but about the axis {_axis(axis)}"]
        if is_upright(axis) or weightless:
            return (*hidden, "m r")
        return (*hidden, f"m r along the axis {_axis(axis)}")


def base_parameters(machine: Machine, *, torque: bool = True, angle: bool = True) -> BaseParameters:
    """What logs of this machine can show of its base.

    Args:
        machine: compiled.
        torque: whether they have a known torque, on a hinge. Without one only J / (m r) shows; then
            m r keeps its stated length, for it is what a scale and a ruler tell. On an upright
            hinge, and without gravity, no m r shows, and J keeps its stated size: on a ball, its
            largest moment. On a floor the mass is held, which the others share a factor with.
        angle: whether they have the angle of a hinge. With its rate alone nobody knows from where
            it counts, and so not which way m r points.
    """
    stated = _stated(machine)
    if machine.platform.base.kind == "planar":
        result = _on_floor(machine)
        return result if torque else result.without(0)
    units = ("kg m^2",) * 6 + ("kg m",) * 3
    if machine.platform.base.kind == "ball":
        size = np.trace(machine.platform.inertia) / 3.0
        reach = machine.platform.mass * 1e-3
        scale = np.array([size] * 6 + [reach] * 3)
        known = _stated_sd(machine)
        prior = np.where(np.isfinite(known), known, WEAK * scale)
        # without gravity no motion shows m r, nor, where nothing drives it, the size of J
        result = BaseParameters(machine, NAMES, units, stated, scale, prior, np.eye(9))
        for index in () if machine.platform.gravity else (8, 7, 6):
            result = result.without(index)
        if not machine.platform.gravity and not torque:
            result = result.without(int(np.argmax(stated[:3])))
        return result
    axis = hinge_axis(machine)
    about_axis = float(axis @ machine.platform.inertia @ axis)
    directions = _across(axis)
    moment = stated[6:] - (axis @ stated[6:]) * axis
    weightless = is_upright(axis) or not machine.platform.gravity
    if weightless:
        directions = ()
    elif not torque and np.linalg.norm(moment) > 0.0:
        # what is across m r turns it and keeps its length
        turned = np.cross(axis, moment) / np.linalg.norm(moment)
        directions = (turned,) if angle else ()
    names, columns, starts = list[str](), list[Array](), list[float]()
    if torque or not weightless:
        # J keeps its stated proportions; only the moment about the axis is seen
        names.append("J")
        columns.append(np.concatenate([stated[:6] / about_axis, np.zeros(3)]))
        starts.append(about_axis)
    for name, across in zip(("mr_1", "mr_2"), directions, strict=False):
        single = int(np.argmax(np.abs(across)))
        names.append(NAMES[6 + single] if across[single] > 1.0 - 1e-9 else name)
        columns.append(np.concatenate([np.zeros(6), across]))
        starts.append(float(across @ stated[6:]))
    reach = max(float(np.linalg.norm(stated[6:])), 1e-3 * machine.platform.mass)
    scale = np.array([about_axis if name == "J" else reach for name in names])
    known = _stated_sd(machine)
    about = np.array([(1.0 if i == j else 2.0) * axis[i] * axis[j] for i, j in ENTRIES])
    across = [np.concatenate([np.zeros(6), direction]) for direction in directions]
    along = [np.concatenate([about, np.zeros(3)])] * (len(names) - len(across)) + across
    # what no axis turns or carries may be unknown
    sd = [
        float(np.sqrt(np.sum(np.square(known[item != 0.0] * item[item != 0.0])))) for item in along
    ]
    return BaseParameters(
        machine,
        tuple(names),
        tuple("kg m^2" if name == "J" else "kg m" for name in names),
        np.array(starts),
        scale,
        np.where(np.isfinite(sd), sd, WEAK * scale),
        np.array(columns).reshape(-1, 9).T,
    )


def _on_floor(machine: Machine) -> BaseParameters:
    """Mass, J about the vertical and m r across it."""
    platform, places = machine.platform, [2, 6, 7]
    reach = 1e-2 * platform.mass
    scale = np.array([platform.mass, platform.inertia[2, 2], reach, reach])
    known = np.concatenate([[platform.mass_sd or np.inf], _stated_sd(machine)[places]])
    entries = np.zeros((9, 4))
    entries[places, [1, 2, 3]] = 1.0
    return BaseParameters(
        machine,
        ("mass", *(NAMES[place] for place in places)),
        ("kg", "kg m^2", "kg m", "kg m"),
        np.concatenate([[platform.mass], _stated(machine)[places]]),
        scale,
        np.where(np.isfinite(known), known, WEAK * scale),
        entries,
        with_mass=True,
    )


def hinge_axis(machine: Machine) -> Array:
    """(3,) the hinge's axis in body axes at angle 0."""
    joint = machine.model.body_jntadr[machine.base_body]
    data = mujoco.MjData(machine.model)
    mujoco.mj_kinematics(machine.model, data)
    return data.xaxis[joint].copy()


def is_upright(axis: Array) -> bool:
    """Whether gravity has no moment about a hinge's axis."""
    return bool(abs(axis[2]) > 1.0 - 1e-9)


def _across(axis: Array) -> tuple[Array, ...]:
    """Two unit vectors across the axis; body axes themselves where they are."""
    free = [unit for unit in np.eye(3) if abs(unit @ axis) < 1e-9]
    first = free[0] if free else np.linalg.svd(axis[None])[2][1]
    second = free[1] if len(free) > 1 else np.cross(axis, first)
    return first, second


def _stated(machine: Machine) -> Array:
    platform = machine.platform
    tensor = [platform.inertia[i, j] for i, j in ENTRIES]
    return np.concatenate([tensor, platform.center_of_mass_offset])


def _stated_sd(machine: Machine) -> Array:
    """(9,) inf where nobody stated one."""
    platform = machine.platform
    tensor, offset = platform.inertia_sd, platform.center_of_mass_offset_sd
    return np.concatenate(
        [
            np.full(6, np.inf) if tensor is None else tensor,
            np.full(3, np.inf) if offset is None else offset,
        ]
    )


def _square(entries: list[Any]) -> list[list[Any]]:
    xx, yy, zz, xy, xz, yz = entries
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def _axis(axis: Array) -> str:
    single = int(np.argmax(np.abs(axis)))
    if abs(axis[single]) > 1.0 - 1e-9:
        return "xyz"[single]
    return "(" + ", ".join(f"{part:.3g}" for part in axis) + ")"


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
    if machine.platform.base.kind == "planar":
        return _floor_forces(base, path, step, extra)
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


def _floor_forces(base: BaseParameters, path: States, step: float, extra: Array | None) -> Array:
    """As `base_forces`, of x, y and heading h with S = R(h) m r:

    m x" - S_y h" - S_x h'^2 = F_x,  m y" + S_x h" - S_y h'^2 = F_y,  J h" + S_x y" - S_y x" = T.
    """
    machine = base.machine
    rate, position = path.rate[0], path.position[0]
    change = (rate[:, 1:] - rate[:, :-1]) / step - (0.0 if extra is None else extra)
    # what a slope of the floor pulls with grows with mass and m r as what accelerates does
    felt = change - np.array([*machine.model.opt.gravity[:2], 0.0])
    x, y, h = np.moveaxis(felt, -1, 0)
    heading = 0.5 * (position[:, :-1, 2] + position[:, 1:, 2])
    spin = np.square(0.5 * (rate[:, :-1, 2] + rate[:, 1:, 2]))
    none = np.zeros_like(x)
    columns = {
        "mass": (-x, -y, none),
        "Jzz": (none, none, -h),
    }
    axes = (np.cos(heading), np.sin(heading)), (-np.sin(heading), np.cos(heading))
    for name, (across, along) in zip(("mr_x", "mr_y"), axes, strict=True):
        columns[name] = (
            along * h + across * spin,
            -across * h + along * spin,
            along * x - across * y,
        )
    force = np.zeros((*x.shape, machine.model.nv, len(base.names)))
    for place, name in enumerate(base.names):
        if name in columns:
            force[:, :, machine.base_dof, place] = np.stack(columns[name], axis=-1)
    if base.joints:
        force[..., -len(base.joints) :] += joint_forces(base.joints, machine, path)
    return force
