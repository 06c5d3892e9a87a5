"""The extended folder holds all that was fitted."""

import shutil
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import tomlkit

from twin.comparison import compare
from twin.diagnosis import diagnose, extend
from twin.diagnosis.extension import give_inertial, give_joints, state_effect
from twin.effects import effect_named, parse_effects
from twin.library import library
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.base import base_parameters, joint_parameters
from twin.recording import Recording


def test_joints_are_written_with_the_damping_and_stiffness_that_were_fitted(tmp_path: Path):
    shutil.copytree(library("models") / "vnucec_cubesat", tmp_path / "own")
    machine = compile_model(load_platform(str(tmp_path / "own")))
    base = base_parameters(machine).with_joints(joint_parameters(machine, wheels=True))
    theta = base.as_stated * (1.0 + 0.1 * np.arange(len(base.as_stated)))
    give_joints(tmp_path / "own" / "platform.xml", base, theta)
    model = compile_model(load_platform(str(tmp_path / "own"))).model
    fitted = dict(zip(base.names, theta, strict=True))
    assert model.dof_damping[0] == pytest.approx(fitted["damping of line"])
    assert model.jnt_stiffness[0] == pytest.approx(fitted["stiffness of line"])
    assert model.dof_damping[1] == pytest.approx(fitted["damping of wheel"])


@pytest.mark.parametrize(
    "written",
    [
        '<inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>{parts}',
        '<inertial mass="9" diaginertia="1 1 1"\n pos="0 0 0" ></inertial>{parts}',
        '{parts}<inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>',
    ],
    ids=["before the parts", "with an end of its own", "after the parts"],
)
def test_the_bus_is_given_its_inertial_wherever_the_mjcf_states_it(tmp_path: Path, written: str):
    parts = '<joint name="a" type="ball"/><body name="w"><inertial pos="0 0 0" mass="1" '
    parts += 'diaginertia="2 2 2"/><joint name="h"/></body>'
    text = f'<mujoco><worldbody><body name="bus">{written}</body></worldbody></mujoco>'
    path = tmp_path / "platform.xml"
    path.write_text(text.format(parts=parts))
    model = mujoco.MjModel.from_xml_path(str(path))
    bus, wheel = model.body("bus").id, model.body("w").id
    model.body_mass[bus], model.body_inertia[bus] = 4.0, (3.0, 4.0, 5.0)
    give_inertial(path, "bus", model)
    there = mujoco.MjModel.from_xml_path(str(path))
    assert there.body_mass[bus] == 4.0
    assert there.body_inertia[bus].tolist() == [3.0, 4.0, 5.0]
    assert there.body_mass[wheel] == 1.0


def test_a_cause_that_ends_at_its_bound_is_written_within_it():
    draft = effect_named("room_draft").typical()
    values = draft.values
    values[draft.names.index("phase")] = 2.0 * np.pi
    document = tomlkit.document()
    state_effect(document, draft.with_values(values), np.full(len(values), np.nan), "swing.rrd")
    assert document["room_draft"]["phase"] == 2.0 * np.pi


def test_each_number_that_is_written_says_what_it_was_fitted_to_and_how_well(tmp_path: Path):
    document = tomlkit.document()
    (lag,) = parse_effects("clock_lag:gyro=0.17")
    state_effect(document, lag, np.array([0.0123]), "swing.rrd")
    assert "lag = 0.17 # s; fitted to swing.rrd; 95 %: +- 0.012" in tomlkit.dumps(document)


HIDDEN = {
    "bearing_swirl_torque": (0.01, 0.02),
    "wheel_torque_gain:w2": (0.1, 0.2),
    "clock_lag:attitude": (0.5, 0.8),
    "harness_stiffness": (0.4, 0.8),
}


@pytest.mark.slow
def test_another_log_leaves_noise_under_the_extended_platform(
    flight_of: Callable[..., Recording], drawn_seed: int, tmp_path: Path
):
    rng = np.random.default_rng(drawn_seed)
    label = str(rng.choice(list(HIDDEN)))
    hidden = f"{label}={rng.uniform(*HIDDEN[label])}"
    print(hidden)
    fly = "sads", "quaternion_pd", "multisine:8", 40.0
    first, second = (flight_of(*fly, drawn_seed + i, hidden) for i in (0, 1))
    found = diagnose([first], load_platform("sads"))
    assert [cause.effect.label for cause in found.causes] == [label]
    assert found.verdict != "unexplained"
    extended = extend(found, tmp_path / "extended")
    assert not compare(second, load_platform("sads")).healthy
    refitted = compare(second, extended).refitted
    assert refitted is not None
    # twice the evidence that noise has in a log out of a hundred: in one of a hundred thousand
    assert all(score.evidence < 2.0 * score.needed for score in refitted.scores)
    assert diagnose([second], extended).verdict == "healthy"
