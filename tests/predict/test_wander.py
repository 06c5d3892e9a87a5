"""What nobody recorded the drive of: how much it walks at random, told from its readings."""

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.predict.profiles import random_walk
from twin.recording import Series

PERIOD = 0.05
DIGIT = 1e-4


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    seed = seed_of(request)
    return np.random.default_rng(seed)


def series(value: np.ndarray) -> Series:
    return Series(PERIOD * np.arange(len(value)), value[:, None], ("g1",), "rad")


def test_rounding_of_what_moves_slowly_is_no_walk(rng):
    time = PERIOD * np.arange(2400)
    told = rng.uniform(5.0, 20.0) * DIGIT * np.sin(0.1 * time + rng.uniform(0.0, 6.0))
    read = DIGIT * np.round(told / DIGIT)
    walk = random_walk(series(read - told), np.array([DIGIT / np.sqrt(12.0)]), np.array([DIGIT]))
    assert walk == 0.0


def test_a_walk_is_as_large_as_it_is_though_its_readings_are_rounded(rng):
    each = 3.0 * DIGIT
    walked = np.cumsum(each * rng.standard_normal(2400))
    read = DIGIT * np.round(walked / DIGIT)
    (walk,) = random_walk(series(read), np.array([DIGIT / np.sqrt(12.0)]), np.array([DIGIT]))
    # a variance from 2400 steps: 3 % at 1 sigma
    assert walk == pytest.approx(each**2 / PERIOD, rel=0.15)
