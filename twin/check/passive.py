"""What acts in the MJCF without a part in platform.toml: fluid, ties, springs, damping.

A fluid, a tie or a body without weight belongs to no machine of this kind, and is wrong. What
brakes or holds a joint belongs to the machine where it is stated; platform.toml does not have it,
so the check shows it.
"""

import mujoco
import numpy as np

from twin.check.finding import Finding, judge
from twin.platform import Platform

_OFF = {
    "gravity": mujoco.mjtDisableBit.mjDSBL_GRAVITY,
    "actuation": mujoco.mjtDisableBit.mjDSBL_ACTUATION,
    "spring": mujoco.mjtDisableBit.mjDSBL_SPRING,
    "damper": mujoco.mjtDisableBit.mjDSBL_DAMPER,
    "frictionloss": mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
    "constraint": mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
}
"""Flags without which the machine moves otherwise; others are of speed, or of contacts, which the
check of the stop looks at."""

_TERMS = ("damping", "quadratic damping", "stiffness", "dry friction", "armature")
_UNITS = {
    mujoco.mjtJoint.mjJNT_SLIDE: ("N s/m", "N s^2/m^2", "N/m", "N", "kg"),
    mujoco.mjtJoint.mjJNT_HINGE: ("N m s", "N m s^2", "N m", "N m", "kg m^2"),
    mujoco.mjtJoint.mjJNT_BALL: ("N m s", "N m s^2", "N m", "N m", "kg m^2"),
    # along and about its axes alike, each in its SI unit
    mujoco.mjtJoint.mjJNT_FREE: ("",) * 5,
}


def check_foreign(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """What belongs to no machine of this kind."""
    return [
        _fluid(model),
        _ties(model),
        _weightless(model),
        _switched_off(model),
        _held_wheels(platform, model),
    ]


def passive_terms(platform: Platform, model: mujoco.MjModel) -> Finding:
    """What brakes or holds the joints that move freely, with its values; never wrong."""
    # a prescribed joint moves as its drive does, and nothing of this can be seen in it
    prescribed = {part.name for part in (*platform.stages, *platform.gimbals, *platform.rotors)}
    told = [
        f"{model.joint(joint).name} {', '.join(terms)}"
        for joint in range(model.njnt)
        if model.joint(joint).name not in prescribed and (terms := _terms(model, joint))
    ]
    return Finding("damping, springs, friction of joints", True, None, "; ".join(told) or "none")


def _terms(model: mujoco.MjModel, joint: int) -> list[str]:
    dof = int(model.jnt_dofadr[joint])
    values = (
        model.dof_damping[dof],
        model.dof_dampingpoly[dof, 0],
        model.jnt_stiffness[joint],
        model.dof_frictionloss[dof],
        model.dof_armature[dof],
    )
    units = _UNITS[mujoco.mjtJoint(model.jnt_type[joint])]
    return [
        f"{term} {value:g} {unit}".rstrip()
        for term, value, unit in zip(_TERMS, values, units, strict=True)
        if value != 0.0
    ]


def _fluid(model: mujoco.MjModel) -> Finding:
    option = model.opt
    given = {
        "density": f"{option.density:g} kg/m^3" if option.density else "",
        "viscosity": f"{option.viscosity:g} Pa s" if option.viscosity else "",
        "wind": " ".join(f"{speed:g}" for speed in option.wind) + " m/s"
        if np.any(option.wind)
        else "",
    }
    stated = [f"{name} {value}" for name, value in given.items() if value]
    names = " and ".join(name for name, value in given.items() if value)
    return judge(
        "no fluid",
        not stated,
        "none",
        ", ".join(stated) or "none",
        "",
        f"<option> of the MJCF has {names}, which brakes every body by its inertia's box and "
        "stands in no file that others read; take it out, and state the air as "
        "[effects.aerodynamic_drag] in platform.toml",
    )


def _ties(model: mujoco.MjModel) -> Finding:
    ties = [_tie(model, row) for row in range(model.neq)]
    kind = mujoco.mjtObj.mjOBJ_TENDON
    ties += [
        f"<tendon> {mujoco.mj_id2name(model, kind, row) or row!r}" for row in range(model.ntendon)
    ]
    return judge(
        "nothing ties parts together",
        not ties,
        "none",
        ", ".join(ties) or "none",
        "",
        f"the MJCF has {', '.join(ties)}: parts of an air-bearing table move on their own; take "
        "<equality> and <tendon> out (a joint that stands still is left out, or is in base.locked)",
    )


def _tie(model: mujoco.MjModel, row: int) -> str:
    what = mujoco.mjtEq(model.eq_type[row])
    kind = what.name.removeprefix("mjEQ_").lower()
    joins = mujoco.mjtObj.mjOBJ_JOINT if what == mujoco.mjtEq.mjEQ_JOINT else model.eq_objtype[row]
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, row)
    ends = [
        mujoco.mj_id2name(model, joins, int(end)) or f"number {end}"
        for end in (model.eq_obj1id[row], model.eq_obj2id[row])
        if end >= 0
    ]
    return f"<equality> {kind}{f' {name!r}' if name else ''} on {' and '.join(ends)}"


def _weightless(model: mujoco.MjModel) -> Finding:
    lifted = [
        f"{model.body(row).name or f'number {row}'} {model.body_gravcomp[row]:g}"
        for row in range(model.nbody)
        if model.body_gravcomp[row]
    ]
    return judge(
        "every body has its weight",
        not lifted,
        "none",
        ", ".join(lifted) or "none",
        "",
        f"these bodies of the MJCF have gravcomp: {', '.join(lifted)}; it takes their weight off "
        "while m r still counts them: take it out (without gravity, set environment.gravity = 0)",
    )


def _switched_off(model: mujoco.MjModel) -> Finding:
    off = [name for name, bit in _OFF.items() if model.opt.disableflags & int(bit)]
    return judge(
        "no physics switched off",
        not off,
        "none",
        ", ".join(off) or "none",
        "",
        f"{', '.join(off)}: disabled by <flag> in the MJCF, which holds for every simulation; "
        "take it out (without gravity, set environment.gravity = 0)",
    )


def _held_wheels(platform: Platform, model: mujoco.MjModel) -> Finding:
    held: list[str] = []
    for wheel in platform.wheels:
        joint = model.joint(wheel.name).id
        if model.jnt_stiffness[joint] or model.jnt_stiffnesspoly[joint].any():
            held.append(f"{wheel.name} by stiffness")
        if model.jnt_limited[joint]:
            held.append(f"{wheel.name} by range")
    return judge(
        "wheels turn freely",
        not held,
        "none",
        ", ".join(held) or "none",
        "",
        f"a joint of the MJCF holds its wheel: {', '.join(held)}; a wheel makes any number of "
        "turns: take stiffness and range out (damping and frictionloss may stay)",
    )
