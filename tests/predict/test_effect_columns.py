"""Effects hidden in simulated logs are found by the prediction's own columns of them.

`pytest -m slow tests/predict/test_effect_columns.py -s` prints truth, estimate and interval.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.effects.motion import Kicks
from twin.contrast import moved
from twin.effects import Effect, able, effect_named, parse_effects
from twin.identification.prediction_error import fit, fit_disturbed
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.base import base_parameters
from twin.predict.body import Body, body_of
from twin.predict.columns import (
    amplitudes,
    perturbations_of,
    strengths_of,
    with_strengths,
)
from twin.predict.innovations import Problem, retraced
from twin.predict.logs import motion_of
from twin.recording import Recording

SEED = 20261121
SECONDS = 24.0
LONGER = {"earth_rotation": 120.0}
"""Of what has a bound that it does not reach in a short log [s]."""
LOUD = 20.0
"""An effect is hidden with at least so many of its own standard deviations."""

HIDDEN = (
    "aerodynamic_drag",
    "bearing_coulomb_friction",
    "bearing_swirl_torque",
    "bearing_viscous_friction",
    "center_of_mass_drift",
    "harness_stiffness",
    "residual_dipole",
    "room_draft=0.1/0.05/0.3/0.02/0.01/0.005/0.1/0.5",
    "structural_sag",
    "wheel_friction:w1",
    "wheel_inertia_error:w2",
    "wheel_misalignment:w2",
    "wheel_torque_gain:w3",
    "attitude_misalignment",
    "attitude_reference_tilt",
    "earth_rotation",
    "gyro_bias",
    "gyro_drift",
    "gyro_misalignment",
    "gyro_scale_factor",
    "sensor_lag:gyro",
    "clock_drift:wheel_speed",
    "clock_lag:wheel_speed",
)
ON_PARTS = {
    "gimbal_offset:g1": "tas2",
    "gimbal_backlash:g2": "tas2",
    "gimbal_center_of_mass_offset:g3": "tas2",
    "gimbal_friction": "tas2",
    "magnetorquer_gain": "cubesat",
    "stage_scale:s1": "cubesat",
    "thruster_misalignment:px1=0/0.02/0": "whorl1",
}
"""Of parts that `sads` lacks. Where a stage is commanded and not measured, it is taken to be there
at its first command: what is lost on the way there, by play or by steps, is not seen."""
RINGING = (
    "flexible_appendage=0.5/0.05/0.3/0.9/0.3/0.2",
    "liquid_slosh=1/0.1/0.03/0.3/0.1/-0.3",
)
"""Found by kicks, on a machine that hangs: slow waves make nothing ring, and a machine balanced to
30 um capsizes with such a liquid, whose m l is more than its m r."""
QUICK = ("gyro_scale_factor",)
DEPTH = 0.4
"""m r of the machine that hangs [kg m]."""

KNOWN = {
    "thruster_misalignment": ("rotation_x", "rotation_z"),  # px1 pushes along z, at an arm along y
    "flexible_appendage": ("axis_x",),  # the length of the axis does not count
    "room_draft": ("point_z",),  # arm times force shows, not which of them is the larger
    "wheel_misalignment": ("rotation_y",),  # about the axis of w2
}
"""Components that no log of the body shows beside the others (tests/effects/test_body.py)."""

SETTLED = 0.02
"""An effect is found where its next step, in standard deviations squared a component, is less."""


@pytest.fixture(scope="module")
def sads() -> Platform:
    """In a field that the paper does not state.

    Its thrusters stay off: what they push moves it too far in so short a log.
    """
    field = np.array([2.2e-5, 0.0, -4.2e-5])
    platform = replace(load_platform("sads"), magnetic_field=field, thrusters=(), gas=None)
    return without_bias(platform)


def without_bias(platform: Platform) -> Platform:
    """No stop to hit, no gyro bias to hide behind, and no gauge, which has one of its own."""
    kept = {k: s for k, s in platform.sensors.items() if k != "gas_pressure"}
    sensors = {k: replace(s, bias=0.0 * s.bias) for k, s in kept.items()}
    return replace(platform, tilt_limit=np.pi, sensors=sensors)


def body(log: Recording, platform: Platform) -> Body:
    log = log.without_truth()
    return body_of(compile_model(platform), log, motion_of(log, platform))


def sought(effect: Effect) -> np.ndarray:
    known = KNOWN.get(effect.name, ())
    return np.array([name not in known for name in effect.names])


def problem_of(one: Body, effect: Effect) -> Problem:
    """The effect's own components, the base where it is stated."""
    every = perturbations_of(effect, one.machine.platform)
    own = [p for p, free in zip(every, sought(effect), strict=True) if free]
    return Problem([one], base_parameters(one.machine), own, held=True)


@pytest.fixture(scope="module")
def hanging(sads: Platform) -> Platform:
    """With its masses low."""
    return replace(sads, center_of_mass_offset=np.array([1e-3, -1e-3, -DEPTH]))


def drawn(text: str) -> Effect:
    """An effect whose size is between half and one and a half times the one named."""
    (effect,) = parse_effects(text)
    generator = np.random.default_rng(SEED)
    size = amplitudes(effect)
    factor = np.where(size, generator.uniform(0.5, 1.5, len(size)), 1.0)
    return effect.with_values(effect.values * factor)


