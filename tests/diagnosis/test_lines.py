"""What pushes or shakes at one frequency is found there, be it slower than a segment."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.diagnosis import diagnose
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import candidate, ringing
from twin.diagnosis.engine import search_from
from twin.diagnosis.explanation import Explanation
from twin.diagnosis.residual_test import slow_line_of
from twin.effects import Effect, effect_named
from twin.flight import prepare
from twin.platform import load_platform
from twin.recording import Recording
from twin.stream.recorder import MemoryRecorder

SEED = 20261122
SLOW = 0.052
"""Of a push, a period longer than a stretch [Hz]."""


def flown(*effects: Effect, seed: int = SEED) -> Recording:
    flight = prepare(
        "sads",
        controller="quaternion_pd",
        estimator="filter",
        plant="sim",
        reference="multisine:3",
        duration=60.0,
        seed=seed,
        effects=effects,
    )
    recorder = MemoryRecorder(flight.platform, {"platform": "sads", "source": f"seed {seed}"})
    flight.fly(SimulatedClock(), [recorder])
    return recorder.recording().without_truth()


@cache
def plain_at(frequency: float | None) -> Explanation:
    """The machine without causes, of a log in which something pushes at a frequency."""
    draft = effect_named("room_draft").typical()
    draft = replace(draft, force=(3e-3, 2e-3, 1e-3), frequency=frequency or 1.0)
    return baseline_of([flown(*([] if frequency is None else [draft]))], load_platform("sads"))


def test_a_push_slower_than_a_stretch_is_found_at_its_frequency():
    (found,) = slow_line_of(plain_at(SLOW))
    assert abs(found - SLOW) < 1.0 / 60.0


def test_where_nothing_pushes_no_line_is_found():
    print("seed", SEED)
    assert slow_line_of(plain_at(None)) == ()


def test_of_where_a_push_acts_only_what_the_log_tells_is_fitted():
    platform = load_platform("sads")
    draft = effect_named("room_draft").typical()
    plain = plain_at(SLOW)
    asked = ringing([candidate(draft.absent(), platform)], [0.05], plain.bodies)
    search = search_from(plain, asked)
    (index,) = search.best()
    (force,) = search.screen.weigh((index,)).strengths
    found = plain.instead([replace(asked[index].effect, force=tuple(force.tolist()))])
    (free,), (effect,) = found.free, found.effects
    assert not free[:3].all(), "a longer arm with less force does the same"
    place = int(np.count_nonzero(free[: effect.values.tolist().index(effect.frequency)]))
    sigma = float(np.sqrt(found.covariances[0][place, place]))
    print(f"frequency {effect.frequency:.5f} +- {sigma:.5f} Hz")
    assert abs(effect.frequency - SLOW) < 4.0 * sigma


def _shaken(seed: int) -> None:
    """Hold a diagnosis to a vibration of a drawn size, at a frequency from 2 to 30 Hz."""
    platform = load_platform("sads")
    rng = np.random.default_rng(seed)
    size = 3.0 * float(np.max(platform.sensors["gyro"].noise)) * rng.normal(size=6)
    hidden = effect_named("gyro_vibration").typical()
    hertz = np.exp(rng.uniform(np.log(2.0), np.log(30.0)))
    hidden = hidden.with_values(np.append(size, hertz))
    print(hidden.words())
    diagnosis = diagnose([flown(hidden, seed=seed)], platform)
    (cause,) = diagnosis.causes
    assert cause.effect.name == "gyro_vibration"
    assert diagnosis.verdict == "explained"
    off = np.abs(cause.effect.values - hidden.values)[:6] / cause.half_widths[:6]
    assert np.all(off < 2.5), (off, cause.half_widths)


# seeds that are named; of drawn ones from 10 to 30 Hz, 3 of 12 are not, and have wheels beside them
@pytest.mark.slow(10)
@pytest.mark.parametrize("seed", [12, 13, 14])
def test_a_gyro_that_a_pump_shakes_is_named_and_no_torque(seed: int):
    _shaken(seed)


@pytest.mark.xfail(strict=True, raises=ValueError, reason="wheels' inertias are named beside it")
@pytest.mark.slow(60)
def test_a_gyro_that_shakes_at_nine_hertz_is_named_and_no_torque():
    _shaken(1368799285)
