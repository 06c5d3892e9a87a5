"""What pushes at one frequency is found there, be it slower than a stretch of the prediction."""

from dataclasses import replace
from functools import cache

import numpy as np

from twin.clock import SimulatedClock
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import candidate, ringing
from twin.diagnosis.engine import search_from
from twin.diagnosis.explanation import Explanation
from twin.diagnosis.residual_test import slow_line_of
from twin.effects import catalogue
from twin.flight import prepare
from twin.platform import load_platform
from twin.recording import Recording
from twin.stream.recorder import MemoryRecorder

SEED = 20261122
SLOW = 0.052
"""Of a push, a period longer than a stretch [Hz]."""


def flown(frequency: float | None) -> Recording:
    kind = next(kind for kind in catalogue() if kind.name == "room_draft")
    draft = replace(kind.typical(), force=(3e-3, 2e-3, 1e-3), frequency=frequency or 1.0)
    flight = prepare(
        "sads",
        controller="quaternion_pd",
        estimator="filter",
        plant="sim",
        reference="multisine:3",
        duration=60.0,
        seed=SEED,
        effects=() if frequency is None else (draft,),
    )
    recorder = MemoryRecorder(flight.platform, {"platform": "sads", "source": f"seed {SEED}"})
    flight.fly(SimulatedClock(), [recorder])
    return recorder.recording().without_truth()


@cache
def plain_at(frequency: float | None) -> Explanation:
    """The machine without causes, of a log in which something pushes at a frequency."""
    return baseline_of([flown(frequency)], load_platform("sads"))


def test_a_push_slower_than_a_stretch_is_found_at_its_frequency():
    (found,) = slow_line_of(plain_at(SLOW))
    assert abs(found - SLOW) < 1.0 / 60.0


def test_where_nothing_pushes_no_line_is_found():
    print("seed", SEED)
    assert slow_line_of(plain_at(None)) == ()


def test_of_where_a_push_acts_only_what_the_log_tells_is_fitted():
    platform = load_platform("sads")
    kind = next(kind for kind in catalogue() if kind.name == "room_draft")
    plain = plain_at(SLOW)
    asked = ringing([candidate(kind.typical().absent(), platform)], [0.05], plain.bodies)
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
