"""What is hidden in a log is found in it, and nothing else is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from twin.comparison import Comparison, compare
from twin.comparison.comparison import prepare
from twin.errors import UsageError
from twin.identification.prediction_error import fit
from twin.library import library
from twin.platform import Platform
from twin.predict.innovations import Problem
from twin.recording import Recording
from twin.report import document, sentences

SEED = 20260214
LOGS = library("models") / "dfki_pendulum" / "logs"

Swings = Callable[..., Recording]


def laws_of(comparison: Comparison) -> dict[str, float]:
    return {s.symptom.name: float(s.values[0]) for s in comparison.best.strengths}


@pytest.mark.parametrize("seed", [SEED, SEED + 1])
def test_nothing_hidden_is_called_healthy(swing: Swings, pendulum: Platform, seed: int):
    comparison = compare(swing(seed=seed, duration=12.0), pendulum)
    assert comparison.verdict == "healthy", sentences(comparison)
    assert sentences(comparison)[0].startswith("Healthy")
    assert comparison.as_built.strengths == ()


def test_hidden_friction_is_said_with_its_size(swing: Swings, pendulum: Platform):
    generator = np.random.default_rng(SEED)
    dry, viscous = 10.0 ** generator.uniform(-2.0, -1.0), 10.0 ** generator.uniform(-2.5, -1.7)
    print(f"seed {SEED}: dry {dry:.4g} N m, viscous {viscous:.4g} N m s")
    comparison = compare(swing(seed=SEED, dry=dry, viscous=viscous), pendulum)
    found = laws_of(comparison)
    assert set(found) == {"bearing_coulomb_friction", "bearing_viscous_friction"}
    assert found["bearing_coulomb_friction"] == pytest.approx(dry, rel=0.03)
    assert found["bearing_viscous_friction"] == pytest.approx(viscous, rel=0.05)
    said = sentences(comparison)[0]
    assert said.startswith("The machine loses energy that the model keeps: a torque against the")
    assert "at every speed (dry friction) plus" in said
    assert "times the rate (viscous friction)" in said
    assert comparison.verdict == "explained"


def test_a_motor_of_which_the_log_says_nothing_is_said_to_be_taken_as_off(
    swing: Swings, pendulum: Platform
):
    whole = swing(seed=SEED, duration=5.0)
    streams = {name: whole[name] for name in whole if name != "command_joint_torque"}
    comparison = compare(Recording(streams, {"kind": "log"}), pendulum, as_built=True)
    (said,) = document([comparison], [])["logs"][0]["taken_as_at_rest"]
    assert said == sentences(comparison)[0]
    assert said.endswith(
        "this log has no torque of it: taken as off. Unless that is so, add command_joint_torque."
    )


def test_gravity_is_the_one_that_the_log_states(swing: Swings, pendulum: Platform):
    moon = replace(pendulum, gravity=0.5 * pendulum.gravity)
    facts = {"environment": {"gravity": pendulum.gravity}}
    there = replace(swing(seed=SEED, duration=5.0), provenance=facts)
    under = [sentences(compare(there, one, as_built=True)) for one in (pendulum, moon)]
    assert under[0] == under[1], "predicted under the gravity of platform.toml"


def test_a_late_command_is_said_with_its_delay(swing: Swings, pendulum: Platform):
    comparison = compare(swing(seed=SEED, duration=10.0, delay=0.008), pendulum)
    assert laws_of(comparison) == {"command_delay": pytest.approx(0.008, rel=0.03)}


def test_a_weak_motor_is_seen_as_built_and_could_be_the_base(swing: Swings, pendulum: Platform):
    comparison = compare(swing(seed=SEED, duration=10.0, gain=0.8), pendulum)
    (strength,) = comparison.as_built.strengths
    assert strength.symptom.name == "torque_gain"
    assert strength.values[0] == pytest.approx(-0.2, abs=2.0 * strength.half[0])
    assert strength.imitated > 0.999
    assert comparison.refitted is not None
    assert comparison.refitted.plain.theta[0] == pytest.approx(0.1367 / 0.8, rel=1e-2)


def test_as_built_leaves_the_base_alone(swing: Swings, pendulum: Platform):
    comparison = compare(swing(seed=SEED, duration=10.0, inertia=0.15), pendulum, as_built=True)
    assert comparison.refitted is None
    assert comparison.verdict != "healthy"
    np.testing.assert_allclose(
        comparison.best.plain.theta, comparison.base.as_stated, rtol=1e-9, atol=1e-9
    )


@pytest.mark.slow
def test_95_percent_intervals_of_the_base_hold_the_truth(swing: Swings, pendulum: Platform):
    truth = np.array([0.15, 0.0, -0.25])
    scores: list[np.ndarray] = []
    for seed in range(SEED, SEED + 20):
        log = swing(seed=seed, duration=10.0, inertia=0.15, moment=0.25)
        body, base, _ = prepare(log, pendulum)
        problem = Problem([body], base)
        found = fit(problem, problem.start(base.as_stated, [np.zeros(0)]))
        covariance, quantile = found.covariance()
        scores.append((found.at.theta - truth) / (quantile * np.sqrt(np.diag(covariance))))
    inside = np.abs(scores) < 1.0
    print(f"seeds {SEED}..{SEED + 19}: {inside.sum()} of {inside.size} inside")
    # 57 of 60 are due; fewer than 51 come once in 2000 times
    assert inside.sum() >= 51, "intervals too narrow"
    assert np.sqrt(np.mean(np.square(scores))) > 0.3, "intervals far too wide"


def test_a_push_on_one_stretch_bends_nothing_and_is_pointed_at(swing: Swings, pendulum: Platform):
    log = swing(seed=SEED, duration=12.0, dry=0.05)
    angle = log["joint_angle"]
    pushed = (angle.time > 9.0) & (angle.time < 9.3)
    angle.value[pushed, 0] += 0.5 * np.sin(np.pi * (angle.time[pushed] - 9.0) / 0.3)
    comparison = compare(log, pendulum)
    assert laws_of(comparison)["bearing_coulomb_friction"] == pytest.approx(0.05, rel=0.1)
    (pointed,) = [s for s in sentences(comparison) if "something acted" in s]
    assert "9." in pointed


def test_a_log_without_the_motion_is_refused(swing: Swings, pendulum: Platform):
    log = swing(seed=SEED, duration=2.0)
    blind = Recording({k: s for k, s in log.items() if not k.startswith("joint")}, log.provenance)
    with pytest.raises(UsageError, match="the log has no stream 'joint_angle'"):
        compare(blind, pendulum)
