"""Do the actuators that act on sites, thrusters and magnetorquers, give what is stated?"""

import mujoco
import numpy as np

from twin.check.finding import Finding, compare
from twin.platform import Platform


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
    found = model.actuator_ctrlrange[row] if model.actuator_ctrllimited[row] else (-np.inf, np.inf)
    return compare(
        f"{name} range",
        [low, high],
        found,
        unit,
        f"actuator {name!r} of the MJCF has another ctrlrange than platform.toml's limit",
    )
