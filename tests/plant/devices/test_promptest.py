"""Samples that a host reads late, or many at once, keep the distances at which they were taken."""

import numpy as np
import pytest

from twin.plant.devices.xbus import Promptest

OFFSET = 500.0
"""Of the host's clock to the device's [s]."""


def dated(stamps, delays, drift=0.0):
    clock = Promptest()
    true = OFFSET + (1.0 + drift) * np.asarray(stamps)
    return np.array([clock.host(s, t + d) for s, t, d in zip(stamps, true, delays, strict=True)])


def test_bursts_are_spread_again():
    stamps = 0.01 * np.arange(400)
    # the first comes at once, then each tenth brings those before it
    delays = np.array([0.001] + [0.01 * (9 - k % 10) + 0.001 for k in range(1, 400)])
    times = dated(stamps, delays)
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-9)
    np.testing.assert_allclose(times, OFFSET + stamps + 0.001, atol=1e-9)


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_a_drifting_clock_is_followed_within_what_it_drifts_in_the_span(drift):
    stamps = 0.01 * np.arange(6000)
    delays = np.random.default_rng(0).exponential(0.003, 6000)
    times = dated(stamps, delays, drift)
    error = times - OFFSET - (1.0 + drift) * stamps
    assert np.all(error[500:] > -1.1e-3)
    assert np.all(error[500:] < 1.1e-3)


def test_times_never_run_back_when_a_prompter_sample_comes():
    delays = [0.05, 0.03, 0.0, 0.0, 0.02, 0.0]
    times = dated(0.01 * np.arange(6), delays)
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] == pytest.approx(OFFSET + 0.05, abs=1e-3)


def test_a_clock_that_has_stepped_is_laid_against_ours_anew():
    clock = Promptest()
    clock.host(0.0, OFFSET)
    clock.forget()
    assert clock.host(100.0, OFFSET + 0.01) == pytest.approx(OFFSET + 0.01)
