"""A table that floats free, its wheels at rest in it: nothing of known size drives it."""

from collections.abc import Callable

import numpy as np
import pytest

from twin.diagnosis import diagnose
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.rotation import from_rotation_vector
from twin.scaffold import new_platform


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Platform:
    """As `twin new` writes it."""
    return load_platform(new_platform(tmp_path_factory.mktemp("machine") / "table", "table"))


@pytest.fixture
def floating(table: Platform, flight_of: Callable[..., Recording]) -> Callable[..., Recording]:
    """40 s, let go with some tilt and turn; without the commands that nobody gave."""

    def fly(rng: np.random.Generator, hidden: str = "") -> Recording:
        start = InitialState(
            attitude=from_rotation_vector(rng.uniform([0.08, -0.1, 0.0], [0.14, -0.04, 1.0])),
            rate_body=rng.uniform(-0.02, 0.02, 3) + [0.0, 0.0, 0.2],
        )
        seed = int(rng.integers(2**31))
        log = flight_of(str(table.folder), "free_float", None, 40.0, seed, hidden, start)
        return Recording({name: log[name] for name in log if name in table.sensors})

    return fly


def test_a_table_that_floats_free_is_healthy_and_its_wheels_are_not_blamed(
    table: Platform, floating: Callable[..., Recording], drawn_seed: int
):
    found = diagnose([floating(np.random.default_rng(drawn_seed))], table)
    assert found.verdict == "healthy"
    assert found.baseline.base.held_moment == "Jzz"


@pytest.mark.slow(40)
def test_a_friction_of_a_table_that_floats_free_has_the_size_that_goes_with_the_stated_inertia(
    table: Platform, floating: Callable[..., Recording], drawn_seed: int
):
    rng = np.random.default_rng(drawn_seed)
    damping = float(rng.uniform(0.01, 0.05))
    found = diagnose([floating(rng, f"bearing_viscous_friction={damping}")], table)
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert cause.effect.label == "bearing_viscous_friction"
    assert abs(cause.effect.values[0] - damping) < 2.0 * cause.half_widths[0] < 0.05 * damping
