"""Where the stop touches, what the default step costs in accuracy, what else the MJCF does.

What acts in the MJCF without a part in platform.toml: fluid, ties, springs, damping.
A fluid, a tie or a body without weight belongs to no machine of this kind, and is wrong. What
brakes or holds a joint belongs to the machine where it is stated; platform.toml does not have it,
so the check shows it.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.check.finding import Finding, judge
from twin.model import Machine, compile_model
from twin.platform import Platform

Array = NDArray[np.float64]

TILT_TOLERANCE = np.deg2rad(0.1)
"""Directions may differ by that much [rad]: a ring made of segments is no circle."""
STEP_TIME = 60.0
"""[s]."""
STEP_ERROR = np.deg2rad(1e-4)
"""Largest attitude error that the default step may add in STEP_TIME [rad]."""
_DIRECTIONS = 12


def check_stop(platform: Platform, model: mujoco.MjModel) -> list[Finding]:
    """Lean the machine in twelve directions, each at another yaw, until something touches."""
    if platform.base.kind != "ball":
        return []
    angles = [_first_contact(platform, model, number) for number in range(_DIRECTIONS)]
    low, high, stated = min(angles), max(angles), platform.stop_angle
    if np.isinf(stated):
        return [
            judge(
                "no tilt stop",
                bool(np.isinf(low)),
                "none",
                "none" if np.isinf(low) else f"touches at {np.rad2deg(low):.3g} deg",
                "",
                "the MJCF has a tilt stop; add [tilt_stop] angle to platform.toml",
            )
        ]
    kind = "tilt" if platform.pitch_stop is None else "pitch"
    degrees = np.rad2deg([low, high, stated])
    meets = (
        f"touches between {degrees[0]:.4g} and {degrees[1]:.4g} deg of {kind}"
        if np.isfinite(high)
        else "tilts in some direction until it is upside down, and nothing touches"
        if kind == "tilt"
        else "lets its axis stand upright, and nothing touches"
    )
    return [
        judge(
            f"{kind} stop, any direction",
            max(stated - low, high - stated) <= TILT_TOLERANCE,
            [stated, stated],
            [low, high],
            "rad",
            f"the MJCF {meets}, platform.toml says {degrees[2]:.4g} deg; mend the contact pair or "
            f"{kind}_stop.angle",
        )
    ]


def _first_contact(platform: Platform, model: mujoco.MjModel, number: int) -> float:
    """Smallest lean [rad] in a numbered direction at which anything touches; inf without one.

    With a pitch stop the axis goes up or down, each time at another roll.
    """
    azimuth = number * (2.0 * np.pi / _DIRECTIONS)
    data = mujoco.MjData(model)
    start = int(model.jnt_qposadr[model.joint(platform.base.joint).id])
    turned = rotation.from_rotation_vector(np.array([0.0, 0.0, 2.4 * azimuth]))
    across, furthest = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]), np.pi
    if platform.pitch_stop is not None:
        axis, furthest = platform.pitch_stop.axis, 0.5 * np.pi
        across = (-1.0) ** number * np.cross([0.0, 0.0, 1.0], rotation.rotate(turned, axis))
        turned = rotation.multiply(turned, rotation.from_rotation_vector(azimuth * axis))

    def touches(angle: float) -> bool:
        lean = rotation.from_rotation_vector(angle * across)
        data.qpos[start : start + 4] = rotation.multiply(lean, turned)
        mujoco.mj_fwdPosition(model, data)
        return bool(np.any(data.contact.dist[: data.ncon] <= 0.0))

    coarse = np.linspace(0.0, furthest, 181)
    hit = next((i for i, angle in enumerate(coarse) if touches(float(angle))), None)
    if hit is None:
        return np.inf
    if hit == 0:
        return 0.0
    free, touching = float(coarse[hit - 1]), float(coarse[hit])
    for _ in range(40):
        middle = 0.5 * (free + touching)
        free, touching = (free, middle) if touches(middle) else (middle, touching)
    return touching


def check_step(platform: Platform) -> list[Finding]:
    """Run at the default step and at half of it; the difference is the default step's error."""
    machine = compile_model(platform)
    machine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    whole, half = _fly(machine, 1), _fly(machine, 2)
    if platform.base.kind != "hinge":
        angle = rotation.to_rotation_vector(
            rotation.multiply(rotation.conjugate(half[0]), whole[0])
        )
    else:
        angle = whole[0] - half[0]
    attitude, rate = float(np.linalg.norm(angle)), float(np.max(np.abs(whole[1] - half[1])))
    span = f"{platform.step:g} s steps"
    return [
        judge(
            f"{platform.name}: attitude error of {span}",
            attitude <= STEP_ERROR,
            STEP_ERROR,
            attitude,
            "rad",
            f"halving the step changes the attitude by {np.rad2deg(attitude):.3g} deg in "
            f"{STEP_TIME:g} s; choose a smaller simulation.step",
        ),
        Finding(f"{platform.name}: rate error of {span}", True, None, rate, "rad/s"),
    ]


def _fly(machine: Machine, halvings: int) -> tuple[Array, Array]:
    """Base position and rate after STEP_TIME from a tilted, turning start, wheels half spun up.

    The wheels' torques are sines held over a control tick, gimbals turn slowly; contacts are off.
    """
    platform, model = machine.platform, machine.model
    model.opt.timestep = platform.step / halvings
    data = mujoco.MjData(model)
    momentum = np.array([wheel.momentum_limit for wheel in platform.wheels])
    limit = np.array([wheel.torque_limit for wheel in platform.wheels])
    speed = np.array([wheel.speed_limit for wheel in platform.wheels])
    frequency = 0.5 + 0.4 * np.arange(len(limit))  # [rad/s]
    amplitude = np.minimum(0.2 * limit, 0.1 * momentum * frequency)
    if platform.base.kind != "hinge":
        data.qpos[machine.base_qpos] = rotation.from_rotation_vector(np.array([0.1, 0.05, 0.0]))
        data.qvel[machine.base_dof] = (0.1, -0.05, 0.08)
    else:
        data.qpos[machine.base_qpos] = 1.0
    data.qvel[machine.wheel_dof] = 0.5 * speed
    data.qvel[machine.rotor_dof] = [rotor.speed for rotor in platform.rotors]
    data.qpos[machine.gimbal_qpos] = [gimbal.home for gimbal in platform.gimbals]
    data.qvel[machine.gimbal_dof] = [min(0.1, gimbal.rate) for gimbal in platform.gimbals]
    for tick in range(round(STEP_TIME / platform.tick)):
        data.ctrl[machine.wheel_actuator] = amplitude * np.sin(frequency * tick * platform.tick)
        mujoco.mj_step(model, data, platform.steps_per_tick * halvings)
    return data.qpos[machine.base_qpos].copy(), data.qvel[machine.base_dof].copy()


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
    stated = [
        f"{model.joint(joint).name} {', '.join(terms)}"
        for joint in range(model.njnt)
        if model.joint(joint).name not in prescribed and (terms := _terms(model, joint))
    ]
    return Finding("damping, springs, friction of joints", True, None, "; ".join(stated) or "none")


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
