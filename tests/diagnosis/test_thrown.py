"""Logs of a body that is thrown: it is predicted about its centre of mass."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from twin.diagnosis import diagnose, extend
from twin.identification import identify
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.scaffold import new_platform

ENTRIES = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])


@pytest.fixture(scope="module")
def thrown(tmp_path_factory: pytest.TempPathFactory) -> Platform:
    """With its wheel turning, and its centre of mass 3 mm off the body's origin."""
    folder = tmp_path_factory.mktemp("machine") / "thrown"
    new_platform(folder, "free")
    text = (folder / "platform.toml").read_text()
    offset = "center_of_mass_offset = [0.0, 0.0, 2e-3]"
    assert offset in text
    (folder / "platform.toml").write_text(
        text.replace(offset, "center_of_mass_offset = [4e-3, -3e-3, 2e-3]")
    )
    return load_platform(folder)


@pytest.fixture
def flown(thrown: Platform, flight_of: Callable[..., Recording]) -> Callable[..., Recording]:
    """A second in the air."""

    def fly(rng: np.random.Generator, hidden: str = "") -> Recording:
        start = InitialState(
            rate_body=rng.choice([-1.0, 1.0], 3) * rng.uniform(0.8, 2.5, 3),
            velocity=np.array([0.0, 0.0, 5.0]),
        )
        seed = int(rng.integers(2**31))
        return flight_of(str(thrown.folder), "free_float", None, 1.0, seed, hidden, start)

    return fly


def about_center(machine: Platform) -> np.ndarray:
    """(6,) J about the centre of mass."""
    moment = machine.center_of_mass_offset
    carried = (moment @ moment * np.eye(3) - np.outer(moment, moment)) / machine.mass
    return (machine.inertia - carried)[ENTRIES]


def test_the_inertia_of_a_body_that_is_thrown_is_that_about_its_centre_of_mass(
    thrown: Platform, flown: Callable[..., Recording], drawn_seed: int
):
    log = flown(np.random.default_rng(drawn_seed))
    found = identify([log], thrown)
    assert found.base.names == ("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz")
    # four standard deviations
    assert np.all(np.abs(found.theta - about_center(thrown)) < 2.0 * found.half_widths)
    healthy = diagnose([log], thrown)
    assert healthy.verdict == "healthy"
    assert "without weight" in healthy.not_asked["liquid_slosh"]


def test_an_askew_gyro_of_a_thrown_body_is_named_and_the_extended_machine_keeps_its_origin(
    thrown: Platform, flown: Callable[..., Recording], drawn_seed: int, tmp_path: Path
):
    rng = np.random.default_rng(drawn_seed)
    turn = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.01, 0.03, 3)
    hidden = f"gyro_misalignment={'/'.join(map(str, turn))}"
    found = diagnose([flown(rng, hidden)], thrown)
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert cause.effect.label == "gyro_misalignment"
    assert np.all(np.abs(cause.effect.values - turn) < 2.0 * cause.half_widths)
    extended = extend(found, tmp_path / "extended")
    assert extended.base.kind == "free"
    assert np.allclose(extended.center_of_mass_offset, thrown.center_of_mass_offset)
    fitted = found.explained.base.entries(found.explained.at.theta)[:6]
    assert np.allclose(about_center(extended), fitted, rtol=1e-6, atol=1e-9)
