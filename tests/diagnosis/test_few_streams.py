"""Logs of labs that have not every sensor: what is left of them is enough for a verdict."""

from dataclasses import replace

import numpy as np
import pytest

from twin.diagnosis import diagnose
from twin.platform import load_platform
from twin.recording import Recording

TELL_MORE = ("attitude", "inclinometer", "magnetometer")


def without(log: Recording, *names: str) -> Recording:
    kept = {n: s for n, s in log.streams.items() if n not in names}
    return replace(log, streams={n: s for n, s in kept.items() if not n.startswith("estimate")})


@pytest.mark.slow
def test_gyro_and_accelerometer_are_enough_though_nothing_tells_the_heading(flight_of, drawn_seed):
    log = without(flight_of("tas2", "cmg_pd", "multisine:3", 10.0, drawn_seed), *TELL_MORE)
    found = diagnose([log], load_platform("tas2"))
    assert found.verdict == "healthy"


@pytest.mark.slow
def test_a_friction_is_named_and_sized_by_motion_capture_alone(flight_of, drawn_seed):
    damping = float(np.random.default_rng(drawn_seed).uniform(0.06, 0.15))
    hidden = f"bearing_viscous_friction={damping}"
    log = without(
        flight_of("sads", "quaternion_pd", "multisine:5", 40.0, drawn_seed, hidden), "gyro"
    )
    found = diagnose([log], load_platform("sads"))
    (cause,) = found.causes
    assert cause.effect.label == "bearing_viscous_friction"
    # 1 of 600 right intervals ends before that
    assert abs(float(cause.effect.values[0]) - damping) < 1.6 * float(cause.half_widths[0])
