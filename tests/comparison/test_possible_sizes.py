"""Departures have sizes that are possible, and logs that no model follows end in a sentence."""

import numpy as np
import pytest

import twin
from twin.platform import load_platform
from twin.recording import Recording, Series


def _pushed(seed: int) -> Recording:
    """9 s of a one-wheel satellite that hands push, a stalled wheel beside it."""
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0.0, 9.0, 170))
    rate = np.zeros_like(time)
    for start in rng.uniform(0.5, 8.0, 5):
        since = np.clip(time - start, 0.0, None)
        rate += (since > 0.0) * rng.normal(0.0, 4.0) * np.exp(-since / rng.uniform(0.1, 0.5))
    wheel = 0.1 * np.round(rng.normal(0.0, 10.0, len(time)))
    duty = np.clip(0.1 * rate, -1.0, 1.0)
    provenance = {"platform": "vnucec_cubesat", "kind": "log"}
    return Recording(
        {
            "joint_rate": Series(time, rate[:, None], ("line",), "rad/s"),
            "wheel_speed": Series(time, wheel[:, None], ("wheel",), "rad/s"),
            "command_wheel_duty": Series(time, duty[:, None], ("wheel",), "1"),
        },
        provenance,
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_clock_is_late_by_half_a_log_and_no_scale_is_a_sign(seed):
    comparison = twin.compare(_pushed(seed), load_platform("vnucec_cubesat"))
    for side in (comparison.as_built, comparison.refitted):
        if side is None:
            continue
        for strength in side.strengths:
            assert strength.symptom.is_possible(strength.values), strength.symptom.name
            if strength.symptom.unit == "s":
                assert np.all(np.abs(strength.values) <= 0.9)
            if strength.symptom.name.endswith("scale_factor"):
                assert np.all(strength.values > -1.0)
