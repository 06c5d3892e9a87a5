"""What wanders in a log is found in its size, and leaves innovations that are white."""

import numpy as np
import pytest

from tests.promises.messy import Mess, flown
from twin.compare.misfit import misfits
from twin.identify.noise_fit import ROOM, cost_of, fit_with_noise, likeliest
from twin.identify.prediction_error import Fit, fit
from twin.identify.start import base_of, first_biases
from twin.platform import load_platform
from twin.predict.body import body_of
from twin.predict.effects.machine import predicted_machine
from twin.predict.log.motion import motion_of
from twin.predict.whitening.innovations import Problem
from twin.predict.whitening.noise_model import QUIET
from twin.predict.whitening.unexplained import smoothed_torque
from twin.predict.whitening.unknowns import Unknowns

TORQUE = 3e-4
"""So that it is seen in a minute [N m]."""


def posed(mess: Mess | None, seed: int) -> tuple[Problem, Unknowns]:
    """A minute of `sads`, and where a fit of it starts."""
    platform = load_platform("sads")
    log = flown((), seed, mess, 60.0)
    machine = predicted_machine(platform)
    body = body_of(machine, log, motion_of(log, platform))
    _, base = base_of(machine, [log])
    problem = Problem([body], base)
    return problem, problem.start(base.as_stated, [first_biases(body)])


@pytest.fixture(scope="module")
def wandering() -> tuple[Problem, Fit, Fit]:
    """A log with a torque that wanders, fitted without and with it."""
    problem, start = posed(Mess(torque=TORQUE, lost=0.0, jitter=0.0), 3)
    exact = fit(problem, start)
    return problem, exact, fit_with_noise(problem, exact.at)


def test_a_torque_that_wanders_is_found_in_its_size(wandering):
    noise = wandering[2].innovations.noise
    assert noise.torque.rms == pytest.approx(TORQUE, rel=0.3)
    assert noise.errors.get("attitude", noise.torque).rms in (0.0, noise.torque.rms), (
        "the attitude's error is right: what it takes is the torque's"
    )


def test_innovations_beside_it_are_white_where_those_without_are_not(wandering):
    problem, exact, found = wandering
    before, after = (misfits(problem, one.innovations) for one in (exact, found))
    assert min(part.whiteness for part in before) < 1e-6
    assert min(part.whiteness for part in after) > 1e-3 / len(after)
    chi2 = [part.chi2 for part in after]
    assert np.abs(np.array(chi2) - 1.0).max() < 0.06


def test_a_quiet_log_stays_as_it_was_to_the_last_bit():
    problem, start = posed(None, 4)
    exact = fit(problem, start)
    found = fit_with_noise(problem, exact.at)
    assert found.innovations.noise == QUIET
    np.testing.assert_array_equal(
        found.innovations.residual, fit(problem, exact.at).innovations.residual
    )


def test_noise_pays_for_its_room(wandering):
    problem, exact, found = wandering
    without = fit_with_noise(problem, exact.at, QUIET)
    assert cost_of(problem, exact.innovations) - cost_of(problem, found.innovations) > ROOM
    again = likeliest(problem, without.innovations)
    assert abs(cost_of(problem, again) - cost_of(problem, found.innovations)) < 2.0


def test_the_smoothed_torque_is_the_one_that_wandered(wandering):
    problem, _, found = wandering
    torque = smoothed_torque(found.innovations, 0)
    noise = found.innovations.noise
    # what is known of it afterwards is less than it is, and of its size
    assert 0.3 * TORQUE < float(np.sqrt(np.mean(np.square(torque)))) < 1.2 * TORQUE
    step = problem.bodies[0].grid.step
    steps = np.diff(torque.reshape(-1, 3), axis=0)
    fastest = TORQUE * np.sqrt(2.0 * step / noise.torque.time_constant)
    assert float(np.sqrt(np.mean(np.square(steps)))) < 3.0 * fastest
