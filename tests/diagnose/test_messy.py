"""Logs with what every real one has: what wanders in them is no cause, and hides none."""

import numpy as np
import pytest

from tests.promises.messy import Mess, flown
from twin.diagnose import Diagnosis, diagnose
from twin.effects import Effect, effect_named
from twin.platform import load_platform

WANDER = 3e-5
"""Of a torque [N m]."""
TURNING = 5e-4
"""Of an attitude, half of a sample's noise [rad]."""


def hidden(name: str, target: str, *values: float) -> Effect:
    """Of an evidence of about 20,000 in a clean log."""
    return effect_named(name).typical(target).with_values(np.array(values))


KINDS = (
    hidden("clock_lag", "wheel_speed", 0.17),
    hidden("wheel_friction", "w1", 3.4e-6, 0.0),
    hidden("wheel_friction", "w1", 0.0, 1.6e-4),
    hidden("aerodynamic_drag", "", 0.53),
    hidden("harness_stiffness", "", 5e-3),
    hidden("gyro_misalignment", "", 0.05, -0.04, 0.05),
)


def diagnosed(*effects: Effect, seed: int) -> Diagnosis:
    """A messy log of `sads` with these hidden."""
    print("seed", seed)
    log = flown(effects, seed, Mess(WANDER, attitude=TURNING))
    return diagnose([log], load_platform("sads"))


@pytest.mark.slow
@pytest.mark.parametrize("cause", KINDS, ids=lambda effect: effect.words())
def test_a_cause_is_named_beside_a_mess_and_nothing_else_is(cause):
    found = diagnosed(cause, seed=2)
    assert [one.effect.label for one in found.causes] == [cause.label]
    assert found.verdict == "explained"


@pytest.mark.slow
def test_a_mess_alone_is_no_cause_and_has_its_size():
    found = diagnosed(seed=2)
    assert found.causes == ()
    assert found.verdict == "healthy"
    noise = found.explained.noise
    assert noise.torque.rms == pytest.approx(WANDER, rel=0.3)
    assert noise.errors["attitude"].rms == pytest.approx(TURNING, rel=0.3)
