"""What a joint takes of the motion: its slopes are those of the prediction itself."""

import numpy as np

from twin.library import library
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.base import base_parameters, joint_parameters
from twin.predict.body import body_of
from twin.predict.logs import motion_of
from twin.recording.log import open_log


def test_slopes_by_damping_and_stiffness_are_those_of_the_prediction():
    log = open_log(library("models") / "vnucec_cubesat" / "logs" / "first_step")
    machine = compile_model(load_platform("vnucec_cubesat"))
    base = base_parameters(machine).with_joints(joint_parameters(machine, wheels=True))
    assert base.names == ("J", "damping of line", "stiffness of line", "damping of wheel")
    body = body_of(machine, log, motion_of(log, machine.platform))
    biases = np.zeros(len(body.bias_scale))
    at = body.linearise(base, base.as_stated, biases, body.start)
    for place, size in enumerate(1e-3 * base.scale):
        moved = []
        for sign in (1.0, -1.0):
            theta = base.as_stated.copy()
            theta[place] += sign * size
            moved.append(body.rows(body.rollouts.paths(base.model(theta), body.start.batched()))[0])
        slope = (moved[0] - moved[1]) / (2.0 * size)
        ours = at.linear.shared[..., place]
        error = np.abs(ours - slope).max() / np.abs(slope).max()
        assert error < 0.01, f"{base.names[place]}: {error:.3g}"
