"""The equation of a hinge against MuJoCo, which integrates the same machine."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.swing import Swing, Swinging

HINGE = """
<mujoco>
  <option timestep="{step}" integrator="RK4" gravity="{gravity}">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body>
      <joint name="pivot" type="hinge" axis="{axis}" armature="0.01" damping="{damping}"
             stiffness="{stiffness}" springref="{rest}" {more}/>
      <inertial pos="{place}" mass="0.7" diaginertia="0.02 0.03 0.04"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="pivot" gear="{gear}" ctrlrange="-0.3 0.5"/>
    {actuator}
  </actuator>
</mujoco>
"""


def hinge(seed: int, more: str = "", actuator: str = "") -> mujoco.MjModel:
    rng = np.random.default_rng(seed)
    gravity, place = rng.normal(0.0, 6.0, 3), rng.uniform(-0.4, 0.4, 3)
    return mujoco.MjModel.from_xml_string(
        HINGE.format(
            step=rng.uniform(0.002, 0.02),
            gravity=" ".join(map(str, gravity)),
            axis=" ".join(map(str, rng.standard_normal(3))),
            place=" ".join(map(str, place)),
            damping=rng.uniform(0.0, 0.1),
            stiffness=rng.choice([0.0, rng.uniform(0.0, 2.0)]),
            rest=rng.uniform(-1.0, 1.0),
            gear=rng.uniform(0.2, 3.0),
            more=more,
            actuator=actuator,
        )
    )


@pytest.mark.parametrize("seed", range(8))
def test_a_hinge_is_carried_along_as_mujoco_does(seed: int):
    model, rng = hinge(seed), np.random.default_rng(100 + seed)
    swing = Swing.of(model)
    assert swing is not None
    position, velocity = rng.normal(0.0, 2.0, (2, 5, 1))
    driven = rng.normal(0.0, 0.5, (5, 300, 2))
    batch = Batch(model, 5, nthread=1)
    batch.bind("qpos")[:], batch.bind("qvel")[:] = position, velocity
    spec = int(mujoco.mjtState.mjSTATE_CTRL.value | mujoco.mjtState.mjSTATE_QFRC_APPLIED.value)
    exact = batch.rollout(300, driven, control_spec=spec, record=("qpos", "qvel"))
    swinging = Swinging(swing, position, velocity)
    # in two goes, as a torque that answers to the path is held step by step
    parts = [swinging.carry(part) for part in np.split(driven, [120], axis=1)]
    found = [np.concatenate(one, axis=1) for one in zip(*parts, strict=True)]
    np.testing.assert_allclose(found[0], exact["qpos"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[1], exact["qvel"], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("more", "actuator"),
    [
        ('frictionloss="0.01"', ""),
        ('range="-1 1" limited="true"', ""),
        ("", '<position joint="pivot" kp="3"/>'),
        ("", '<motor joint="pivot" forcerange="-1 1"/>'),
    ],
    ids=["friction loss", "a stop", "a servo", "a limited force"],
)
def test_what_the_equation_lacks_is_left_to_mujoco(more: str, actuator: str):
    assert Swing.of(hinge(1, more, actuator)) is None


def test_a_hinge_in_a_fluid_is_left_to_mujoco():
    model = hinge(1)
    model.opt.viscosity = 10.0
    assert Swing.of(model) is None


@pytest.mark.parametrize("name", ["vnucec_cubesat", "sads", "tas2"])
def test_a_machine_of_more_than_a_hinge_is_left_to_mujoco(name: str):
    assert Swing.of(compile_model(load_platform(name)).model) is None
