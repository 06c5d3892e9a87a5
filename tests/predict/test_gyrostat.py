"""A simulated flight of `sads` is predicted from its commands, and gives its base back."""

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.flight import prepare as prepare_flight
from twin.platform import load_platform
from twin.predict import compare
from twin.predict.compare import prepare
from twin.predict.fit import Fit, fit
from twin.predict.rollout import Predictor
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
def refitted(flight: Recording) -> tuple[Predictor, Fit]:
    predictor, base = prepare(flight.without_truth(), load_platform("sads"))
    return predictor, fit(predictor, base)


def test_the_prediction_leaves_only_noise(refitted: tuple[Predictor, Fit]):
    assert refitted[1].is_noise, refitted[1].chi2_per_sample


def test_inertia_and_mass_moment_come_back_within_their_intervals(
    refitted: tuple[Predictor, Fit],
):
    predictor, found = refitted
    platform = predictor.machine.platform
    entries = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    truth = [*(platform.inertia[i, j] for i, j in entries), *platform.center_of_mass_offset]
    off = found.theta - truth
    distance = float(off @ np.linalg.solve(found.covariance[:9, :9], off))
    print(f"squared distance from the truth {distance:.1f}, 9 is due")
    # a chi-square of 9 degrees of freedom is larger once in 1000
    assert distance < 27.9
    np.testing.assert_allclose(found.theta[:3], truth[:3], rtol=0.1)


def test_the_gyro_bias_is_found_beside_the_base(flight: Recording, refitted: tuple[Predictor, Fit]):
    gyro, truth = flight["gyro"], flight["truth_rate"]
    bias = np.mean(gyro.value - truth.interpolated_at(gyro.time), axis=0)
    np.testing.assert_allclose(refitted[1].at.biases, bias, atol=2e-4)


@pytest.mark.slow
def test_a_flight_without_anything_hidden_is_healthy(flight: Recording):
    comparison = compare(flight, load_platform("sads"))
    assert comparison.verdict == "healthy", comparison.best.explanation.laws
