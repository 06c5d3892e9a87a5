"""Logs of labs that have not every sensor: what is left of them is enough for a verdict."""

from dataclasses import replace

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.diagnose import diagnose
from twin.effects import parse_effects
from twin.flight import prepare
from twin.platform import load_platform
from twin.recording import Recording
from twin.stream.recorder import MemoryRecorder

TELL_MORE = ("attitude", "inclinometer", "magnetometer")


def flown(platform: str, law: str, reference: str, hidden: str, seed: int) -> Recording:
    flight = prepare(
        platform, controller=law, estimator=None, plant="sim", reference=reference, duration=40.0,
        seed=seed, effects=parse_effects(hidden) if hidden else [],
    )  # fmt: skip
    memory = MemoryRecorder(flight.platform, {"platform": platform, "source": f"seed {seed}"})
    flight.fly(SimulatedClock(), [memory])
    return memory.recording().without_truth()


def without(log: Recording, *names: str) -> Recording:
    kept = {n: s for n, s in log.streams.items() if n not in names}
    return replace(log, streams={n: s for n, s in kept.items() if not n.startswith("estimate")})


@pytest.fixture
def seed() -> int:
    seed = int(np.random.default_rng().integers(2**31))
    print("seed", seed)
    return seed


@pytest.mark.slow
def test_gyro_and_accelerometer_are_enough_though_nothing_tells_the_heading(seed: int):
    log = without(flown("tas2", "cmg_pd", "multisine:3", "", seed), *TELL_MORE)
    found = diagnose([log], load_platform("tas2"))
    assert found.verdict == "healthy"


def test_a_friction_is_named_and_sized_by_motion_capture_alone(seed: int):
    damping = float(np.random.default_rng(seed).uniform(0.06, 0.15))
    hidden = f"bearing_viscous_friction={damping}"
    log = without(flown("sads", "quaternion_pd", "multisine:5", hidden, seed), "gyro")
    found = diagnose([log], load_platform("sads"))
    (cause,) = found.causes
    assert cause.effect.label == "bearing_viscous_friction"
    # 1 of 600 right intervals ends before that
    assert abs(float(cause.effect.values[0]) - damping) < 1.6 * float(cause.half_widths[0])
