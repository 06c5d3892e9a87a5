"""The prediction of a passive pendulum against theory."""

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from twin.model import compile_model
from twin.platform import Platform
from twin.predict.base import base_parameters
from twin.predict.body import Body, body_of
from twin.predict.logs import motion_of
from twin.predict.states import PathForces, States
from twin.recording import Recording, Series

AMPLITUDE = 2.0
"""[rad], far from small."""


def passive_log(platform: Platform, duration: float) -> Recording:
    """The exact motion of a pendulum let go at `AMPLITUDE`, from Jacobi's elliptic functions."""
    inertia = float(platform.inertia[1, 1])
    moment = -float(platform.center_of_mass_offset[2])
    natural = np.sqrt(platform.gravity * moment / inertia)
    time = np.arange(0.0, duration, 0.005)
    k = np.sin(0.5 * AMPLITUDE)
    sn, cn, dn, _ = ellipj(ellipk(k**2) - natural * time, k**2)
    angle = 2.0 * np.arcsin(k * sn)
    rate = -2.0 * natural * k * cn
    del dn
    return Recording(
        {
            "joint_angle": Series(time, angle[:, None], ("pivot",), "rad"),
            "joint_rate": Series(time, rate[:, None], ("pivot",), "rad/s"),
        }
    )


@pytest.fixture(scope="module")
def passive(pendulum: Platform) -> tuple[Body, States]:
    """14 periods from the exact first state, segment after segment."""
    log = passive_log(pendulum, 20.0)
    body = body_of(compile_model(pendulum), log, motion_of(log, pendulum))
    start = States(np.array([[AMPLITUDE]]), np.zeros((1, 1)), np.zeros((1, 0)), np.zeros((1, 0)))
    return body, start


def test_the_predicted_pendulum_keeps_its_energy_and_the_time_of_the_elliptic_integral(
    passive: tuple[Body, States], pendulum: Platform
):
    body, start = passive
    steps = round(19.9 / body.grid.step)
    push = np.zeros((body.grid.segments, body.grid.steps, body.machine.model.nv))
    model = base_parameters(body.machine).model(base_parameters(body.machine).as_stated)
    there = np.zeros(1, dtype=np.intp)
    angle = body.rollouts.onward(model, there, start, steps, PathForces(push))[0, :, 0]
    exact = passive_log(pendulum, 20.0)["joint_angle"]
    time = body.grid.step * np.arange(steps + 1)
    assert np.max(np.abs(angle - np.interp(time, exact.time, exact.value[:, 0]))) < 1e-4
    turning = np.abs(angle)[np.r_[False, np.diff(np.sign(np.diff(angle))) != 0, False]]
    np.testing.assert_allclose(turning, AMPLITUDE, atol=1e-4)