def loud(effect: Effect, platform: Platform) -> Effect:
    """The effect, as much larger as it takes to show."""
    size = amplitudes(effect)
    seconds = LONGER.get(effect.name, SECONDS)
    problem = problem_of(body(moved(platform, (), seconds, seed=SEED), platform), effect)
    start = problem.start(problem.base.as_stated, [np.zeros(0)])
    count = len(problem.perturbations)
    columns = problem.innovations(start).columns[:, -count:]
    shown = float(np.linalg.norm(columns @ strengths_of(effect)[sought(effect)]))
    return effect.with_values(effect.values * np.where(size, max(1.0, LOUD / shown), 1.0))


def refitted(start: Effect, one: Body) -> tuple[Effect, np.ndarray]:
    """The effect that explains a log best, and the covariance of what was sought of it.

    Its forces are formed along the log's motion at first, then along that of the fit before.
    """
    effect, free = start, sought(start)
    for _ in range(12):
        problem = problem_of(one, effect)
        strengths = strengths_of(effect)
        found = fit(problem, problem.start(problem.base.as_stated, [np.zeros(0)], strengths[free]))
        count = len(problem.perturbations)
        covariance = found.innovations.covariance[-count:, -count:]
        strengths[free] = found.at.strengths
        before, effect = effect, with_strengths(effect, strengths)
        step = (effect.values - before.values)[free]
        if step @ np.linalg.solve(covariance, step) < SETTLED * count:
            return effect, covariance
        one = retraced(problem, found.innovations, 0)
    raise AssertionError(f"{effect.label} does not settle: {effect.values}, last step {step}")


def disturbed(one: Body) -> Body:
    """Its motion that of the machine without any effect, under what torque the log asks for."""
    problem = Problem([one], base_parameters(one.machine), held=True)
    start = problem.start(problem.base.as_stated, [np.zeros(0)])
    return retraced(problem, fit_disturbed(problem, fit(problem, start), start).innovations, 0)


def compared(truth: Effect, one: Body) -> None:
    """Print and judge what is found of an effect, from a start that is wrong."""
    free = sought(truth)
    off = np.where(free, np.where(amplitudes(truth), 0.7, 0.97), 1.0)
    found, covariance = refitted(truth.with_values(truth.values * off), one)
    error = (found.values - truth.values)[free]
    sigma = np.sqrt(np.diag(covariance))
    rows = zip(
        np.array(truth.names)[free], truth.values[free], found.values[free], sigma, strict=True
    )
    for name, true, value, one in rows:
        inside = "" if abs(value - true) < 1.96 * one else "  outside"
        print(f"{truth.label} {name}: {true:.4g}, found {value:.4g} +- {1.96 * one:.2g}{inside}")
    distance = float(error @ np.linalg.solve(covariance, error))
    print(f"{truth.label}: chi-square {distance:.1f} of {len(error)}, seed {SEED}")
    assert distance < chi2.ppf(0.999, len(error)), "found, but not where its interval says"
    assert np.max(np.abs(truth.values[free]) / sigma) > 5.0, "its interval says nothing"


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(text, marks=() if text.startswith(QUICK) else pytest.mark.slow)
        for text in HIDDEN
    ],
)
def test_a_hidden_effect_is_found_to_within_its_interval(text, sads):
    finds(text, sads)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(text, marks=() if text.startswith("magnetorquer") else pytest.mark.slow)
        for text in ON_PARTS
    ],
)
def test_a_hidden_effect_on_a_part_is_found_to_within_its_interval(text):
    platform = without_bias(replace(load_platform(ON_PARTS[text]), effects=()))
    if text.startswith("stage"):
        kept = {k: s for k, s in platform.sensors.items() if k != "stage_position"}
        platform = replace(platform, sensors=kept)
    finds(text, platform)


def finds(text: str, platform: Platform) -> None:
    truth = loud(drawn(text), platform)
    seconds = LONGER.get(truth.name, SECONDS)
    log = moved(able(platform, truth), (truth,), seconds, seed=SEED + 1)
    compared(truth, body(log, platform))


@pytest.mark.slow
@pytest.mark.parametrize("text", RINGING)
def test_a_hidden_part_that_rings_is_found_to_within_its_interval(text, hanging):
    truth = drawn(text)
    log = moved(able(hanging, truth), (truth,), 20.0, seed=SEED + 1, law=Kicks())
    compared(truth, disturbed(body(log, hanging)))


def test_a_scatter_changes_no_expected_value(sads):
    assert perturbations_of(effect_named("stage_vibration").typical("s1"), sads) == ()


@pytest.mark.parametrize("text", ["flexible_appendage=2/0.1/0.3/0/0/1", "wheel_friction=1e-3/2e-3"])
def test_strengths_make_up_the_effect(text):
    (effect,) = parse_effects(text)
    assert with_strengths(effect, strengths_of(effect)) == effect


def test_four_gimbal_angles_are_not_taken_for_an_attitude():
    platform = without_bias(load_platform("astros"))
    effect = effect_named("gimbal_offset").typical("g4")
    log = body(moved(platform, (), 2.0, seed=SEED), platform)
    problem = problem_of(log, effect.absent())
    now = problem.innovations(problem.start(problem.base.as_stated, [np.zeros(0)]))
    assert np.all(np.isfinite(now.columns))
    assert np.linalg.norm(now.columns[:, -1]) > 0.0
