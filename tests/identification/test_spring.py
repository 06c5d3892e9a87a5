"""A torsion or bifilar pendulum: an upright hinge with a spring, on which J has no scale."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin.diagnosis import diagnose
from twin.identification import identify
from twin.identification.start import momentum_fit
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.base import base_parameters
from twin.predict.logs import motion_of
from twin.recording import Recording, Series
from twin.report import identified

XML = """
<mujoco model="torsion">
  <option timestep="0.0025" integrator="RK4" gravity="0 0 -9.81">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body name="disc" pos="0 0 1">
      <joint name="wire" type="hinge" axis="0 0 1" stiffness="0.8" damping="0.01"/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.05 0.05 0.09"/>
    </body>
  </worldbody>
</mujoco>
"""

TOML = """
name = "torsion"
title = "Disc on a wire"
[simulation]
step = 0.0025
control_rate = 200.0
[base]
kind = "hinge"
joint = "wire"
body = "disc"
[mass_properties]
mass = 5.0
inertia = [0.05, 0.05, 0.09, 0.0, 0.0, 0.0]
center_of_mass_offset = [0.0, 0.0, 0.0]
[sensors.joint_angle]
rate = 200.0
noise = 1e-3
"""


@pytest.fixture(scope="module")
def torsion(tmp_path_factory) -> Platform:
    folder: Path = tmp_path_factory.mktemp("machines") / "torsion"
    folder.mkdir()
    (folder / "platform.xml").write_text(XML, encoding="utf-8")
    (folder / "platform.toml").write_text(TOML, encoding="utf-8")
    return load_platform(str(folder))


def swung(machine: Platform, seed: int, friction: float = 0.0) -> Recording:
    """Let go at 0.7 rad, for 12 s; integrated by plain MuJoCo, with dry friction [N m]."""
    print("seed", seed)
    rng = np.random.default_rng(seed)
    model = compile_model(machine).model
    data = mujoco.MjData(model)
    data.qpos[0] = 0.7
    angle = np.empty(2400)
    for step in range(len(angle)):
        angle[step] = data.qpos[0]
        data.qfrc_applied[0] = -friction * np.tanh(data.qvel[0] / 1e-3)
        mujoco.mj_step(model, data)
    noise = rng.normal(0.0, 1e-3, angle.shape)
    series = Series(
        model.opt.timestep * np.arange(len(angle)), (angle + noise)[:, None], ("wire",), "rad"
    )
    return Recording({"joint_angle": series}, {"platform": "torsion"})


def test_the_momentum_balance_knows_the_spring_of_the_hinge(torsion):
    log, machine = swung(torsion, 1), compile_model(torsion)
    free = base_parameters(machine, torque=True)
    found = momentum_fit([(log, motion_of(log, torsion))], free)
    assert found.theta[0] == pytest.approx(0.09, rel=0.05), "without its torque J would be 0"


def test_without_a_known_torque_j_keeps_its_stated_size_and_the_rest_is_sure(torsion):
    found = identify([swung(torsion, 2)], torsion)
    assert found.base.names == ("damping of wire", "stiffness of wire")
    damping, stiffness = found.theta
    assert damping == pytest.approx(0.01, abs=float(found.half_widths[0]))
    assert stiffness == pytest.approx(0.8, abs=float(found.half_widths[1]))
    assert (found.half_widths < [1e-3, 1e-2]).all()
    text = "\n".join(identified(found))
    assert "J     0.09 (as stated) kg m^2 about the axis" in text
    assert "it is that of the stated J" in text


def test_dry_friction_of_a_spring_hinge_is_the_only_cause_and_sized_within_its_interval(torsion):
    """Seed 4 led to a drift of the only clock, which is a change of the wire's stiffness."""
    found = diagnose([swung(torsion, 4, friction=4e-3)], torsion)
    (cause,) = found.causes
    assert cause.effect.name == "bearing_coulomb_friction"
    assert cause.half_widths[0] < 4e-4
    assert abs(cause.effect.torque_size - 4e-3) < 1.5 * cause.half_widths[0]
    assert (
        "the only clock of logs that nothing drives" in found.not_asked["clock_drift:joint_angle"]
    )
