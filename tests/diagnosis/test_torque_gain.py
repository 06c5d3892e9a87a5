"""A motor that gives less than its reading says, beside a base that a scale and a ruler tell."""

from dataclasses import replace

import numpy as np
import pytest

from twin.contrast import moved
from twin.conventions.joint import rate_lag
from twin.diagnosis import diagnose
from twin.effects import Effect, effect_named
from twin.platform import Platform, load_platform
from twin.recording import Recording, open_log

LENGTH = 20.0


@pytest.fixture(scope="module")
def pendulum() -> Platform:
    """J known to 5 %, m r to 2.6 %."""
    shipped = load_platform("dfki_pendulum")
    return replace(
        shipped,
        inertia_sd=np.array([7e-3, 7e-3, 1e-5, 1e-5, 1e-5, 1e-5]),
        center_of_mass_offset_sd=np.array([3e-3, 3e-3, 7e-3]),
    )


@pytest.fixture(scope="module")
def weak() -> Effect:
    return replace(effect_named("joint_torque_gain").typical(), error=-0.25)


@pytest.fixture(scope="module")
def log(pendulum, weak) -> Recording:
    return moved(pendulum, (weak,), LENGTH, seed=3)


def test_a_torque_gain_is_named_and_sized_and_the_base_stays_where_it_is_stated(
    pendulum, drawn_seed
):
    rng = np.random.default_rng(drawn_seed)
    gain = replace(effect_named("joint_torque_gain").typical(), error=rng.uniform(-0.4, -0.2))
    print(gain.words())
    found = diagnose([moved(pendulum, (gain,), LENGTH, seed=drawn_seed)], pendulum)
    (cause,) = found.causes
    assert cause.effect.label == gain.label
    assert found.verdict == "explained"
    half = float(cause.half_widths[0])
    assert abs(cause.effect.values[0] - gain.error) < 2.0 * half < 0.1
    moment = found.explained.base.entries(found.explained.at.theta)[8]
    assert moment == pytest.approx(pendulum.center_of_mass_offset[2], abs=0.021)


def test_a_torque_gain_and_a_base_of_which_nothing_is_stated_are_the_same(pendulum, log):
    unsure = replace(pendulum, inertia_sd=None, center_of_mass_offset_sd=None)
    found = diagnose([log], unsure)
    assert found.verdict == "healthy"
    assert "inertia_sd" in found.not_asked["joint_torque_gain"]
    inertia, *_ = found.explained.base.entries(found.explained.at.theta)
    assert inertia == pytest.approx(pendulum.inertia[0, 0] / 0.75, rel=0.02)


def test_time_that_took_no_part_need_not_speak_for_a_torque_gain(pendulum, log, weak):
    """With another base the motion is the same."""
    found = diagnose([log], pendulum)
    assert [cause.effect.label for cause in found.causes] == [weak.label]
    assert found.verdict == "explained"


def test_a_healthy_pendulum_stays_healthy_with_a_base_that_is_known(pendulum):
    found = diagnose([moved(pendulum, (), LENGTH, seed=4)], pendulum)
    assert found.verdict == "healthy"


def test_a_late_torque_is_named_and_sized(drawn_seed):
    stated = load_platform("dfki_pendulum")
    rng = np.random.default_rng(drawn_seed)
    late = replace(effect_named("joint_torque_delay").typical(), delay=rng.uniform(0.005, 0.04))
    print(late.words())
    found = diagnose([moved(stated, (late,), LENGTH, seed=drawn_seed)], stated)
    (cause,) = found.causes
    assert cause.effect.label == late.label
    assert found.verdict == "explained"
    assert abs(cause.effect.values[0] - late.delay) < 2.0 * float(cause.half_widths[0]) < 0.004


@pytest.mark.slow(40)
def test_a_late_rate_of_a_real_log_is_named_and_sized_whatever_else_the_model_misses(drawn_seed):
    rng = np.random.default_rng(drawn_seed)
    stream = str(rng.choice(["joint_rate", "joint_angle"]))
    late = float(rng.uniform(0.015, 0.09))
    platform = load_platform("dfki_pendulum")
    log = open_log(platform.folder / "logs" / "energy_shaping")
    series = log[stream]
    wrong = replace(log, streams={**log.streams, stream: replace(series, time=series.time + late)})
    result = rate_lag(log)
    assert result is not None
    expected = result[0] + (late if stream == "joint_rate" else -late)
    causes = {cause.effect.label: cause for cause in diagnose([wrong], platform).causes}
    cause = causes["clock_lag:joint_rate"]
    # four standard deviations of both
    error = cause.effect.values[0] - expected
    assert abs(error) < 2.0 * np.hypot(cause.half_widths[0], result[1])
    assert [tie.label for tie in cause.ties] == ["clock_lag:joint_angle"]
