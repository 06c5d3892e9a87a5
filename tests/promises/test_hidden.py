"""What is hidden in a log is found: named, sized, worth what it should be. Seeds are printed.

`panel.py` beside this file does the same many times and counts.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.residual_test import residual_test
from twin.effects import effect_named

SEED = 20261121

sys.path.insert(0, str(Path(__file__).parent))
import hidden  # noqa: E402
import scoring  # noqa: E402
from asked import BENCH, diagnosed, named  # noqa: E402
from benches import SHAKEN, Bench, yardstick  # noqa: E402


@pytest.mark.slow
@pytest.mark.parametrize("seed", [SEED + 1])
def test_an_effect_drawn_at_random_is_named_and_sized(seed):
    effect = hidden.any_of(BENCH, 6000.0, np.random.default_rng(seed))
    is_named_and_sized(effect, seed)


@pytest.mark.slow
def test_a_scale_factor_of_the_gyro_is_named_and_sized():
    rng = np.random.default_rng(SEED)
    effect = hidden.drawn(BENCH, "gyro_scale_factor", 6000.0, rng)
    is_named_and_sized(effect, SEED)


@pytest.mark.slow
def test_a_wheel_far_from_its_stated_inertia_is_sized_along_the_motion_that_it_makes():
    """Along the one without it a wheel that is e heavier looks e / (1 + e) heavier."""
    rng = np.random.default_rng(SEED)
    effect = effect_named("wheel_inertia_error").typical("w2")
    is_named_and_sized(replace(effect, error=rng.uniform(0.025, 0.035)), SEED)


def is_named_and_sized(effect, seed: int) -> None:
    found = diagnosed(BENCH, [effect], seed)
    (members,) = named(found)
    assert effect.label in members
    (cause,) = found.causes
    if cause.effect.label == effect.label:
        sure = np.isfinite(cause.half_widths)
        error = np.abs(cause.effect.values - effect.values)[sure]
        assert np.all(error < 2.0 * cause.half_widths[sure]), "four standard deviations off"
    assert found.residual_test.chance > 1e-4
    assert found.held_out.log_likelihood > 0.5 * 0.8 * 6000.0 * 0.5


@pytest.mark.slow
def test_a_nozzle_that_points_far_from_where_it_should_is_named():
    """Its linear column says another direction, from which a fit ends at another nozzle."""
    bench = Bench(controller=SHAKEN, grade="coarse", duration=60.0, reference="multisine:2")
    effect = effect_named("thruster_misalignment").typical("f4z")
    effect = replace(effect, rotation=(-1.42, 0.27, 0.0))
    assert named(diagnosed(bench, [effect], 1203)) == [{effect.label}]


@pytest.mark.slow
def test_of_a_mass_that_stops_short_nothing_is_left_for_a_law_without_a_name():
    """By how hard the steps of its drive push, an accelerometer tells its half from its whole."""
    bench = Bench("tas2", SHAKEN, duration=60.0)
    effect = replace(effect_named("stage_scale").typical("s3"), error=-0.26)
    found = diagnosed(bench, [effect], 1)
    assert found.verdict == "explained"
    assert named(found) == [{effect.label}]


@pytest.mark.slow
def test_a_torque_on_a_body_whose_inertia_nothing_tells_is_named_though_its_size_is_open():
    floating = Bench("whorl2", "free_float", grade="fine", attitude=(45.0, 0.0, 0.0))
    bench = replace(floating, duration=60.0)
    effect = hidden.drawn(bench, "structural_sag", 200.0, np.random.default_rng(SEED))
    found = diagnosed(bench, [effect], SEED + 40)
    assert named(found) == [{"structural_sag"}]
    (cause,) = found.causes
    assert cause.half_widths[0] > 0.5 * abs(cause.effect.values[0])
    assert cause.confidence > 0.9


@pytest.mark.slow(100)
def test_a_weak_push_at_another_frequency_than_usual_is_not_given_the_name_of_what_looks_like_it():
    shaken = Bench("sads", SHAKEN, grade="fine", reference="multisine:2", depth=0.1)
    bench = replace(shaken, rate=25.0, duration=80.0)
    rng, usual = np.random.default_rng(SEED + 42), effect_named("room_draft").typical()
    place = rng.uniform(0.1, 0.3, 3) * rng.choice([-1.0, 1.0], 3)
    push = replace(usual, point=tuple(place), frequency=rng.uniform(0.042, 0.048))
    times = np.sqrt(120.0 / yardstick(bench).evidence(push))
    effect = replace(push, force=tuple(times * np.array(push.force)))
    assert named(diagnosed(bench, [effect], SEED + 42)) == [{"room_draft"}]


@pytest.mark.slow
def test_a_vector_of_which_a_log_shows_one_component_leaves_nothing_in_any_direction():
    bench = Bench("whorl2", "free_float", duration=60.0, attitude=(45.0, 0.0, 0.0))
    effect = hidden.drawn(bench, "residual_dipole", 6000.0, np.random.default_rng(SEED))
    print(effect.words())
    secret = hidden.hide(bench, (effect,), SEED)
    found = baseline_of([secret.log], secret.believed).disturbed().instead([effect])
    print(found.effects[0].words(), found.free)
    assert found.converged
    assert residual_test(found).chance > 1e-3


def test_friction_of_a_wheel_that_stands_still_anyway_is_not_hidden():
    bench = Bench("whorl2", "free_float", duration=20.0, attitude=(45.0, 0.0, 0.0))
    friction = effect_named("wheel_friction").typical("w3").with_values(np.array([1e-6, 1e-4]))
    secret = hidden.hide(bench, (friction,), SEED)
    with pytest.raises(hidden.OutOfReach, match="changes nothing"):
        hidden.check_shown(secret, 600.0)
    hidden.check_shown(secret, 0.01)


def test_what_a_control_law_makes_good_is_hidden_all_the_same():
    gain = effect_named("wheel_torque_gain").typical("w2").with_values(np.array([0.02]))
    secret = hidden.hide(Bench(duration=20.0), (gain,), SEED)
    hidden.check_shown(secret, 6000.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [SEED + 10])
def test_where_nothing_is_hidden_nothing_is_named(seed):
    found = diagnosed(BENCH, [], seed)
    assert found.verdict == "healthy"


@pytest.mark.slow(50)
@pytest.mark.parametrize("seed", [SEED + 20])
def test_of_a_pair_both_are_named(seed):
    rng = np.random.default_rng(seed)
    one, other = (hidden.any_of(BENCH, 6000.0, rng) for _ in range(2))
    while other.label == one.label:
        other = hidden.any_of(BENCH, 6000.0, rng)
    found = diagnosed(BENCH, [one, other], seed)
    for effect in (one, other):
        assert any(effect.label in members for members in named(found))


def test_an_answer_counts_in_full_only_where_nobody_could_know_more():
    assert scoring.single("a", ["a"], []) == 1.0
    assert scoring.single("a", ["b", "a"], ["b"]) == 1.0
    assert scoring.single("a", ["b", "a"], []) == 0.5
    assert scoring.single("a", ["a", "b", "c", "d"], ["b", "c", "d"]) == 0.5
    assert scoring.single("a", ["b"], ["b"]) == 0.0


def test_a_torque_whose_direction_a_dipole_shares_is_its_sibling():
    effect = hidden.drawn(BENCH, "bearing_swirl_torque", 60.0, np.random.default_rng(SEED))
    assert "residual_dipole" in scoring.siblings(scoring.behind(yardstick(BENCH), effect))


def test_two_causes_that_one_of_them_could_be_alone_are_no_pair():
    rng = np.random.default_rng(SEED)
    swirl, dipole, scale = (
        hidden.drawn(BENCH, label, 60.0, rng)
        for label in ("bearing_swirl_torque", "residual_dipole", "gyro_scale_factor")
    )
    assert "residual_dipole" in scoring.stand_ins(yardstick(BENCH), [swirl, dipole])
    assert not scoring.stand_ins(yardstick(BENCH), [swirl, scale])
