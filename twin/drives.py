"""What a compiled model needs for its parts to be driven as the machine's are.

Prescribed joints, coils that feel the field, joints that stand still, and the masses and skews that
a variant of a platform states otherwise than the MJCF.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.errors import PlatformError
from twin.platform import Platform
from twin.platform.mjcf import load_mjcf

Index = NDArray[np.intp]

PRESCRIBED_ARMATURE = 1e13
"""Joint armature [kg or kg m^2] of a prescribed joint: what pushes back on it moves it by parts in
10^13, so the acceleration fed in through qfrc_applied is the acceleration it has. At 1e11 the push
of gravity alone moves 2e-10 of the momentum about the vertical."""


def floating(model: mujoco.MjModel, base_body: int) -> Index:
    """Ids of the base body and everything it carries."""
    carried = {base_body}
    for body in range(base_body + 1, model.nbody):
        if int(model.body_parentid[body]) in carried:
            carried.add(body)
    return np.array(sorted(carried), dtype=np.intp)


def weigh_stages(platform: Platform, model: mujoco.MjModel) -> None:
    """Give what slides the mass that is stated: a variant may have other masses than the MJCF."""
    joints = {stage.name: model.joint(stage.name).id for stage in platform.stages}
    carried = {
        name: float(model.body_subtreemass[model.jnt_bodyid[joint]])
        for name, joint in joints.items()
    }
    for stage in platform.stages:
        body = int(model.jnt_bodyid[joints[stage.name]])
        change = stage.mass - carried[stage.name]
        for other in platform.stages:
            on_top = int(model.jnt_bodyid[joints[other.name]])
            if other is not stage and on_top in floating(model, body):
                change -= other.mass - carried[other.name]
        if abs(change) > 1e-9 * stage.mass:
            factor = 1.0 + change / model.body_mass[body]
            model.body_mass[body] *= factor
            model.body_inertia[body] *= factor


def skew_gimbals(platform: Platform, model: mujoco.MjModel) -> None:
    """Turn each gimbal's body about the axis of what spins on it, by its skew."""
    if not any(gimbal.skew for gimbal in platform.gimbals):
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for gimbal in platform.gimbals:
        body = int(model.jnt_bodyid[model.joint(gimbal.name).id])
        spin = next(p for p in (*platform.wheels, *platform.rotors) if p.gimbal == gimbal.name)
        local = data.xmat[body].reshape(3, 3).T @ data.xaxis[model.joint(spin.name).id]
        turn = rotation.from_rotation_vector(gimbal.skew * local)
        model.body_quat[body] = rotation.multiply(model.body_quat[body], turn)
    mujoco.mj_setConst(model, data)


def apply_field(platform: Platform, model: mujoco.MjModel, torquers: list[int]) -> None:
    """Make each coil's control its moment [A m^2].

    A force F fixed in the room, at the coil's site p, turns the body with p x R^T F; for p along
    the coil's axis and F = B / |p| per unit of control that is the torque m x B, exact at every
    stage of RK4. The bearing takes the force.
    """
    if not torquers:
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    anchor = data.xanchor[model.joint(platform.base.joint).id]
    for actuator in torquers:
        site, room = model.actuator_trnid[actuator]
        floats = platform.base.planar or platform.base.kind == "free"
        if room < 0 or model.site_bodyid[room] != 0 or floats:
            raise PlatformError(
                platform.model_path,
                f"magnetorquer {model.actuator(actuator).name!r} needs a bearing that stands in "
                "the room, and an actuator whose refsite is a site of the worldbody, along its "
                "axes",
                'write <general site="..." refsite="room" gear="0 0 1 0 0 0"/>',
            )
        distance = float(np.linalg.norm(data.site_xpos[site] - anchor))
        model.actuator_gear[actuator, :3] = platform.magnetic_field / distance


def heading_inertia(platform: Platform) -> float:
    """Of what turns with the heading of a planar stage below the ball [kg m^2]."""
    model = load_mjcf(platform.model_path, visuals=False)
    return float(model.dof_M0[model.joint(platform.base.planar[2]).dofadr[0]])


def travelling_mass(platform: Platform) -> float:
    """Of all that moves with the CR of a base that travels, a planar stage too [kg]."""
    if not platform.base.planar:
        return platform.mass
    model = load_mjcf(platform.model_path, visuals=False)
    slides, carried = (
        float(model.body_subtreemass[model.jnt_bodyid[model.joint(name).id]])
        for name in (platform.base.planar[0], platform.base.joint)
    )
    return slides - carried + platform.mass


def lock_joints(platform: Platform, model: mujoco.MjModel) -> None:
    """Joints that stand still; a locked ball carries the heading's inertia about its z."""
    base = platform.base
    for name in base.locked:
        joint = model.joint(name).id
        dof = int(model.jnt_dofadr[joint])
        if name != base.joint:
            model.dof_armature[dof] = PRESCRIBED_ARMATURE
            continue
        model.dof_armature[dof : dof + 3] = PRESCRIBED_ARMATURE
        if base.planar and base.planar[2] not in base.locked:
            heading = int(model.jnt_dofadr[model.joint(base.planar[2]).id])
            model.dof_armature[dof + 2] = model.dof_M0[heading]
            model.dof_armature[heading] = PRESCRIBED_ARMATURE
