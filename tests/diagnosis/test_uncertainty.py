"""Of an effect that no log tells whole, intervals are of what logs do tell; the rest is told beside
what is taken for granted."""

from dataclasses import replace

import numpy as np
import pytest

from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.cause import Cause, uncertainties_of
from twin.diagnosis.experiment import SimulatedRun
from twin.effects import effect_named, with_effects
from twin.identification.prediction_error import NORMAL
from twin.platform import load_platform
from twin.report.diagnosed import cause_sentence

FARTHER = 1.4
"""Times as far away as it is, a draft is taken to push."""
SEED = 20261124
SADS = load_platform("sads")


def fitted(hidden, guess, seconds=40.0):
    """An effect of the catalogue as a log of it has it, begun from a guess."""
    excitation = SimulatedRun(SADS, "quaternion_pd", seconds, "multisine:5")
    log = excitation.flown(with_effects(SADS, (hidden,)), seed=1)
    assert log is not None
    return baseline_of([log.without_truth()], SADS).instead([guess])


@pytest.fixture(scope="module")
def hidden():
    rng = np.random.default_rng(SEED)
    return replace(
        effect_named("room_draft").typical(),
        point=tuple(rng.uniform(-0.4, 0.4, 3)),
        force=tuple(rng.choice([-1.0, 1.0], 3) * rng.uniform(0.05, 0.1, 3)),
        frequency=rng.uniform(0.1, 0.3),
    )


@pytest.fixture(scope="module")
def draft(hidden):
    point, force = np.array(hidden.point), np.array(hidden.force)
    return fitted(hidden, replace(hidden, point=tuple(FARTHER * point), force=tuple(0.7 * force)))


def test_a_force_at_an_unknown_place_is_told_only_beside_the_place(draft, hidden):
    (known,) = uncertainties_of(draft)
    of_force = np.array([name.startswith("force") for name in draft.effects[0].names])
    print(draft.effects[0].words(), hidden.words(), known)
    assert known.leaning[of_force].all()


def test_what_a_log_tells_of_it_whatever_the_place_has_an_interval_that_holds(draft, hidden):
    (known,), (effect,), (free,) = uncertainties_of(draft), draft.effects, draft.free
    sure = free & ~known.leaning
    sure[[effect.names.index(name) for name in ("frequency", "phase")]] = True
    error = np.abs(effect.values - hidden.values)[sure]
    assert np.all(error < 4.0 * known.deviations[sure]), error / known.deviations[sure]


def test_a_sentence_says_what_a_force_is_told_beside(draft):
    (known,), (effect,), (free,) = uncertainties_of(draft), draft.effects, draft.free
    beside = NORMAL * known.deviations
    half = np.where(known.leaning, np.nan, beside)
    text = cause_sentence(Cause(effect, free, half, beside, 20.0, 20.0, 0.9, ()))
    first, _, second = text.partition("taking point")
    assert "force" not in first
    assert "force" in second.partition("which no log identifies: ")[2]


def test_what_leans_on_a_shape_of_another_cause_is_told_beside_that():
    effect = effect_named("center_of_mass_drift").typical()
    beside = np.full(3, 1e-7)
    half = np.array([1e-7, np.nan, 1e-7])
    cause = Cause(effect, np.ones(3, dtype=bool), half, beside, 20.0, 20.0, 0.9, ())
    assert "as the other causes are taken: rate_y" in cause_sentence(cause)


def test_what_one_size_says_whole_leans_on_nothing():
    harness = effect_named("harness_stiffness").typical().with_values(np.array([0.05]))
    now = fitted(harness, harness)
    (known,), (spread,) = uncertainties_of(now), now.covariances
    assert not known.leaning.any()
    assert known.deviations == pytest.approx(np.sqrt(np.diag(spread)), rel=1e-3)


def test_a_wheel_askew_is_told_by_the_smallest_turn_whatever_the_guess_turned_about_its_own_axis():
    across = (0.0, 6e-3, -4e-3)
    kind = effect_named("wheel_misalignment").typical()
    hidden, guess = (
        replace(kind, target="w1", rotation=turn) for turn in (across, (0.5, *across[1:]))
    )
    found = fitted(hidden, guess, 60.0)
    (known,), least = uncertainties_of(found), found.effects[0].least(SADS)
    print(least.words(), known)
    assert np.isnan(known.deviations).tolist() == [True, False, False]
    error = np.abs(least.values - across)
    assert error[0] < 1e-12
    assert np.all(error[1:] < 4.0 * known.deviations[1:])
    assert np.all(known.deviations[1:] < 0.5 * np.abs(across[1:]))
