"""Samples that say nothing of the motion are left out, said, and change no answer."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.seeds import seed_of
from twin import rotation
from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.conventions import check_conventions
from twin.diagnosis import diagnose
from twin.estimators import load_estimator
from twin.loop import fly
from twin.noise.cleaning import cleaned
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.predict.logs import usable
from twin.recording import Recording
from twin.reference import Multisine
from twin.report.contents import contents_of
from twin.stream.recorder import MemoryRecorder

FIRST = 1000
"""Row from which a stream is spoiled."""


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


@pytest.fixture(scope="module")
def log(sads, request: pytest.FixtureRequest) -> Recording:
    """30 s of a multisine."""
    seed = seed_of(request)
    memory = MemoryRecorder(sads)
    fly(
        SimulatedPlant(sads, seed=seed),
        load_estimator("filter"),
        load_controller("quaternion_pd"),
        Multisine(),
        SimulatedClock(),
        duration=30.0,
        observers=[memory],
    )
    return memory.recording().without_truth()


def spoiled(log: Recording, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Recording:
    value = change(log[name].value.copy())
    return replace(log, streams={**log.streams, name: replace(log[name], value=value)})


def hangs(value: np.ndarray) -> np.ndarray:
    value[FIRST + 1 : FIRST + 200] = value[FIRST]
    return value


def wrong_bytes(value: np.ndarray) -> np.ndarray:
    value[50::150] += 2.0
    return value


def another_marker(value: np.ndarray) -> np.ndarray:
    away = rotation.from_rotation_vector(np.array([0.3, 1.0, 2.0]))
    value[FIRST : FIRST + 5] = rotation.multiply(value[FIRST : FIRST + 5], away)
    return value


def clips(value: np.ndarray) -> np.ndarray:
    end = 0.5 * np.abs(value).max()
    return np.clip(value, -end, end)


def holds(value: np.ndarray) -> np.ndarray:
    return value[np.arange(len(value)) // 10 * 10]


def sticks(value: np.ndarray) -> np.ndarray:
    value[FIRST : FIRST + 500, 1] = value[FIRST, 1]
    return value


FAULTS = {
    "clips and holds": {
        "gyro": (clips, "the end of its range"),
        "attitude": (holds, "and its fresh samples are used"),
    },
    "sticks and hangs": {
        "gyro": (sticks, "have y stuck at one value"),
        "attitude": (hangs, "repeat one that was read before"),
    },
    "hangs and takes another marker": {
        "gyro": (hangs, "repeat one that was read before"),
        "attitude": (another_marker, "lie far off the ones before and after"),
    },
    "wrong bytes": {"gyro": (wrong_bytes, "lie far off the ones before and after")},
}


@pytest.mark.slow
@pytest.mark.parametrize("faults", FAULTS.values(), ids=FAULTS)
def test_a_machine_as_stated_stays_healthy_whatever_its_sensors_did_at_times(sads, log, faults):
    bad = log
    for stream, (change, _) in faults.items():
        bad = spoiled(bad, stream, change)
    found = diagnose([bad], sads)
    assert found.verdict == "healthy"
    repairs = found.recordings[0].repairs
    assert len(repairs) == len(faults)
    findings = contents_of("a log", bad, sads).findings
    for stream, (_, words) in faults.items():
        (said,) = (one for one in repairs if stream in one)
        assert words in said
        assert f"{said}." in findings


def test_wheels_beside_a_gyro_with_long_gaps_are_read_as_they_are(sads, log):
    """It clips for seconds; between its samples the rate is not a straight line."""
    clipped = usable(spoiled(log, "gyro", clips), sads)
    assert np.diff(clipped["gyro"].time).max() > 1.0
    assert not check_conventions(clipped, sads)


def test_a_good_log_is_left_as_it_is(log):
    assert cleaned(log) == log


def test_what_is_left_out_is_counted(log):
    kept = cleaned(spoiled(log, "gyro", wrong_bytes))
    lost = len(log["gyro"]) - len(kept["gyro"])
    assert kept.repairs[0].startswith(f"{lost} of {len(log['gyro'])} samples of gyro, from ")
