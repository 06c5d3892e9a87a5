"""The extended folder holds all that was fitted."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from twin.diagnose.extension import give_joints
from twin.library import library
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.parameters.base import base_parameters
from twin.predict.parameters.joints import joint_parameters


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
