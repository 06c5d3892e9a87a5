"""An encoder that is uneven around the turn is named, with the number of its waves."""

import numpy as np
import pytest

from twin.contrast import moved
from twin.diagnosis import diagnose
from twin.effects import effect_named
from twin.platform import load_platform

LENGTH = 20.0


@pytest.mark.slow(60)
def test_waves_of_an_encoder_are_named_counted_and_sized(drawn_seed):
    pendulum = load_platform("dfki_pendulum")
    rng = np.random.default_rng(drawn_seed)
    # from a sample's noise on; the residual of one half as large may pass for noise
    size, phase = np.exp(rng.uniform(np.log(1e-3), np.log(5e-3))), rng.uniform(0.0, 2.0 * np.pi)
    # this swing shows two of 14 waves; of fewer, less of a larger wave fits as well
    waves = int(rng.integers(14, 31))
    values = np.array([size * np.cos(phase), size * np.sin(phase), waves])
    hidden = effect_named("encoder_error").typical().with_values(values)
    print(hidden.words())
    found = diagnose([moved(pendulum, (hidden,), LENGTH, seed=drawn_seed)], pendulum)
    (cause,) = found.causes
    assert cause.effect.name == "encoder_error"
    assert found.verdict == "explained"
    off = np.abs(cause.effect.values - values)
    assert np.all(off < 2.5 * cause.half_widths), (off, cause.half_widths)
    assert cause.half_widths[2] < 1.0


def test_without_waves_none_are_named(drawn_seed):
    pendulum = load_platform("dfki_pendulum")
    found = diagnose([moved(pendulum, (), LENGTH, seed=drawn_seed)], pendulum)
    assert found.verdict == "healthy"
    assert found.not_asked["encoder_error"] == "nothing is left that repeats with the angle"
