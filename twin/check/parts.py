"""Joints, actuators, sites and masses of the MJCF, compared with platform.toml."""

import copy
import dataclasses

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.check.finding import Finding, choose, compare, judge
from twin.model import STAGE_GROUP, MassProperties, mass_properties, set_mass_properties
from twin.platform import Platform, Stage


def check_sites(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """Their limits, and a coil's force for a moment of 1 A m^2."""
    findings = [
        _range(model, thruster.name, 0.0, thruster.force_limit, "N")
        for thruster in platform.thrusters
    ]
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    anchor = data.xanchor[model.joint(platform.base.joint).id]
    for coil in platform.magnetorquers:
        findings.append(_range(model, coil.name, -coil.dipole_limit, coil.dipole_limit, "A m^2"))
        arm = float(np.linalg.norm(data.site_xpos[model.site(coil.name).id] - anchor))
        findings.append(
            compare(
                f"{coil.name} gear times arm",
                platform.magnetic_field,
                model.actuator_gear[model.actuator(coil.name).id, :3] * arm,
                "T",
                f"actuator {coil.name!r} of the MJCF must have the magnetic field over the site's "
                f"distance of {arm:g} m as its gear, or the viewer turns the body otherwise",
            )
        )
    return findings


def _range(model: mujoco.MjModel, name: str, low: float, high: float, unit: str) -> Finding:
    row = model.actuator(name).id
    result = model.actuator_ctrlrange[row] if model.actuator_ctrllimited[row] else (-np.inf, np.inf)
    return compare(
        f"{name} range",
        [low, high],
        result,
        unit,
        f"actuator {name!r} of the MJCF has another ctrlrange than platform.toml's limit",
    )


def check_joints(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """Every joint that platform.toml names: is it there, of the right type, on the bus?"""
    base = platform.base
    turning = (*platform.wheels, *platform.rotors, *platform.gimbals)
    roles = {
        base.joint: base.kind,
        **dict(zip(base.planar, ("slide", "slide", "hinge"), strict=bool(base.planar))),
        **{part.name: "hinge" for part in turning},
        **{stage.name: "slide" for stage in platform.stages},
    }
    return [_joint(platform, model, name, kind) for name, kind in roles.items()]


def check_parts(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """Strange joints, axes, travel, motors and their ranges, given that the joints are right."""
    findings = [
        _nothing_else_moves(platform, model),
        _axes(platform),
        _body_frame(platform, model),
        *(_travel(model, stage) for stage in platform.stages),
        *(_motor(model, wheel.name, wheel.name, wheel.torque_limit) for wheel in platform.wheels),
    ]
    base = platform.base
    findings += check_sites(platform, model)
    if base.actuator is not None:
        findings.append(_motor(model, base.actuator, base.joint, base.torque_limit))
    return [*findings, _nothing_else_drives(platform, model)]


def _joint(platform: Platform, model: mujoco.MjModel, name: str, kind: str) -> Finding:
    row = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if row < 0:
        known = choose([model.joint(i).name for i in range(model.njnt)])
        return judge(
            f"joint {name}", False, kind, None, "", f"the MJCF has no joint {name!r}, only {known}"
        )
    result = mujoco.mjtJoint(model.jnt_type[row]).name.removeprefix("mjJNT_").lower()
    if result != kind:
        return judge(
            f"joint {name}",
            False,
            kind,
            result,
            "",
            f"joint {name!r} of the MJCF is a {result} joint; it must be a {kind} joint",
        )
    body, bus = int(model.jnt_bodyid[row]), platform.base.body
    if name in platform.base.planar:
        return Finding(f"joint {name}", True, kind, kind)
    if name == platform.base.joint:
        return judge(
            f"joint {name}",
            model.body(body).name == bus,
            f"{kind} on {bus}",
            f"{kind} on {model.body(body).name}",
            "",
            f"joint {name!r} of the MJCF carries another body than {bus!r}; change base.body",
        )
    carrier = _carriers(model, body)
    return judge(
        f"joint {name}",
        bus in carrier,
        f"{kind} on {bus}",
        f"{kind} on {carrier[0]}",
        "",
        f"joint {name!r} of the MJCF does not hang on {bus!r}; put its body inside it",
    )


def _carriers(model: mujoco.MjModel, body: int) -> list[str]:
    names: list[str] = []
    while body > 0:
        body = int(model.body_parentid[body])
        names.append(model.body(body).name)
    return names


def _nothing_else_moves(platform: Platform, model: mujoco.MjModel) -> Finding:
    parts = (*platform.wheels, *platform.stages, *platform.gimbals, *platform.rotors)
    known = {part.name for part in parts} | {platform.base.joint, *platform.base.planar}
    strange = [
        model.joint(i).name or f"unnamed on {model.body(model.jnt_bodyid[i]).name}"
        for i in range(model.njnt)
        if model.joint(i).name not in known
    ]
    return judge(
        "nothing else moves",
        not strange,
        "none",
        choose(strange),
        "",
        f"platform.toml does not know these joints of the MJCF: {choose(strange)}; "
        "state them as wheels, rotors, gimbals or stages, or take them out",
    )


def _axes(platform: Platform) -> Finding:
    """MuJoCo scales axes to length 1 in silence, so the file itself is looked at."""
    spec = mujoco.MjSpec.from_file(str(platform.model_path))
    lengths = {joint.name: float(np.linalg.norm(joint.axis)) for joint in spec.joints}
    wrong = {name: length for name, length in lengths.items() if abs(length - 1.0) > 1e-9}
    worst = max(lengths.values(), key=lambda length: abs(length - 1.0))
    listed = ", ".join(f"{name!r} {length:g}" for name, length in wrong.items())
    return judge(
        "length of joint axes",
        not wrong,
        1.0,
        worst,
        "",
        f"these joint axes of the MJCF are no unit vectors: {listed}; scale them to length 1, "
        "or a mistyped component goes unseen",
    )


def _body_frame(platform: Platform, model: mujoco.MjModel) -> Finding:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bus, joint = model.body(platform.base.body).id, model.joint(platform.base.joint).id
    turn = data.xmat[bus] - np.eye(3).ravel()
    offset = data.xanchor[joint] - data.xpos[bus]
    return compare(
        f"{platform.base.body} frame off CR, off level",
        [0.0, 0.0],
        [float(np.max(np.abs(offset))), float(np.max(np.abs(turn)))],
        "m, 1",
        f"the frame of body {platform.base.body!r} must have its origin at the base joint and "
        "stand parallel to the room's at qpos0",
    )


def _travel(model: mujoco.MjModel, stage: Stage) -> Finding:
    joint = model.joint(stage.name).id
    return compare(
        f"{stage.name} travel",
        stage.travel,
        model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf),
        "m",
        f"joint {stage.name!r} of the MJCF has another range; give both the real travel",
    )


def _motor(model: mujoco.MjModel, name: str, joint: str, limit: float) -> Finding:
    check = f"{name} torque range"
    row = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
    if row < 0:
        return judge(check, False, limit, None, "N m", f"the MJCF has no actuator named {name!r}")
    plain = (
        model.actuator_trntype[row] == mujoco.mjtTrn.mjTRN_JOINT
        and model.actuator_trnid[row, 0] == model.joint(joint).id
        and model.actuator_dyntype[row] == mujoco.mjtDyn.mjDYN_NONE
        and model.actuator_gaintype[row] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[row] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_gainprm[row, 0] * model.actuator_gear[row, 0] == 1.0
        and model.actuator_group[row] != STAGE_GROUP
    )
    if not plain:
        return judge(
            check,
            False,
            f"motor on {joint}",
            "another actuator",
            "",
            f'actuator {name!r} of the MJCF must be <motor joint="{joint}"> of gear 1, '
            f"not in group {STAGE_GROUP}",
        )
    result = model.actuator_ctrlrange[row] if model.actuator_ctrllimited[row] else (-np.inf, np.inf)
    if np.isinf(limit) and not np.all(np.isfinite(result)):
        return Finding(check, True, None, "unlimited", "")
    return compare(
        check,
        [-limit, limit],
        result,
        "N m",
        f"actuator {name!r} of the MJCF has another ctrlrange than the torque limit",
    )


def _nothing_else_drives(platform: Platform, model: mujoco.MjModel) -> Finding:
    driven = (*platform.wheels, *platform.magnetorquers, *platform.thrusters)
    motors = {part.name for part in driven} | {platform.base.actuator}
    shown = (*platform.stages, *platform.gimbals, *platform.rotors)
    prescribed = {model.joint(part.name).id for part in shown}
    strange = [
        model.actuator(i).name or f"unnamed actuator {i}"
        for i in range(model.nu)
        if model.actuator(i).name not in motors
        and not (
            model.actuator_group[i] == STAGE_GROUP
            and model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
            and int(model.actuator_trnid[i, 0]) in prescribed
        )
    ]
    return judge(
        "nothing else drives",
        not strange,
        "none",
        choose(strange),
        "",
        f"platform.toml does not know these actuators of the MJCF: {choose(strange)}; take them "
        f"out (the servos of the viewer's sliders, on stages, gimbals and rotors, belong in group "
        f"{STAGE_GROUP})",
    )


Array = NDArray[np.float64]


def check_masses(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """Mass budget by body, then mass, J and m r about the CR of the whole as its file has it."""
    stages = {stage.name: stage.mass for stage in platform.stages}
    findings: list[Finding] = []
    for body in _floating(model, platform):
        name, mass = model.body(body).name or f"body {body}", float(model.body_mass[body])
        findings.append(Finding(f"{name} mass", True, None, mass, "kg"))
    for name, mass in stages.items():
        result = mass_properties(model, int(model.jnt_bodyid[model.joint(name).id])).mass
        findings.append(
            compare(
                f"{name} mass that slides",
                mass,
                result,
                "kg",
                f"what slides on joint {name!r} of the MJCF weighs {result:g} kg",
            )
        )
    for wheel in (*platform.wheels, *platform.rotors):
        findings += _wheel(model, wheel.name, wheel.inertia)
    whole = check_whole(platform, mass_properties(model, model.body(platform.base.body).id), "MJCF")
    wrong = [number for number, finding in enumerate(whole) if not finding.ok]
    if wrong:
        first = whole[wrong[0]]  # one line mends them all
        sentence = f"{first.sentence}; {_mended(platform, model)}"
        whole[wrong[0]] = dataclasses.replace(first, sentence=sentence)
    return findings + whole


def check_whole(platform: Platform, properties: MassProperties, what: str) -> list[Finding]:
    """Total mass, J and m r about the CR against those that `platform` states."""
    remedy = f"mend the <inertial> of {platform.base.body!r} or mass_properties in platform.toml"
    return [
        compare(
            f"{what}: floating mass",
            platform.mass,
            properties.mass,
            "kg",
            f"the bodies that float add up to {properties.mass:.9g} kg; {remedy}",
        ),
        compare(
            f"{what}: J about the CR",
            _six(platform.inertia),
            _six(properties.inertia),
            "kg m^2",
            f"the inertia (xx yy zz xy xz yz, wheels locked, stages at 0) differs; {remedy}",
        ),
        compare(
            f"{what}: m r",
            platform.center_of_mass_offset,
            properties.center_of_mass_offset,
            "kg m",
            f"the mass moment from CR to CM differs; {remedy}",
        ),
    ]


def _mended(platform: Platform, model: mujoco.MjModel) -> str:
    """The line of the MJCF with which the whole is as stated."""
    body = platform.base.body
    stated = MassProperties(platform.mass, platform.inertia, platform.center_of_mass_offset)
    model = copy.copy(model)
    row = int(model.body(body).id)
    try:
        set_mass_properties(model, row, stated)
    except ValueError as problem:
        return f"no <inertial> of {body!r} gives what is stated: {problem}"
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, model.body_iquat[row])
    frame = turned.reshape(3, 3)
    inertia = frame @ np.diag(model.body_inertia[row]) @ frame.T
    return (
        f'for what is stated there, it is <inertial mass="{_digits(model.body_mass[row])}" '
        f'pos="{_digits(*model.body_ipos[row])}" fullinertia="{_digits(*_six(inertia))}"/>'
    )


def _digits(*numbers: float) -> str:
    # more than the check asks for, and few enough to hide how a sum was rounded
    return " ".join(f"{number:.12g}" for number in numbers)


def _wheel(model: mujoco.MjModel, name: str, inertia: float) -> list[Finding]:
    joint = model.joint(name).id
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axis = data.xaxis[joint]
    properties = mass_properties(model, int(model.jnt_bodyid[joint]))
    spin = float(axis @ properties.inertia @ axis)
    across = np.eye(3) - np.outer(axis, axis)
    transverse = 0.5 * (np.trace(properties.inertia) - spin)
    uneven = properties.inertia - spin * np.outer(axis, axis) - transverse * across
    off_axis = across @ properties.center_of_mass_offset
    return [
        compare(
            f"{name} spin inertia",
            inertia,
            spin,
            "kg m^2",
            f"body {name!r} of the MJCF has {spin:g} kg m^2 about its joint's axis",
        ),
        compare(
            f"{name} imbalance, armature",
            [0.0, 0.0, 0.0],
            [
                float(np.linalg.norm(off_axis)),
                float(np.max(np.abs(uneven))),
                float(model.dof_armature[model.jnt_dofadr[joint]]),
            ],
            "kg m, kg m^2, kg m^2",
            f"wheel {name!r} of the MJCF must have its CM on its axis, equal moments across it and "
            "no joint armature (which takes no part in the body's own rotation)",
        ),
    ]


def _floating(model: mujoco.MjModel, platform: Platform) -> list[int]:
    bus = model.body(platform.base.body).id
    carried = [bus]
    for body in range(bus + 1, model.nbody):
        if int(model.body_parentid[body]) in carried:
            carried.append(body)
    return carried


def _six(tensor: Array) -> Array:
    return tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
