"""The fit of a device's clock holds the truth in its interval, whatever the delays."""

import numpy as np
import pytest

from twin.plant.devices.host_time import ClockFit

HOST = 98_765.4
"""Host's clock as it begins [s]."""


def fitted(
    seed: int,
    *,
    drift: float = 4e-5,
    duration: float = 60.0,
    way_out: float = 1e-3,
    way_back: float = 1e-3,
    spike: float = 0.02,
    samples: bool = True,
) -> tuple[ClockFit, float]:
    """A fit over delays that are never shorter than stated, and its error at the end [s]."""
    rng = np.random.default_rng(seed)
    fit = ClockFit()

    def device(host: float) -> float:
        return 1000.0 + (host - HOST) * (1.0 + drift)

    def delay(least: float) -> float:
        return least + rng.exponential(0.2e-3) + (rng.random() < 0.1) * spike * rng.random()

    now = HOST
    while now < HOST + duration:
        there = now + delay(way_out)
        answered = there + 2e-4
        fit.exchange(now, device(there), device(answered), answered + delay(way_back))
        for _ in range(10 if samples else 0):
            now += 0.05
            fit.arrival(device(now), now + delay(way_back))
        now += 0.0 if samples else 0.5
    estimate = fit.estimate
    assert estimate is not None
    return fit, estimate.host(device(now)) - now


@pytest.mark.parametrize("drift", [-5e-3, -4e-5, 0.0, 4e-5, 5e-3])
@pytest.mark.parametrize("seed", range(5))
def test_offset_and_drift_lie_in_their_intervals(seed: int, drift: float):
    fit, error = fitted(seed, drift=drift)
    estimate = fit.estimate
    assert estimate is not None
    assert fit.restarts == 0
    assert abs(error) < estimate.half_width + 0.6 * estimate.drift_half_width
    assert abs(1.0 / (1.0 + drift) - 1.0 - estimate.drift) < estimate.drift_half_width
    assert estimate.half_width < 2e-3, "two ways of a millisecond leave no more than this open"
    assert estimate.drift_half_width < 1e-4


def test_a_line_that_is_slower_one_way_stays_within_the_interval():
    fit, error = fitted(3, way_out=8e-3, way_back=1e-3)
    assert fit.estimate is not None
    assert 2e-3 < abs(error) < fit.estimate.half_width


def test_more_time_narrows_the_drift():
    early, late = fitted(1, duration=5.0)[0].estimate, fitted(1, duration=60.0)[0].estimate
    assert early is not None
    assert late is not None
    assert late.drift_half_width < 0.2 * early.drift_half_width


def test_a_clock_that_jumps_is_noticed_and_fitted_anew():
    fit, _ = fitted(0)
    now = HOST + 100.0
    fit.exchange(now, 5.0, 5.0001, now + 2e-3)
    assert fit.restarts == 1
    assert fit.estimate is not None
    assert fit.estimate.host(5.0) == pytest.approx(now + 1e-3, abs=1e-3)


def test_what_is_kept_does_not_grow_with_time():
    fit, _ = fitted(2, duration=300.0, samples=False)
    assert len(fit._early) + len(fit._late) < 140
    assert fit.restarts == 0
