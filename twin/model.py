"""Platform -> MjModel: the only place that compiles.

The MJCF is taken as it is; then the options that this kind of machine needs are set (RK4, the
platform's step and gravity, no automatic reset), stages become prescribed joints, and the bus is
given the inertial that makes the whole machine's mass properties those that platform.toml states,
whatever bodies its effects add.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.drives import (
    PRESCRIBED_ARMATURE,
    apply_field,
    floating,
    heading_inertia,
    lock_joints,
    skew_gimbals,
    weigh_stages,
)
from twin.effects import BodyEffect, Effect, effects_of
from twin.errors import PlatformError
from twin.platform import Platform
from twin.platform.mjcf import load_mjcf

# MuJoCo would write each motion that diverges, also those that a fit tries and gives up, to stderr
# and to a file where the user stands; who asked for the motion is told by us
mujoco.set_mju_user_warning(lambda _: None)

Array = NDArray[np.float64]
Index = NDArray[np.intp]

STAGE_GROUP = 1
"""Actuator group of the stages' position servos: they serve MuJoCo's viewer, not the simulation."""


class Named(Protocol):
    """A part with the name of its joint or actuator in the MJCF."""

    @property
    def name(self) -> str:
        """The name."""
        ...


@dataclass(frozen=True)
class MassProperties:
    """Of everything that floats, about the CR, in body axes."""

    mass: float
    """[kg]."""
    inertia: Array
    """(3, 3) [kg m^2], wheels locked, stages at 0."""
    center_of_mass_offset: Array
    """(3,) m r from CR to CM [kg m]."""


@dataclass(frozen=True)
class Sliding:
    """The bodies that ride on stages; one on stacked stages rides on all of them."""

    mass: Array
    """(bodies,) [kg]."""
    home: Array
    """(bodies, 3) centre of mass with the stages at 0, from the CR, body axes [m]."""
    travel: Array
    """(bodies, stages, 3) how it moves with each stage's position, body axes."""


@dataclass(frozen=True)
class Machine:
    """A compiled platform and where its parts stand in MuJoCo's arrays."""

    platform: Platform
    model: mujoco.MjModel
    base_body: int
    base_qpos: slice
    base_dof: slice
    wheel_dof: Index
    wheel_actuator: Index
    stage_qpos: Index
    stage_dof: Index
    gimbal_qpos: Index
    gimbal_dof: Index
    rotor_dof: Index
    magnetorquer_actuator: Index
    thruster_actuator: Index
    """Empty on a base that does not float away: there thrusters are a torque on the body."""
    place_qpos: Index
    """Of the CR in the room: x, y of a planar stage, x, y, z of a free base; else empty."""
    place_dof: Index
    heading_qpos: Index
    """Of a planar stage; empty without one."""
    sliding: Sliding
    joint_actuator: int | None
    effects: tuple[Effect, ...]
    """Those of the platform."""

    @property
    def stage_inertia(self) -> Array:
        """(stages,) force per acceleration of each prescribed joint [kg]."""
        masses = np.array([stage.mass for stage in self.platform.stages])
        return self.model.dof_armature[self.stage_dof] + masses

    @property
    def gimbal_inertia(self) -> Array:
        """(gimbals,) torque per acceleration of each prescribed joint [kg m^2]."""
        return self.model.dof_M0[self.gimbal_dof]


