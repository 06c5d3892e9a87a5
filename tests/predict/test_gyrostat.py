"""A simulated flight of `sads` is predicted from its commands, and gives its base back."""

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.comparison import compare
from twin.comparison.account import is_noise, misfits
from twin.comparison.comparison import prepare
from twin.flight import prepare as prepare_flight
from twin.identification.prediction_error import Fit, fit
from twin.platform import load_platform
from twin.predict.base import base_parameters
from twin.predict.body import Body
from twin.predict.innovations import Problem
from twin.recording import Recording
from twin.stream.recorder import MemoryRecorder

SEED = 3


@pytest.fixture(scope="module")
def flight() -> Recording:
    flight = prepare_flight(
        "sads",
        controller="quaternion_pd",
        estimator="filter",
        plant="sim",
        reference=None,
        duration=60.0,
        seed=SEED,
    )
    recorder = MemoryRecorder(flight.platform, {"platform": "sads", "source": "flight"})
    flight.fly(SimulatedClock(), [recorder])
    return recorder.recording()


@pytest.fixture(scope="module")
def refitted(flight: Recording) -> tuple[Body, Fit]:
    body, base, _ = prepare(flight.without_truth(), load_platform("sads"))
    problem = Problem([body], base)
    return body, fit(problem, problem.start(base.as_stated, [np.zeros(len(body.bias_scale))]))


def test_the_prediction_leaves_only_noise(refitted: tuple[Body, Fit]):
    body, found = refitted
    now = found.innovations
    assert is_noise(misfits(Problem([body], base_parameters(body.machine)), now))


def test_inertia_and_mass_moment_come_back_within_their_intervals(
    refitted: tuple[Body, Fit],
):
    body, found = refitted
    platform = body.machine.platform
    entries = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    truth = [*(platform.inertia[i, j] for i, j in entries), *platform.center_of_mass_offset]
    off = found.at.theta - truth
    distance = float(off @ np.linalg.solve(found.covariance()[0], off))
    print(f"squared distance from the truth {distance:.1f}, 9 is due")
    # a chi-square of 9 degrees of freedom is larger once in 1000
    assert distance < 27.9
    np.testing.assert_allclose(found.at.theta[:3], truth[:3], rtol=0.1)


def test_the_gyro_bias_is_found_beside_the_base(flight: Recording, refitted: tuple[Body, Fit]):
    gyro, truth = flight["gyro"], flight["truth_rate"]
    bias = np.mean(gyro.value - truth.interpolated_at(gyro.time), axis=0)
    np.testing.assert_allclose(refitted[1].at.biases[0], bias, atol=2e-4)


@pytest.mark.slow
def test_a_flight_without_anything_hidden_is_healthy(flight: Recording):
    comparison = compare(flight, load_platform("sads"))
    assert comparison.verdict == "healthy", comparison.best.strengths
