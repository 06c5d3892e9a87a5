"""What a table feels of a mass tells its play better than the counter that rounds it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from papers.flown import flown
from twin.controller import AnyController, Controller, load_controller
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import candidate
from twin.diagnosis.explanation import Explanation
from twin.effects import with_effects
from twin.effects.actuators import StageBacklash
from twin.effects.sensors import ClockDrift
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.signals import Command, Estimate, Target

DIGIT = 1e-6
"""[m] of the counter."""
FINE = 1e-4
"""[rad/s, rad] of gyro and attitude."""
SEED = 20261122


@dataclass(frozen=True)
class Swaying(Controller[Any]):
    """Holds level by wheels while a mass goes to and fro."""

    law: AnyController

    def init(self, platform: Platform, n: int) -> Any:
        return self.law.init(platform, n)

    def update(
        self, state: Any, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Any]:
        command, state = self.law.update(state, estimate, target, time)
        place = np.zeros((len(estimate.attitude), 3))
        place[:, 1] = 3e-4 * np.sin(0.3 * time)
        return {**command, "command_stage_position": place}, state


@pytest.fixture(scope="module")
def platform() -> Platform:
    shipped = load_platform("whorl2")
    noisy = {"gyro", "attitude"}
    sensors = {
        name: replace(one, noise=np.full_like(one.noise, FINE)) if name in noisy else one
        for name, one in shipped.sensors.items()
    }
    return replace(shipped, sensors=sensors)


@pytest.fixture(scope="module")
def play() -> StageBacklash:
    width = np.random.default_rng(SEED).uniform(20.0, 30.0) * DIGIT
    print(f"seed {SEED}: {width:.4g} m")
    return StageBacklash(target="s2", width=float(width))


@pytest.fixture(scope="module")
def log(platform: Platform, play: StageBacklash) -> Recording:
    law = Swaying(load_controller("quaternion_pd"))
    run = flown(with_effects(platform, [play]), law, 40.0, record=True)
    return run.recordings[0].without_truth()


@pytest.fixture(scope="module")
def plain(platform: Platform, log: Recording) -> Explanation:
    return baseline_of([log], platform)


@pytest.fixture(scope="module")
def fitted(plain: Explanation, play: StageBacklash) -> Explanation:
    return plain.instead([play])


@pytest.mark.slow
def test_a_play_is_sized_to_a_fraction_of_the_counter_s_digit(plain, play):
    guess = play.with_values(1.1 * play.values)
    found = plain.instead([guess])
    (effect,), (spread,) = found.effects, found.covariances
    sigma = float(np.sqrt(spread[0, 0]))
    off = float(effect.values[0] - play.width)
    print(f"off by {off:.2g} +- {1.96 * sigma:.2g} m")
    assert sigma < 0.3 * DIGIT
    assert abs(off) < 4.0 * sigma


def test_it_is_missed_by_all_of_its_evidence(plain, fitted):
    weighed = fitted.weigh([], []).weigh(fitted.own)
    assert weighed.gain == pytest.approx(plain.cost - fitted.cost, rel=0.2)


def test_unfitted_it_promises_what_its_fit_brings(platform, plain, fitted, play):
    usual = candidate(play.typical("s2").absent(), platform)
    promised = plain.screen([usual]).weigh((0,)).gain
    assert promised == pytest.approx(plain.cost - fitted.cost, rel=0.2)


@pytest.mark.slow
def test_counters_whose_clock_drifts_leave_nothing_of_what_the_masses_do(platform):
    drift = ClockDrift(target="stage_position", drift=2e-3)
    law = Swaying(load_controller("quaternion_pd"))
    both = ([], [drift])
    runs = [flown(with_effects(platform, some), law, 40.0, record=True) for some in both]
    right, wrong = (baseline_of([run.recordings[0].without_truth()], platform) for run in runs)
    found = wrong.instead([replace(drift, drift=1e-3)])
    (effect,), sigma = found.effects, float(np.sqrt(found.covariances[0][0, 0]))
    print(f"{effect.values[0]:.3g} +- {sigma:.2g}, cost {found.cost - right.cost:.1f} more")
    assert wrong.cost > right.cost + 50.0
    assert found.cost < right.cost + 15.0
    assert abs(effect.values[0] - 2e-3) < 4.0 * sigma