def compile_model(platform: Platform) -> Machine:
    """Compile a platform.

    Raises:
        PlatformError: MuJoCo refuses the MJCF, a named part is missing, or the stated mass
            properties leave no physical bus.
        EffectError: it has an effect that it cannot have.
    """
    effects = effects_of(platform)
    on_body = [effect for effect in effects if isinstance(effect, BodyEffect)]
    edits = [partial(effect.edit_spec, platform=platform) for effect in on_body]
    base = platform.base
    if base.falls:
        edits.append(partial(_turn_only, joint=base.joint))
    if base.kind == "planar":
        edits.append(partial(_turn_about_vertical, joint=base.joint, heading=base.planar[2]))
    floats = base.travels or bool(set(base.planar) - set(base.locked))
    pushing = platform.thrusters if floats else ()
    # A bearing that stands takes the others' force: a torque says the same, and a step is cheaper.
    # Each of their sites would be moved at every stage of RK4: sixteen are a twentieth of a step.
    taken_out = () if floats else tuple(thruster.name for thruster in platform.thrusters)
    model = load_mjcf(platform.model_path, visuals=False, without=taken_out, edits=edits)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = platform.step
    model.opt.gravity[:] = (0.0, 0.0, -platform.gravity)
    model.opt.magnetic[:] = platform.magnetic_field
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)  # streams come of the state
    model.opt.disableactuator |= 1 << STAGE_GROUP

    joint, actuator = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR
    base_joint = _named(platform, model, joint, base.joint)
    base_body = _named(platform, model, mujoco.mjtObj.mjOBJ_BODY, base.body)
    width = {"hinge": (1, 1), "planar": (3, 3)}.get(base.kind, (4, 3))
    qpos, dof = int(model.jnt_qposadr[base_joint]), int(model.jnt_dofadr[base_joint])
    wheels = _all(platform, model, joint, platform.wheels)
    stages = _all(platform, model, joint, platform.stages)
    gimbals = _all(platform, model, joint, platform.gimbals)
    rotors = _all(platform, model, joint, platform.rotors)
    named = base.planar[:2] if base.kind == "planar" else base.planar
    planar = [_named(platform, model, joint, name) for name in named]
    place_qpos, place_dof = model.jnt_qposadr[planar[:2]], model.jnt_dofadr[planar[:2]]
    if base.kind == "free":
        place_qpos, place_dof = qpos + np.arange(3), dof + np.arange(3)
        qpos, dof = qpos + 3, dof + 3
    if base.kind == "planar":
        qpos, dof = _in_a_row(platform, model, [*planar, base_joint])
    torquers = _all(platform, model, actuator, platform.magnetorquers)
    motor = None if base.actuator is None else _named(platform, model, actuator, base.actuator)

    weigh_stages(platform, model)
    skew_gimbals(platform, model)
    apply_field(platform, model, torquers)
    prescribed = model.jnt_dofadr[[*stages, *gimbals, *rotors]]
    model.dof_armature[prescribed] = PRESCRIBED_ARMATURE
    model.jnt_limited[[*stages, *gimbals, *rotors]] = False  # their drives keep to the travel
    if platform.base.kind in ("ball", "planar") and np.isinf(platform.stop_angle):
        model.opt.disableflags |= untouched(model)
    if base.locked:
        lock_joints(platform, model)
    if base.kind == "planar":
        model.dof_armature[dof + 2] += heading_inertia(platform)

    for effect in on_body:
        effect.edit_model(model, platform)
    _mark_distinct_frames(model)
    stated = MassProperties(platform.mass, platform.inertia, platform.center_of_mass_offset)
    try:
        set_mass_properties(model, base_body, stated)
    except ValueError as problem:
        raise PlatformError(
            platform.folder / "platform.toml",
            f"mass_properties of {platform.name} cannot be met: {problem}",
            "check mass, inertia and center_of_mass_offset against the parts in the MJCF",
        ) from None
    return Machine(
        platform=platform,
        model=model,
        base_body=base_body,
        base_qpos=slice(qpos, qpos + width[0]),
        base_dof=slice(dof, dof + width[1]),
        wheel_dof=_index(model.jnt_dofadr[wheels]),
        wheel_actuator=_index(_all(platform, model, actuator, platform.wheels)),
        stage_qpos=_index(model.jnt_qposadr[stages]),
        stage_dof=_index(model.jnt_dofadr[stages]),
        gimbal_qpos=_index(model.jnt_qposadr[gimbals]),
        gimbal_dof=_index(model.jnt_dofadr[gimbals]),
        rotor_dof=_index(model.jnt_dofadr[rotors]),
        magnetorquer_actuator=_index(torquers),
        thruster_actuator=_index(_all(platform, model, actuator, pushing)),
        place_qpos=_index(place_qpos),
        place_dof=_index(place_dof),
        heading_qpos=_index(model.jnt_qposadr[planar[2:]]),
        sliding=_sliding(platform, model, base_body),
        joint_actuator=motor,
        effects=effects,
    )


