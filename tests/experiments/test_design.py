"""A proposed experiment keeps its limits, and its forecast agrees with noisy flights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin import TwinError, excite
from twin.experiments.design import (
    MARGIN,
    Design,
    limits_used,
    linearised,
    multisine,
)
from twin.identification.prediction_error import fit
from twin.platform import load_platform
from twin.reference import Tabulated, parse_reference
from twin.rotation import conjugate, multiply, to_rotation_vector

NUMBERS = np.array([0.1, 0.2, 0.5, *np.log([0.02, 0.03, 0.04]), 0.1, 0.7, 2.0])


@pytest.fixture(scope="module")
def design(tmp_path_factory) -> Design:
    path = tmp_path_factory.mktemp("design") / "motion.csv"
    return excite("sads", "inertia", duration=12.0, evaluations=10, flights=0, out=path)


def test_rate_and_acceleration_are_the_derivatives_of_the_attitude():
    motion, step = multisine(NUMBERS, 30.0), 1e-4
    for time in (3.21, 14.87, 26.05):
        before, here, after = (motion.at(time + k * step) for k in (-1.0, 0.0, 1.0))
        turned = multiply(conjugate(before.attitude), after.attitude)
        rate = to_rotation_vector(turned) / (2.0 * step)
        np.testing.assert_allclose(here.rate_body, rate, atol=1e-6)
        slope = (after.rate_body - before.rate_body) / (2.0 * step)
        np.testing.assert_allclose(here.acceleration_body, slope, atol=1e-5)


def test_a_motion_begins_and_ends_level_and_at_rest():
    motion = multisine(NUMBERS, 30.0)
    for time in (0.0, 30.0, 31.0):
        target = motion.at(time)
        np.testing.assert_allclose(target.attitude, [1.0, 0.0, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(target.rate_body, 0.0, atol=1e-6)


def test_the_proposed_motion_is_narrower_than_the_usual_one_and_keeps_its_margins(design: Design):
    assert design.narrower > 1.5
    assert max(design.used.values()) <= MARGIN + 1e-3
    log, obstacle = design.run.attempt(load_platform("sads"), seed=7)
    assert obstacle == ""
    assert max(limits_used(log, load_platform("sads")).values()) < 1.0


def test_the_file_holds_the_motion_that_was_simulated(design: Design):
    assert design.file is not None
    assert Path(design.file).read_text(encoding="utf-8").startswith("time,w,x,y,z\n")
    motion = design.run.motion
    assert isinstance(motion, Tabulated)
    read = parse_reference(str(design.file))
    for time in (5.05, 11.7):
        np.testing.assert_allclose(read.at(time).rate_body, motion.at(time).rate_body, atol=1e-6)


@pytest.mark.slow
def test_forecast_intervals_agree_with_the_scatter_of_noisy_flights_within_15_percent(
    design: Design,
):
    platform = load_platform("sads")
    errors, forecast = [], None
    for seed in range(30):
        log, _ = design.run.attempt(platform, seed=100 + seed)
        linear = linearised(log.without_truth(), platform)
        p = len(linear.base.names)
        if forecast is None:
            forecast = np.sqrt(np.diag(linear.prediction.covariance))[:p]
        result = fit(linear.problem, linear.at)
        errors.append((result.at.theta - linear.base.as_stated) / forecast)
    assert abs(np.sqrt(np.mean(np.square(errors))) - 1.0) < 0.15


@pytest.mark.slow
def test_two_causes_are_further_apart_than_after_the_usual_experiment():
    result = excite(
        "sads",
        "bearing_viscous_friction,aerodynamic_drag",
        duration=20.0,
        evaluations=20,
        flights=0,
    )
    assert result.narrower > 1.0
    assert set(result.behind) == {"bearing_viscous_friction", "aerodynamic_drag"}


@pytest.mark.slow
def test_a_machine_that_no_law_turns_is_told_how_to_let_it_go():
    result = excite("cubesat", duration=10.0, evaluations=10, flights=0, wanted="inertia")
    assert result.run.motion is None
    assert any(result.run.rate)
    assert replace(result.run).command.startswith("twin run cubesat --controller")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"wanted": "wheel_friction"}, "it has wheel_friction:w1, wheel_friction:w2"),
        ({"wanted": "a,b,c"}, "names 3 things"),
        ({"wanted": "inertias"}, "no effect named 'inertias'"),
        ({"duration": 1.0}, "give 10 or more"),
        ({"evaluations": 2}, "evaluations is 2"),
        ({"out": "motion.txt"}, r"\.csv"),
    ],
)
def test_a_mistake_is_told_with_what_would_do(words, sentence):
    with pytest.raises(TwinError, match=sentence):
        excite("sads", **{"wanted": "inertia", **words})


def test_no_reference_is_written_for_a_machine_that_follows_none(tmp_path):
    with pytest.raises(TwinError, match="leave the file out"):
        excite("cubesat", "inertia", out=tmp_path / "motion.csv")
