"""Exact tracking by wheels on the table that the law was written for."""

from dataclasses import replace

import numpy as np
import pytest

from papers.flown import perfect
from tests.controllers.flight import simulate
from twin.controller import load_controller
from twin.errors import ControllerError
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.reference import Hold, Multisine
from twin.rotation import (
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    to_rotation_vector,
)


@pytest.fixture(scope="module")
def law():
    return load_controller("mrp_tracking")


@pytest.fixture(scope="module")
def whorl():
    return perfect(load_platform("whorl1"))


def errors(run, reference):
    """Rotation vector (m, 3) [rad] and rate (m, 3) [rad/s] from the target, body axes."""
    target = reference.at(run.time)
    error = multiply(conjugate(target.attitude), run.true["attitude"])
    rate = run.true["rate"] - rotate(conjugate(error), target.rate_body)
    return to_rotation_vector(error), rate


def test_motion_is_followed_but_for_what_a_tick_holds_the_torque(law, whorl):
    """A torque held for a tick errs by half of what it changes, against the stiffness k_2 / 4."""
    reference = Multisine(np.radians(2.0))
    run = simulate(law, whorl, 40.0, reference=reference)
    off, _ = errors(run, reference)
    change = np.abs(np.diff(run.applied["command_wheel_torque"], axis=0)).max()
    bound = 0.5 * np.sqrt(3.0) * change / (law.attitude_gain / 4.0)
    assert np.linalg.norm(off[1:], axis=1).max() < bound
    assert bound < np.radians(0.01)


def test_feedback_without_what_is_fed_forward_is_a_hundred_times_worse(law, whorl):
    reference = Multisine(np.radians(2.0))
    off = {
        name: np.linalg.norm(
            errors(simulate(load_controller(name), whorl, 40.0, reference=reference), reference)[0],
            axis=1,
        ).max()
        for name in ("mrp_tracking", "quaternion_pd")
    }
    assert off["quaternion_pd"] > 100.0 * off["mrp_tracking"]


def test_lyapunov_function_never_grows_from_a_wrong_start(law, whorl):
    """V = w_e J w_e / 2 + 2 k_2 ln(1 + s^2), with every term fed forward in play."""
    free = replace(whorl, tilt_limit=np.inf, step=0.005, control_rate=100.0)
    reference = Multisine(np.radians(10.0))
    start = InitialState(
        attitude=from_rotation_vector(np.array([0.02, -0.02, 0.03])),
        rate_body=np.array([0.01, -0.005, 0.005]),
        wheel_speed=np.array([50.0, -80.0, 30.0]),
    )
    run = simulate(law, free, 25.0, start=start, reference=reference)
    assert np.abs(run.applied["command_wheel_torque"]).max() < 0.2, "V says nothing at the limits"
    off, rate = errors(run, reference)
    mrp = np.tan(np.linalg.norm(off, axis=1) / 4.0)
    inertia = law.init(free, 1).wheels.inertia
    value = 0.5 * np.einsum("ni,ij,nj->n", rate, inertia, rate)
    value += 2.0 * law.attitude_gain * np.log1p(mrp**2)
    assert np.diff(value).max() < 1e-5 * value[0]
    assert value[-1] < 1e-4 * value[0], "what is left is the torque's hold over a tick"


def test_moment_that_the_platform_states_wrongly_tilts_the_body_by_four_times_it_over_the_gain(
    law, whorl
):
    wrong = np.array([1e-3, 0.0, 0.0])
    other = replace(whorl, center_of_mass_offset=whorl.center_of_mass_offset + wrong)
    stale = law.init(whorl, 1)

    class Stale(type(law)):
        def init(self, platform, n):
            return stale

    run = simulate(Stale(), other, 25.0)
    off, _ = errors(run, Hold())
    assert np.linalg.norm(off[-1]) == pytest.approx(4.0 * 1e-3 * 9.81 / law.attitude_gain, rel=0.05)


def test_platform_without_three_wheel_axes_is_refused(law):
    with pytest.raises(ControllerError, match="the 0 wheels of astros do not"):
        law.init(load_platform("astros"), 1)
