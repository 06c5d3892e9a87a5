"""A fit's motion is nearer to the truth than smoothed data, and keeps what their window loses."""

from dataclasses import replace

import numpy as np
import pytest

from tests.effects.motion import Kicks
from twin.contrast import moved
from twin.effects import parse_effects
from twin.errors import TwinError
from twin.identification.prediction_error import Fit, fit, fit_disturbed
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.base import base_parameters
from twin.predict.body import Body, body_of
from twin.predict.columns import perturbations_of, strengths_of
from twin.predict.innovations import Problem, retraced
from twin.predict.logs import motion_of
from twin.recording import Recording

SEED = 20261121
SECONDS = 8.0
PANEL = "flexible_appendage=1.5/0.005/2/1/0/0"


@pytest.fixture(scope="module")
def sads() -> Platform:
    platform = load_platform("sads")
    sensors = {k: replace(s, bias=0.0 * s.bias) for k, s in platform.sensors.items()}
    return replace(platform, sensors=sensors, tilt_limit=np.pi)


def kicked(platform: Platform, effects: str = "") -> Recording:
    hidden = parse_effects(effects) if effects else ()
    print("seed", SEED)
    return moved(platform, hidden, SECONDS, seed=SEED, law=Kicks())


def fitted(log: Recording, platform: Platform) -> tuple[Problem, Fit]:
    """The machine as stated, under what torque the log asks for."""
    log = log.without_truth()
    body = body_of(compile_model(platform), log, motion_of(log, platform))
    problem = Problem([body], base_parameters(body.machine), held=True)
    start = problem.start(problem.base.as_stated, [np.zeros(0)])
    return problem, fit_disturbed(problem, fit(problem, start), start)


def error(body: Body, log: Recording) -> float:
    """Of the rate, root mean square away from the ends [rad/s]."""
    grid = body.grid
    time = (grid.starts[:, None] + grid.step * np.arange(grid.steps + 1)).ravel()
    rate = body.motion.at(time).rate
    if body.predicted is not None:
        rate = body.predicted.rate[0].reshape(-1, 3)
    apart = rate - log["truth_rate"].interpolated_at(time)
    inside = (time > 1.0) & (time < SECONDS - 1.0)
    return float(np.sqrt(np.mean(np.square(apart[inside]))))


def test_a_motion_that_the_model_explains_is_known_far_better_than_smoothed(sads):
    log = kicked(sads)
    problem, found = fitted(log, sads)
    smoothed, followed = problem.bodies[0], retraced(problem, found.innovations, 0)
    assert error(followed, log) < 0.1 * error(smoothed, log)


def test_a_torque_that_the_model_lacks_is_in_the_motion_all_the_same(sads):
    log = kicked(sads, "harness_stiffness=0.2")
    problem, found = fitted(log, sads)
    assert found.innovations.intensity > 0.0, "the torque is too small to be asked for"
    smoothed, followed = problem.bodies[0], retraced(problem, found.innovations, 0)
    assert error(followed, log) < 0.5 * error(smoothed, log)


def test_wheels_that_nobody_recorded_a_command_of_leave_a_motion_as_it_was(sads):
    log = kicked(sads)
    streams = {k: v for k, v in log.streams.items() if k != "command_wheel_torque"}
    problem, found = fitted(replace(log, streams=streams), sads)
    assert retraced(problem, found.innovations, 0) is problem.bodies[0]


def test_a_panel_that_is_heavy_beside_its_bus_rings_as_both_do_together(sads):
    (panel,) = parse_effects(PANEL)
    log = kicked(sads, PANEL).without_truth()
    body = body_of(compile_model(sads), log, motion_of(log, sads))
    plain = Problem([body], base_parameters(body.machine), held=True)
    start = plain.start(plain.base.as_stated, [np.zeros(0)])
    followed = retraced(plain, plain.innovations(start), 0)
    ringing = Problem([followed], plain.base, perturbations_of(panel, sads), held=True)
    known = ringing.innovations(replace(start, strengths=strengths_of(panel)))
    assert known.chi2 < 1.1 * known.samples


def test_a_machine_so_unstable_that_no_number_holds_its_motion_is_refused(sads: Platform):
    log = kicked(sads).without_truth()
    body = body_of(compile_model(sads), log, motion_of(log, sads))
    problem = Problem([body], base_parameters(body.machine))
    heavy = problem.base.as_stated.copy()
    heavy[problem.base.names.index("mr_z")] = 3e5
    with pytest.raises(TwinError, match="runs away from the log"):
        fit(problem, problem.start(heavy, [np.zeros(0)]))
