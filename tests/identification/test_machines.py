"""Every kind of drive is predicted: machines give away a base that nobody stated."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from twin.identification import Identification, identify
from twin.platform import load_platform
from twin.recording import Recording

SEED = 20261121
SECONDS = 20.0

MACHINES = {
    "tas2": "control moment gyros, masses",
    "cubesat": "coils in the field, masses on stepper motors",
    "whorl1": "thrusters, wheels, masses",
    "astros": "wheels on gimbals, thrusters, masses, a gyro behind a low-pass",
    "astros:mode_c": "on a stage that floats away",
}
SLOW = ("astros:mode_c",)


def squared_distance(found: Identification, truth: np.ndarray) -> float:
    """Of J and m r from the truth (9,), in the metric of their covariance."""
    error = found.theta[:9] - truth
    return float(error @ np.linalg.solve(found.covariance[:9, :9], error))


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in MACHINES],
)
def test_a_machine_gives_away_its_base(name: str, excited: Callable[..., Any]):
    # A stop's push is predicted to no more than its softness; a motor's shaking is not white.
    stated = replace(load_platform(name), tilt_limit=np.pi, pitch_stop=None, effects=())
    flown = excited(stated, 1, SEED, SECONDS)
    found = identify(flown.logs, stated)
    distance = squared_distance(found, flown.truth)
    left = found.misfit[0]
    print(f"{name}, seed {SEED}: squared distance {distance:.1f}, 9 is due; {left}")
    assert not found.not_used
    assert left.is_noise, "the machine moves otherwise than predicted"
    assert distance < chi2.ppf(0.999, 9), "found, but not where its intervals say"
    assert (found.half_widths[:9] < 0.1 * found.base.scale[:9]).all(), "its intervals say nothing"


FAULTS = {
    "gimbal_friction": (0.01, 0.04),  # N m
    "gimbal_backlash": (5e-4, 4e-3),  # rad
}


@pytest.mark.parametrize("fault", FAULTS)
def test_gimbals_that_do_not_do_as_told_do_not_lead_the_base_astray(
    fault: str, excited: Callable[..., Any]
):
    low, high = FAULTS[fault]
    seed = SEED + 1 + list(FAULTS).index(fault)
    size = np.random.default_rng(seed).uniform(low, high)
    stated = replace(load_platform("tas2"), tilt_limit=np.pi, pitch_stop=None, effects=())
    flown = excited(stated, 1, seed, SECONDS, f"{fault}={size}")
    found = identify(flown.logs, stated)
    distance = squared_distance(found, flown.truth)
    left = found.misfit[0]
    print(f"{fault} {size:.3g}, seed {seed}: squared distance {distance:.1f}, 9 is due; {left}")
    assert "did not go where command_gimbal_rate says" in found.not_used[0]
    assert left.is_noise, "the machine moves otherwise than predicted"
    assert distance < chi2.ppf(0.999, 9), "found, but not where its intervals say"
    assert (found.half_widths[:9] < 0.1 * found.base.scale[:9]).all(), "its intervals say nothing"


def test_stages_that_come_late_do_not_lead_the_base_astray(excited: Callable[..., Any]):
    """As over a line that they share: each told in its turn, and seen a few times in a move."""
    seed = SEED + 3
    rng = np.random.default_rng(seed)
    late = rng.uniform(0.05, 0.2, 3)
    stated = replace(load_platform("astros"), tilt_limit=np.pi, pitch_stop=None, effects=())
    flown = excited(stated, 1, seed, SECONDS)
    found = identify([_seen_late(flown.logs[0], late, rng)], stated)
    distance = squared_distance(found, flown.truth)
    left = found.misfit[0]
    print(f"{late} s, seed {seed}: squared distance {distance:.1f}, 9 is due; {left}")
    assert left.is_noise, "the machine moves otherwise than predicted"
    assert found.disturbance == 0.0
    assert distance < chi2.ppf(0.999, 9), "found, but not where its intervals say"
    assert (found.half_widths[:9] < 0.1 * found.base.scale[:9]).all(), "its intervals say nothing"


def _seen_late(log: Recording, late: np.ndarray, rng: np.random.Generator) -> Recording:
    """As if each stage had been told so much earlier [s]; of five readings one is lost, and the
    others are stamped a few milliseconds off."""
    told, seen = log["command_stage_position"], log["stage_position"]
    ahead = np.stack([told.held_at(told.time + s)[:, i] for i, s in enumerate(late)], axis=1)
    read = np.sort(rng.choice(len(seen), 4 * len(seen) // 5, replace=False))
    stamps = seen.time[read] + rng.normal(0.0, 0.003, len(read))
    streams = {
        "command_stage_position": replace(told, value=ahead),
        "stage_position": replace(seen, time=stamps, value=seen.value[read]),
    }
    return replace(log, streams={**log.streams, **streams})


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
def test_a_swing_is_found_from_far_off(seed: int, swung: Callable[..., Any]):
    """Neither the momentum nor the machine as stated begins near enough for so sharp sensors."""
    flown = swung(load_platform("astros"), seed, 40.0)
    found = identify(flown.logs, flown.stated)
    distance = squared_distance(found, flown.truth)
    left = found.misfit[0]
    print(f"seed {seed}: squared distance {distance:.1f}, 9 is due; {left}")
    assert left.is_noise
    assert found.disturbance == 0.0
    assert distance < chi2.ppf(0.999, 9)
