"""A table that floats free, its wheels at rest in it: nothing of known size drives it."""

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.diagnose import diagnose
from twin.effects import effect_named
from twin.flight import prepare
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.rotation import from_rotation_vector
from twin.scaffold import new_platform
from twin.stream.recorder import MemoryRecorder


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Platform:
    """As `twin new` writes it."""
    return load_platform(new_platform(tmp_path_factory.mktemp("machine") / "table", "table"))


def floating(table: Platform, rng: np.random.Generator, *hidden) -> Recording:
    """40 s, let go with some tilt and turn; without the commands that nobody gave."""
    start = InitialState(
        attitude=from_rotation_vector(rng.uniform([0.08, -0.1, 0.0], [0.14, -0.04, 1.0])),
        rate_body=rng.uniform(-0.02, 0.02, 3) + [0.0, 0.0, 0.2],
    )
    flight = prepare(
        str(table.folder),
        controller="free_float",
        estimator=None,
        plant="sim",
        reference=None,
        duration=40.0,
        seed=int(rng.integers(2**31)),
        effects=list(hidden),
        initial=start,
    )
    memory = MemoryRecorder(flight.platform)
    flight.fly(SimulatedClock(), [memory])
    log = memory.recording().without_truth()
    kept = {name: series for name, series in log.streams.items() if name in table.sensors}
    return Recording(kept)


def test_a_table_that_floats_free_is_healthy_and_its_wheels_are_not_blamed(
    table: Platform, drawn_seed: int
):
    found = diagnose([floating(table, np.random.default_rng(drawn_seed))], table)
    assert found.verdict == "healthy"
    assert found.baseline.base.size_held == "Jzz"


def test_a_friction_of_a_table_that_floats_free_has_the_size_that_goes_with_the_stated_inertia(
    table: Platform, drawn_seed: int
):
    rng = np.random.default_rng(drawn_seed)
    damping = float(rng.uniform(0.01, 0.05))
    friction = effect_named("bearing_viscous_friction")(damping=damping)
    found = diagnose([floating(table, rng, friction)], table)
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert cause.effect.label == "bearing_viscous_friction"
    assert abs(cause.effect.values[0] - damping) < 2.0 * cause.half_widths[0] < 0.05 * damping
