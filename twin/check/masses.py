"""Does the MJCF, as compiled, weigh and turn as platform.toml states?"""

import copy
import dataclasses

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.check.finding import Finding, compare
from twin.model import MassProperties, mass_properties, set_mass_properties
from twin.platform import Platform

Array = NDArray[np.float64]


def check_masses(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """Mass budget by body, then mass, J and m r about the CR of the whole as its file has it."""
    stages = {stage.name: stage.mass for stage in platform.stages}
    findings: list[Finding] = []
    for body in _floating(model, platform):
        name, mass = model.body(body).name or f"body {body}", float(model.body_mass[body])
        findings.append(Finding(f"{name} mass", True, None, mass, "kg"))
    for name, mass in stages.items():
        found = mass_properties(model, int(model.jnt_bodyid[model.joint(name).id])).mass
        findings.append(
            compare(
                f"{name} mass that slides",
                mass,
                found,
                "kg",
                f"what slides on joint {name!r} of the MJCF weighs {found:g} kg",
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


def check_whole(platform: Platform, found: MassProperties, what: str) -> list[Finding]:
    """Total mass, J and m r about the CR against those that `platform` states."""
    remedy = f"mend the <inertial> of {platform.base.body!r} or mass_properties in platform.toml"
    return [
        compare(
            f"{what}: floating mass",
            platform.mass,
            found.mass,
            "kg",
            f"the bodies that float add up to {found.mass:.9g} kg; {remedy}",
        ),
        compare(
            f"{what}: J about the CR",
            _six(platform.inertia),
            _six(found.inertia),
            "kg m^2",
            f"the inertia (xx yy zz xy xz yz, wheels locked, stages at 0) differs; {remedy}",
        ),
        compare(
            f"{what}: m r",
            platform.center_of_mass_offset,
            found.center_of_mass_offset,
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
    found = mass_properties(model, int(model.jnt_bodyid[joint]))
    spin = float(axis @ found.inertia @ axis)
    across = np.eye(3) - np.outer(axis, axis)
    transverse = 0.5 * (np.trace(found.inertia) - spin)
    uneven = found.inertia - spin * np.outer(axis, axis) - transverse * across
    off_axis = across @ found.center_of_mass_offset
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
