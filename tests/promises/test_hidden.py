"""What is hidden in a log is found: named, sized, worth what it should be. Seeds are printed.

`panel.py` beside this file does the same many times and counts.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from twin.diagnose import Diagnosis, diagnose

SEED = 20261121

_spec = importlib.util.spec_from_file_location("hidden", Path(__file__).parent / "hidden.py")
assert _spec is not None
assert _spec.loader is not None
hidden = importlib.util.module_from_spec(_spec)
sys.modules["hidden"] = hidden
_spec.loader.exec_module(hidden)

SHORT = hidden.Bench(duration=60.0)
LONG = hidden.Bench(duration=120.0)


def diagnosed(bench, effects, seed: int) -> Diagnosis:
    print(f"hidden: {[effect.words() for effect in effects]}, seed {seed}")
    secret = hidden.hide(bench, tuple(effects), seed)
    assert secret is not None
    found = diagnose([secret.log], secret.believed)
    print(found.verdict, [cause.effect.words() for cause in found.causes])
    return found


def named(found: Diagnosis) -> list[set[str]]:
    return [{cause.effect.label, *(t.label for t in cause.ties)} for cause in found.causes]


@pytest.mark.parametrize(
    "seed", [SEED, *(pytest.param(SEED + i, marks=pytest.mark.slow) for i in range(1, 5))]
)
def test_an_effect_drawn_at_random_is_named_and_sized(seed):
    effect = hidden.any_of(SHORT, 6000.0, np.random.default_rng(seed))
    found = diagnosed(SHORT, [effect], seed)
    (members,) = named(found)
    assert effect.label in members
    (cause,) = found.causes
    if cause.effect.label == effect.label:
        sure = np.isfinite(cause.half_widths)
        error = np.abs(cause.effect.values - effect.values)[sure]
        assert np.all(error < 2.0 * cause.half_widths[sure]), "four standard deviations off"
    assert found.remainder.chance > 1e-4
    assert found.held_out.log_likelihood > 0.5 * 0.8 * 6000.0 * 0.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", [SEED + 10, SEED + 11, SEED + 12])
def test_where_nothing_is_hidden_nothing_is_named(seed):
    found = diagnosed(LONG, [], seed)
    assert found.verdict == "healthy"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [SEED + 20, SEED + 21])
def test_of_a_pair_both_are_named(seed):
    rng = np.random.default_rng(seed)
    one, other = (hidden.any_of(LONG, 6000.0, rng) for _ in range(2))
    while other.label == one.label:
        other = hidden.any_of(LONG, 6000.0, rng)
    found = diagnosed(LONG, [one, other], seed)
    for effect in (one, other):
        assert any(effect.label in members for members in named(found))


@pytest.mark.slow
def test_what_the_catalogue_lacks_is_unexplained_and_given_as_an_equation():
    found = diagnosed(LONG, [hidden.Nameless(size=6.0)], SEED + 30)
    assert found.verdict == "unexplained"
    assert found.equation is not None
    law = found.equation.laws[int(np.argmax(np.abs(found.equation.coefficients)))]
    assert law.label == "torque_x ~ rate_x rate_z"
    assert found.held_out.log_likelihood > 0.0
    assert all(cause.confidence < 0.9 for cause in found.causes)
