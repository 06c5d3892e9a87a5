"""Of a driven hinge, the torque decides which of its streams has the wrong sign."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twin.conventions import check_conventions
from twin.conventions.joint import rate_lag
from twin.platform import load_platform
from twin.recording import Recording, Series

STREAMS = ("joint_angle", "joint_rate", "command_joint_torque")


def swing(seed: int) -> Recording:
    """40 s of a drawn pendulum with friction, driven by a drawn multisine."""
    rng = np.random.default_rng(seed)
    inertia, friction = rng.uniform(0.05, 5.0), rng.uniform(0.0, 0.2)
    restoring = inertia * rng.uniform(0.5, 4.0) ** 2
    tones = rng.uniform(0.05, 0.6, 5)
    sizes = rng.uniform(0.3, 1.0, 5) * restoring
    phases = rng.uniform(0.0, 2.0 * np.pi, 5)

    def torque(t):
        return np.sin(2.0 * np.pi * np.multiply.outer(t, tones) + phases) @ sizes / 3.0

    def rates(t, x):
        braking = friction * restoring * np.tanh(x[1] / 0.01)
        return [x[1], (torque(t) - restoring * np.sin(x[0]) - braking) / inertia]

    time = np.arange(0.0, 40.0, 0.01)
    motion = solve_ivp(rates, (0.0, 40.0), [0.3, 0.0], t_eval=time, rtol=1e-8, atol=1e-8).y
    values = (
        motion[0] + rng.normal(0.0, 1e-3, len(time)),
        motion[1] + rng.normal(0.0, 0.02, len(time)),
        torque(time),
    )
    units = ("rad", "rad/s", "N m")
    streams = {
        name: Series(time, value[:, None], ("pivot",), unit)
        for name, value, unit in zip(STREAMS, values, units, strict=True)
    }
    return Recording(streams)


@pytest.mark.parametrize("seed", [20261130, 20261131, 20261132, 20261133])
def test_a_driven_hinge_shows_which_stream_has_the_wrong_sign(seed):
    log = swing(seed)
    assert check_conventions(log) == []
    for wrong in STREAMS:
        series = log[wrong]
        turned = replace(log, streams={**log.streams, wrong: replace(series, value=-series.value)})
        assert [one.sentence for one in check_conventions(turned)] == [
            f"{wrong} has the wrong sign."
        ], seed


def test_two_wrong_signs_of_three_are_one_of_the_third():
    log = swing(7)
    for pair in combinations(STREAMS, 2):
        turned = {name: replace(log[name], value=-log[name].value) for name in pair}
        (third,) = set(STREAMS) - set(pair)
        findings = check_conventions(replace(log, streams={**log.streams, **turned}))
        assert [one.sentence for one in findings] == [f"{third} has the wrong sign."]


def test_a_torque_that_only_holds_a_weight_accuses_nothing():
    time = np.arange(0.0, 40.0, 0.01)
    rng = np.random.default_rng(3)
    angle = 0.4 + 0.02 * np.sin(0.7 * time)
    values = (
        angle + rng.normal(0.0, 1e-3, len(time)),
        0.014 * np.cos(0.7 * time) + rng.normal(0.0, 1e-3, len(time)),
        2.0 * np.sin(angle),
    )
    streams = {
        name: Series(time, value[:, None], ("pivot",), unit)
        for name, value, unit in zip(STREAMS, values, ("rad", "rad/s", "N m"), strict=True)
    }
    assert check_conventions(Recording(streams)) == []


@pytest.mark.parametrize("counts", [360, 2048, 4096])
def test_an_encoder_has_a_whole_number_of_counts_a_turn(counts: int):
    time = np.arange(0.0, 20.0, 0.01)
    angle = np.round(np.degrees(0.5 * np.cos(3.0 * time)) * counts / 360.0) * 360.0 / counts
    log = Recording({"joint_angle": Series(time, angle[:, None], ("pivot",), "rad")})
    assert [one.sentence for one in check_conventions(log)] == [
        "joint_angle looks like deg, read as rad."
    ]
    right = replace(log["joint_angle"], value=np.radians(log["joint_angle"].value))
    assert check_conventions(Recording({"joint_angle": right})) == []


def test_a_wheel_takes_the_momentum_of_its_body():
    platform = load_platform("vnucec_cubesat")
    (wheel,) = platform.wheels
    time = np.arange(0.0, 30.0, 0.02)
    rng = np.random.default_rng(20261130)
    speed = 80.0 * np.sin(0.9 * time) + 40.0 * np.sin(2.3 * time)
    body = -wheel.inertia / platform.inertia[2, 2] * speed + rng.normal(0.0, 1e-3, len(time))
    streams = {
        "joint_rate": Series(time, body[:, None], ("line",), "rad/s"),
        "wheel_speed": Series(time, speed[:, None], ("wheel",), "rad/s"),
    }
    assert check_conventions(Recording(streams), platform) == []
    for name in streams:
        turned = replace(streams[name], value=-streams[name].value)
        (finding,) = check_conventions(Recording({**streams, name: turned}), platform)
        assert finding.sentence.startswith("wheel_speed has the wrong sign; or joint_rate")


@pytest.mark.parametrize("rates", [(200.0, 200.0), (300.0, 80.0), (50.0, 400.0)])
def test_how_late_a_rate_is_shows_beside_its_angle_whatever_moved_the_hinge(rates, drawn_seed: int):
    rng = np.random.default_rng(drawn_seed)
    frequency = rng.uniform(0.05, 1.5, 6)
    size, phase = rng.uniform(0.1, 0.5, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
    lag = float(rng.uniform(-0.09, 0.09))
    angle_time, rate_time = (np.arange(0.0, 20.0, 1.0 / rate) for rate in rates)
    turn = 2.0 * np.pi * frequency * angle_time[:, None] + phase
    angle = (size * np.sin(turn)).sum(axis=1) + 1e-3 * rng.standard_normal(len(angle_time))
    slope = 2.0 * np.pi * frequency * size
    turn = 2.0 * np.pi * frequency * (rate_time[:, None] - lag) + phase
    rate = (slope * np.cos(turn)).sum(axis=1) + 0.05 * rng.standard_normal(len(rate_time)) + 0.02
    log = Recording(
        {
            "joint_angle": Series(angle_time, angle[:, None], ("pivot",), "rad"),
            "joint_rate": Series(rate_time, rate[:, None], ("pivot",), "rad/s"),
        }
    )
    result = rate_lag(log)
    assert result is not None
    found, half_width = result
    # four standard deviations
    assert abs(found - lag) < 2.0 * half_width
    assert half_width < 0.01