def _turn_only(spec: mujoco.MjSpec, joint: str) -> None:
    """Leave of a free joint its turn."""
    free = spec.joint(joint)
    if free is not None:
        free.type = mujoco.mjtJoint.mjJNT_BALL


def _turn_about_vertical(spec: mujoco.MjSpec, joint: str, heading: str) -> None:
    """Leave of a ball its turn about z, and of a planar stage its slides."""
    ball, below = spec.joint(joint), spec.joint(heading)
    if ball is not None:
        ball.type = mujoco.mjtJoint.mjJNT_HINGE
        ball.axis = np.array([0.0, 0.0, 1.0])
    if below is not None:
        spec.delete(below)
    for key in list(spec.keys):  # of joints that are no more
        spec.delete(key)


def _in_a_row(platform: Platform, model: mujoco.MjModel, joints: list[int]) -> tuple[int, int]:
    """Addresses in qpos and qvel of the first of joints that follow one another.

    Raises:
        PlatformError: they do not.
    """
    if joints != list(range(joints[0], joints[0] + len(joints))):
        raise PlatformError(
            platform.model_path,
            f"has other joints between {', '.join(platform.base.planar[:2])} and "
            f"{platform.base.joint}",
            "let the ball's body come first on what slides",
        )
    return int(model.jnt_qposadr[joints[0]]), int(model.jnt_dofadr[joints[0]])


def untouched(model: mujoco.MjModel) -> int:
    """Flags for a step in which no stop is near: what contacts cost is saved.

    So is what constraints cost, where contacts are the only ones.
    """
    flags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    others = model.neq + model.ntendon + model.jnt_limited.sum() + model.dof_frictionloss.any()
    return flags if others else flags | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)


def mass_properties(model: mujoco.MjModel, base_body: int) -> MassProperties:
    """Measure what floats on `base_body` in a compiled model, at qpos0.

    Bodies are summed with the parallel-axis theorem about the base joint's anchor (the CR).
    """
    mass = model.body_mass[floating(model, base_body)]
    centers, tensors = _rigid_parts(model, base_body, _at_rest(model))
    inertia = np.sum(tensors + _parallel_axis(mass, centers), axis=0)
    return MassProperties(float(mass.sum()), inertia, mass @ centers)


def carried_properties(model: mujoco.MjModel, base_body: int) -> MassProperties:
    """Measure all that `base_body` carries, without itself, at qpos0."""
    carried = copy.copy(model)
    carried.body_mass[base_body] = 0.0
    carried.body_inertia[base_body] = 0.0
    return mass_properties(carried, base_body)


def set_mass_properties(
    model: mujoco.MjModel, base_body: int, wanted: MassProperties, *, rigid: bool = True
) -> None:
    """Give `base_body` the inertial that makes the whole equal to `wanted`; the rest stays.

    Args:
        model: is changed.
        base_body: id.
        wanted: of all that floats.
        rigid: whether its moments must keep the triangle inequality. The equations of motion are as
            good without, so a fit may pass there on its way.

    Raises:
        ValueError: what would be left for the body has no positive mass or moment of inertia.
    """
    others = floating(model, base_body) != base_body
    mass = model.body_mass[floating(model, base_body)][others]
    data = _at_rest(model)
    centers, tensors = _rigid_parts(model, base_body, data)
    centers, tensors = centers[others], tensors[others]

    body_mass = wanted.mass - mass.sum()
    if body_mass <= 0.0:
        raise ValueError(f"the other parts already weigh {mass.sum():g} kg of {wanted.mass:g} kg")
    center = (wanted.center_of_mass_offset - mass @ centers) / body_mass
    about_anchor = wanted.inertia - np.sum(tensors + _parallel_axis(mass, centers), axis=0)
    about_center = about_anchor - _parallel_axis(np.array([body_mass]), center[None])[0]
    moments, axes = np.linalg.eigh(about_center)
    broken = moments[0] + moments[1] < moments[2] * (1.0 - 1e-9)
    if moments[0] <= 0.0 or (rigid and broken):
        raise ValueError(
            f"the bus would need principal moments {moments.round(6).tolist()} kg m^2, "
            "which no rigid body has"
        )
    if np.linalg.det(axes) < 0.0:
        axes = axes * np.array([1.0, 1.0, -1.0])
    to_body = data.xmat[base_body].reshape(3, 3).T
    anchor_in_body = model.jnt_pos[model.body_jntadr[base_body]]
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, (to_body @ axes).ravel())
    model.body_mass[base_body] = body_mass
    model.body_ipos[base_body] = anchor_in_body + to_body @ center
    model.body_iquat[base_body] = quat
    model.body_inertia[base_body] = moments
    set_constants(model)


