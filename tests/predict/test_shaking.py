"""A gyro that stepper motors shake is believed less while they run."""

import numpy as np
import pytest

from twin.diagnosis.experiment import SimulatedRun
from twin.identification import identify
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.body import body_of
from twin.predict.logs import motion_of
from twin.predict.sensors import Output
from twin.recording import Recording

SEED = 20261122


@pytest.fixture(scope="module")
def platform() -> Platform:
    """States that its steppers shake its gyro."""
    return load_platform("cubesat")


@pytest.fixture(scope="module")
def log(platform: Platform) -> Recording:
    """Masses and coils bring it level."""
    tilted = SimulatedRun(platform, "mass_magnetic_pid", 40.0, attitude=(5.0, 3.0, 0.0))
    found = tilted.flown(platform, seed=SEED)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def gyro(platform: Platform, log: Recording) -> Output:
    body = body_of(compile_model(platform), log, motion_of(log, platform))
    return next(output for output in body.outputs if output.stream == "gyro")


def test_its_noise_is_that_of_a_gyro_at_rest(gyro, platform):
    assert gyro.noise == pytest.approx(platform.sensors["gyro"].noise, rel=0.2)


def test_it_counts_less_while_a_mass_moves(gyro, log):
    shown = log["stage_position"]
    speed = np.gradient(shown.value, shown.time, axis=0)
    fast = np.abs(speed).max(axis=1) > 1e-4
    moves = np.interp(gyro.time, shown.time, fast) == 1.0
    assert moves.any()
    assert np.median(gyro.sigma[moves]) > 3.0 * np.median(gyro.sigma[~moves])


def test_what_identification_leaves_is_noise(log, platform):
    (part,) = [one for one in identify([log], platform).misfit if one.name == "gyro"]
    assert part.chi2_per_sample < 1.1
