"""Draughts, a straying attitude, lost samples and jitter hide no cause, and are none.

`mess.py` beside this file draws such logs at random and counts.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.diagnosis import diagnose
from twin.diagnosis.baseline import baseline_of
from twin.identification.noise_processes import likely_noise

SEED = 20261128

sys.path.insert(0, str(Path(__file__).parent))
from benches import SHAKEN, Bench  # noqa: E402
from hidden import drawn, hide  # noqa: E402
from mess import Gusts, messed  # noqa: E402

BENCH = Bench(controller=SHAKEN, duration=60.0)
NOISE = 1e-3


def messy(bench: Bench, label: str, rms: float, seed: int):
    """A log with a wandering torque of this size, and a cause if one is given."""
    rng = np.random.default_rng(seed)
    effects = (drawn(bench, label, 6000.0, rng),) if label else ()
    print(f"hidden: {[effect.words() for effect in effects]}, seed {seed}")
    secret = hide(bench, (*effects, Gusts(rms=rms, seed=seed)), seed)
    return effects, replace(secret, log=messed(secret.log, rng, NOISE))


def test_noise_that_wanders_is_sized():
    _, secret = messy(BENCH, "", 3e-4, SEED)
    plain = baseline_of([secret.log], secret.believed)
    noise = likely_noise(plain.problem, plain.prediction)
    print(noise)
    assert noise.torque is not None
    assert 0.6 < noise.torque.rms / 3e-4 < 1.7
    assert 0.5 < noise.torque.time / 3.0 < 2.5
    error = dict(noise.errors)["attitude"]
    assert 0.5 < error.rms / (0.5 * NOISE) < 2.0


def test_white_noise_does_not_wander():
    secret = hide(BENCH, (), SEED + 1)
    plain = baseline_of([secret.log], secret.believed)
    assert not likely_noise(plain.problem, plain.prediction).any


@pytest.mark.slow(80)
def test_a_cause_is_named_and_sized_beside_mess(drawn_seed):
    labels = ["wheel_friction:w2", "bearing_viscous_friction"]
    label = str(np.random.default_rng(drawn_seed).choice(labels))
    (effect,), secret = messy(BENCH, label, 3e-5, SEED + 2)
    found = diagnose([secret.log], secret.believed)
    assert found.verdict in ("explained", "ambiguous")
    (cause,) = found.causes
    assert cause.effect.label == label
    known = np.isfinite(cause.half_widths)
    error = np.abs(cause.effect.values - effect.values)[known]
    assert np.all(error < 2.0 * cause.half_widths[known]), "four standard deviations off"
    assert "attitude" in dict(found.wander.errors)


@pytest.mark.slow(60)
def test_of_mess_alone_nothing_is_named():
    _, secret = messy(BENCH, "", 3e-5, SEED + 3)
    found = diagnose([secret.log], secret.believed)
    assert found.verdict == "healthy"
    assert found.wander.wanders
