"""What a residual is told by."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from twin.comparison.account import ColumnMisfit, autocorrelation, correlation_time, whiteness
from twin.identification.prediction_error import fit
from twin.model import compile_model
from twin.platform import Platform
from twin.predict.base import base_parameters
from twin.predict.body import body_of
from twin.predict.innovations import Problem
from twin.predict.logs import motion_of
from twin.recording import Recording
from twin.report.words import quiet_sentences

SEED = 20261123


def test_short_logs_of_white_noise_are_called_coloured_as_seldom_as_is_said():
    rng = np.random.default_rng(SEED)
    for count in (60, 600):
        noise = rng.standard_normal((4000, count))
        chances = np.array([whiteness(autocorrelation(one), count) for one in noise])
        for level in (0.01, 0.001):
            seen = int(np.sum(chances < level))
            print(f"{count} samples: {seen} of {len(noise)} below {level}")
            most = len(noise) * level
            assert seen <= most + 4.0 * np.sqrt(most)


def test_a_slow_wobble_of_half_the_noise_is_called_coloured():
    rng = np.random.default_rng(SEED)
    noise = rng.standard_normal((2, 2000))
    wobble = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], noise[0])
    assert whiteness(autocorrelation(noise[1] + 0.5 * wobble), 2000) < 1e-4


def test_noise_that_was_stated_too_large_is_told_unless_chance_or_a_few_percent_explain_it():
    def part(column: str, chi2: float, sigmas: float) -> ColumnMisfit:
        none = np.zeros(0)
        return ColumnMisfit(
            "gyro", column, 1000, chi2, 0.9, 1.1, sigmas, none, 1.0, none, none, none
        )

    (said,) = quiet_sentences([part("x", 0.25, -30.0), part("y", 0.7, -1.0), part("z", 0.95, -9.0)])
    assert "gyro x (chi-square 0.25)" in said
    assert "gyro y" not in said
    assert "gyro z" not in said
    assert quiet_sentences([part("x", 1.0, 0.0)]) == []


def test_a_gap_may_leave_a_stream_without_any_sample_in_a_segment(
    swing: Callable[..., Recording], pendulum: Platform
):
    log = swing(seed=SEED, duration=20.0)
    rate = log["joint_rate"]
    kept = (rate.time < 6.0) | (rate.time > 13.0)
    there = replace(rate, time=rate.time[kept], value=rate.value[kept])
    log = replace(log, streams={**log.streams, "joint_rate": there})
    body = body_of(compile_model(pendulum), log, motion_of(log, pendulum))
    problem = Problem([body], base_parameters(body.machine))
    now = fit(problem, problem.start(problem.base.as_stated, [np.zeros(len(body.bias_scale))]))
    left = body.cells.gather(now.innovations.residuals_of_logs()[0])
    segments = set(range(body.grid.segments))
    assert segments - set(body.outputs[1].segment.tolist()), "the gap holds a whole segment"
    assert 1.0 <= correlation_time(problem, [left]) < 2.0
