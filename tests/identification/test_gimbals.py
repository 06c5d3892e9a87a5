"""Whether gimbals are believed to go where they are told: what their encoders round is no fault."""

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.identification.identification import as_measured
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.profiles import random_walk
from twin.predict.sensors import digits_of
from twin.recording import Recording, Series

PERIOD = 0.05
TIME = PERIOD * np.arange(2400)
TAS2 = load_platform("tas2")
DIGIT = TAS2.sensors["gimbal_angle"].resolution


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    seed = seed_of(request)
    return np.random.default_rng(seed)


def rounded(angle: np.ndarray) -> np.ndarray:
    return DIGIT * np.round(angle / DIGIT)


def swung(rng: np.random.Generator, amplitudes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates and angles (m, 3) that swing slowly by so many digits about anywhere."""
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    pulse = rng.uniform(0.1, 0.2)
    angle = DIGIT * (rng.uniform(-0.5, 0.5, 3) + amplitudes * np.sin(pulse * TIME[:, None] + phase))
    return DIGIT * amplitudes * pulse * np.cos(pulse * TIME[:, None] + phase), angle


def log(rates: np.ndarray, angles: np.ndarray) -> Recording:
    names = tuple(gimbal.name for gimbal in TAS2.gimbals)
    return Recording(
        {
            "command_gimbal_rate": Series(TIME, rates, names, "rad/s"),
            "gimbal_angle": Series(TIME, angles, names, "rad"),
        }
    )


def test_a_gimbal_that_moves_by_less_than_its_encoder_shows_goes_where_it_is_told(rng):
    rates, angles = swung(rng, np.array([15.0, 2.0, rng.uniform(0.1, 0.6)]))
    measured, sentences = as_measured(log(rates, rounded(angles)), compile_model(TAS2))
    assert not sentences
    assert "command_gimbal_rate" in measured


def test_a_gimbal_whose_play_is_many_of_its_encoders_steps_does_not(rng):
    rates, angles = swung(rng, np.array([40.0, 2.0, 0.3]))
    play = rng.uniform(5.0, 10.0) * DIGIT
    stands = np.empty(len(TIME))
    stands[0] = angles[0, 0]
    for k in range(1, len(TIME)):
        stands[k] = np.clip(stands[k - 1], angles[k, 0] - play, angles[k, 0] + play)
    angles[:, 0] = stands
    measured, sentences = as_measured(log(rates, rounded(angles)), compile_model(TAS2))
    assert "g1 did not go where command_gimbal_rate says" in sentences[0]
    assert "command_gimbal_rate" not in measured


def test_what_stays_at_an_edge_between_two_readings_does_not_walk(rng):
    _, angles = swung(rng, np.full(3, 0.3))
    angles += DIGIT * (0.5 - angles.mean(axis=0) / DIGIT)
    read = log(angles, rounded(angles))["gimbal_angle"]
    assert all(len(np.unique(column)) == 2 for column in read.value.T)
    digits = digits_of(read, TAS2, "gimbal_angle")
    np.testing.assert_allclose(digits, DIGIT)
    assert not random_walk(read, digits / np.sqrt(12.0), digits).any()
