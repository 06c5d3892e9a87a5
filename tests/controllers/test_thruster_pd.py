"""Thrusters that only push: their allocation, and what a shortest pulse leaves of the pointing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.signal import impulse

from papers.flown import perfect
from tests.controllers.flight import simulate
from twin.controller import load_controller
from twin.controller.thrusters import Nozzles
from twin.errors import ControllerError
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.rotation import from_rotation_vector, to_rotation_vector

MACHINES = ["astros", "astros:mode_c", "sads", "whorl1"]


def effect(platform):
    """(3, k) torque and (3, k) force of each thruster, from where the MJCF has them."""
    force = np.array([thruster.direction for thruster in platform.thrusters])
    arms = np.array([thruster.point for thruster in platform.thrusters])
    return np.cross(arms, force).T, force.T


@pytest.mark.parametrize("name", MACHINES)
def test_forces_give_the_torque_with_the_least_gas(name):
    """Against a solver of linear programs, in any direction; no net force where a base slides."""
    platform = load_platform(name)
    torque, force = effect(platform)
    asked = np.random.default_rng(7).normal(size=(30, 3))
    given = Nozzles.of(platform, "test").forces(asked)
    assert given.min() >= 0.0
    np.testing.assert_allclose(given @ torque.T, asked, atol=1e-9)
    rows, right = torque, asked
    if name == "astros:mode_c":
        np.testing.assert_allclose(given @ force.T, 0.0, atol=1e-9)
        rows, right = np.vstack([torque, force]), np.pad(asked, ((0, 0), (0, 3)))
    for wanted, found in zip(right, given, strict=True):
        best = linprog(np.ones(rows.shape[1]), A_eq=rows, b_eq=wanted)
        assert found.sum() == pytest.approx(best.fun, rel=1e-9)


def loop_bound(law, inertia, quantum):
    """Largest angle [rad] that an error of impulse below `quantum` [N m s] makes.

    The integral of |g|, g the impulse response of s / (J s^2 + K_d s + K_p / 2).
    """
    loop = ([1.0, 0.0], [inertia, law.derivative, 0.5 * law.proportional])
    time, response = impulse(loop, T=np.linspace(0.0, 100.0, 20001))
    return quantum * np.trapezoid(np.abs(response), time)


@pytest.mark.parametrize("name", ["astros", "whorl1"])
def test_body_points_within_what_the_shortest_pulses_do(name):
    law = load_controller("thruster_pd")
    shipped = perfect(load_platform(name))
    platform = replace(shipped, center_of_mass_offset=np.zeros(3), tilt_limit=np.inf)
    start = from_rotation_vector(np.radians([3.0, -2.0, 4.0]))
    run = simulate(law, platform, 75.0, start=InitialState(attitude=start))
    off = np.abs(to_rotation_vector(run.true["attitude"]))[run.time > 60.0]
    torque, _ = effect(platform)
    limit = np.array([thruster.force_limit for thruster in platform.thrusters])
    # No more thrusters push than there are axes, each short of one pulse at most.
    arms = np.sort(np.abs(torque) * limit, axis=1)[:, -3:].sum(axis=1)
    bound = [
        loop_bound(law, platform.inertia[axis, axis], arms[axis] * law.pulse) for axis in range(3)
    ]
    print(f"{name}: off by {off.max(axis=0)} rad, bound {np.array(bound)}")
    assert (off < bound).all()
    fired = run.applied["command_thruster"]
    on = fired[fired > 0.0]
    assert on.min() >= 0.999 * limit[0] * law.pulse / platform.tick, "no shorter pulse is asked for"


def test_saturated_forces_keep_the_axis_of_the_torque():
    law, platform = load_controller("thruster_pd", {"pulse": 0.0}), perfect(load_platform("astros"))
    start = InitialState(rate_body=np.array([0.8, -0.6, 0.5]))
    run = simulate(law, platform, 0.1, start=start)
    torque, _ = effect(platform)
    given = torque @ run.applied["command_thruster"][0]
    assert run.applied["command_thruster"][0].max() == pytest.approx(5.0)
    wanted = -law.derivative * np.array([0.8, -0.6, 0.5])
    np.testing.assert_allclose(
        given / np.linalg.norm(given), wanted / np.linalg.norm(wanted), atol=1e-9
    )


def test_machine_without_thrusters_all_round_is_refused():
    law, astros = load_controller("thruster_pd"), load_platform("astros")
    with pytest.raises(ControllerError, match="the 0 of cubesat do not"):
        law.init(load_platform("cubesat"), 1)
    with pytest.raises(ControllerError, match="the 3 of astros do not"):
        law.init(replace(astros, thrusters=astros.thrusters[:3]), 1)
