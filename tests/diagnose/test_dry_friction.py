"""Dry friction of a hinge, which sticks now and then, is no torque that wanders."""

from dataclasses import replace

import numpy as np
import pytest

from twin.contrast import moved
from twin.diagnose import diagnose
from twin.effects import effect_named
from twin.platform import load_platform


@pytest.mark.slow(30)
def test_dry_friction_of_a_hinge_is_named_alone_and_sized():
    seed = 5
    size = np.random.default_rng(seed).uniform(0.05, 0.15)
    friction = replace(effect_named("bearing_coulomb_friction").typical(), torque_size=size)
    platform = load_platform("dfki_pendulum")
    found = diagnose([moved(platform, (friction,), 20.0, seed=seed)], platform)
    (cause,) = found.causes
    assert cause.effect.label == friction.label
    assert found.verdict in ("explained", "explained in part")
    # four standard deviations, and no looser than a hundredth
    assert abs(cause.effect.values[0] - size) < 2.0 * cause.half_widths[0] < 0.01 * size
    assert found.carried > 0.5