def set_constants(model: mujoco.MjModel) -> None:
    """MuJoCo's `mj_setConst`, with each body's centre of mass exactly where it is.

    MuJoCo takes one that lies within 1e-6 m of its body's origin to lie there: of 40 kg that is
    0.4 mN m, more than a balanced machine has left.
    """
    mujoco.mj_setConst(model, mujoco.MjData(model))
    _mark_distinct_frames(model)


def _mark_distinct_frames(model: mujoco.MjModel) -> None:
    turned = (model.body_iquat[:, 1:] != 0.0).any(axis=1)
    apart = turned | (model.body_ipos != 0.0).any(axis=1)
    model.body_sameframe[apart] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE


def _sliding(platform: Platform, model: mujoco.MjModel, base_body: int) -> Sliding:
    bodies: dict[int, list[int]] = {}
    for number, stage in enumerate(platform.stages):
        for body in floating(model, int(model.jnt_bodyid[model.joint(stage.name).id])):
            bodies.setdefault(int(body), []).append(number)
    rows = list(bodies)
    travel = np.zeros((len(rows), len(platform.stages), 3))
    for row, stages in enumerate(bodies.values()):
        for number in stages:
            travel[row, number] = platform.stages[number].axis
    centers = _centers(model, base_body, _at_rest(model))
    return Sliding(model.body_mass[rows].copy(), centers[rows], travel)


def _at_rest(model: mujoco.MjModel) -> mujoco.MjData:
    """Where all bodies are at qpos0."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def _rigid_parts(
    model: mujoco.MjModel, base_body: int, at_rest: mujoco.MjData
) -> tuple[Array, Array]:
    """Centres of mass from the CR (b, 3) and inertia about them (b, 3, 3), room axes at qpos0."""
    bodies = floating(model, base_body)
    frames = at_rest.ximat[bodies].reshape(-1, 3, 3)
    tensors = np.einsum("bij,bj,bkj->bik", frames, model.body_inertia[bodies], frames)
    return _centers(model, base_body, at_rest)[bodies], tensors


def _centers(model: mujoco.MjModel, base_body: int, at_rest: mujoco.MjData) -> Array:
    """Centres of mass of all bodies from the base joint's anchor, room axes at qpos0."""
    return at_rest.xipos - at_rest.xanchor[model.body_jntadr[base_body]]


def _parallel_axis(mass: Array, centers: Array) -> Array:
    """m (|r|^2 I - r r^T), shape (b, 3, 3)."""
    squared = np.einsum("bi,bi->b", centers, centers)
    outer = np.einsum("bi,bj->bij", centers, centers)
    return mass[:, None, None] * (squared[:, None, None] * np.eye(3) - outer)


def _all(
    platform: Platform, model: mujoco.MjModel, kind: mujoco.mjtObj, parts: Sequence[Named]
) -> list[int]:
    return [_named(platform, model, kind, part.name) for part in parts]


def _index(addresses: ArrayLike) -> Index:
    return np.array(addresses, dtype=np.intp)


def _named(platform: Platform, model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    result = mujoco.mj_name2id(model, kind, name)
    if result < 0:
        noun = kind.name.removeprefix("mjOBJ_").lower()
        raise PlatformError(
            platform.model_path,
            f"has no {noun} named {name!r}, which platform.toml refers to",
            "name it so in the MJCF, or change platform.toml",
        )
    return result
