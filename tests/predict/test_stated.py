"""What a platform states of its machine's faults is predicted with, at the size that it states."""

from collections.abc import Callable

import numpy as np
import pytest

from twin.comparison import compare
from twin.effects import parse_effects, with_effects
from twin.identification import identify
from twin.identification.identification import ground_of
from twin.identification.prediction_error import fit
from twin.identification.start import first_biases
from twin.platform import load_platform
from twin.predict.body import body_of
from twin.predict.innovations import Problem
from twin.predict.logs import motion_of
from twin.recording import Recording

STATED = {
    "a law of the motion": "bearing_coulomb_friction=0.004",
    "a torque with the body's axes": "bearing_swirl_torque=0.05",
    "a push with the room's axes": "room_draft=0.4/0.0/0.8/0.1/0.05/0.0/0.05/0.5",
    "a change of MuJoCo's model": "bearing_viscous_friction=0.2",
    "a spring at rest where a run starts": "harness_stiffness=0.1",
    "a part that rings": "flexible_appendage=1.5/0.01/0.4/0.36/0.48/0.8",
    "a fault of a command": "wheel_torque_gain:w2=0.1",
    "a late clock": "clock_lag:attitude=0.4",
    "a clock that drifts": "clock_drift:attitude=0.03",
    "a fault of a sensor": "gyro_scale_factor=0.2/-0.2/0.2",
    "a sensor that is turned": "attitude_misalignment=0.05/-0.04/0.06",
    "a reference that is not level": "attitude_reference_tilt=0.1/-0.08",
    "a fault of what measures a state": "clock_lag:wheel_speed=0.2",
}

CHANCE = 2.0
"""Times the evidence that noise has in a log out of a hundred: in one of a hundred thousand."""


def chi2_without_it(log: Recording) -> float:
    """Chi-square a sample of an exact motion under the platform that states no fault."""
    ground = ground_of([log], load_platform("sads"))
    (recording,), base = ground.logs.recordings, ground.full
    platform = base.machine.platform
    body = body_of(base.machine, recording, motion_of(recording, platform))
    problem = Problem([body], base)
    now = fit(problem, problem.start(base.as_stated, [first_biases(body)])).innovations
    return now.chi2 / (now.samples - now.columns.shape[1] - body.start.width)


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED.keys())
def test_a_log_leaves_no_more_than_noise_under_a_platform_that_states_its_fault(
    stated: str, flight_of: Callable[..., Recording], drawn_seed: int
):
    share = float(np.random.default_rng(drawn_seed).uniform(0.7, 1.3))
    label, numbers = stated.split("=")
    first, *rest = numbers.split("/")
    stated = f"{label}={'/'.join([str(share * float(first)), *rest])}"
    reference = "multisine:5@1" if "appendage" in label else "multisine:8"
    log = flight_of("sads", "quaternion_pd", reference, 20.0, drawn_seed, stated)
    platform = with_effects(load_platform("sads"), parse_effects(stated))
    with_it, without = identify([log], platform).misfit[0], chi2_without_it(log)
    print(stated, with_it, without)
    band = with_it.high - 1.0
    assert with_it.chi2_per_sample < 1.0 + 1.7 * band, "3.3 standard deviations"
    gained = without - with_it.chi2_per_sample
    assert gained > 2.0 * band, "or it tells nothing"


def test_a_stiff_spring_that_rests_where_a_log_began_rests_not_where_its_first_sample_was_read(
    flight_of: Callable[..., Recording], drawn_seed: int
):
    stiffness = float(np.random.default_rng(drawn_seed).uniform(0.4, 0.8))
    stated = f"harness_stiffness={stiffness}"
    log = flight_of("sads", "quaternion_pd", "multisine:8", 40.0, drawn_seed, stated)
    found = compare(log, with_effects(load_platform("sads"), parse_effects(stated))).refitted
    assert found is not None
    assert all(score.evidence < CHANCE * score.needed for score in found.scores)
