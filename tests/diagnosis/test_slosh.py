"""A liquid that kicks make ring, on a machine that hangs: named alone, and sized."""

from dataclasses import replace

import numpy as np
import pytest

from tests.effects.motion import Kicks
from twin.contrast import moved
from twin.diagnosis import diagnose
from twin.effects import able, effect_named
from twin.effects.effect import EffectError
from twin.platform import Platform, load_platform

SEED = 20261127


@pytest.fixture
def hanging() -> Platform:
    """In a field that the paper does not state, its masses low; its thrusters stay off."""
    sads = replace(load_platform("sads"), thrusters=(), gas=None, tilt_limit=np.pi)
    kept = {name: one for name, one in sads.sensors.items() if name != "gas_pressure"}
    return replace(
        sads,
        magnetic_field=np.array([2.2e-5, 0.0, -4.2e-5]),
        sensors=kept,
        center_of_mass_offset=np.array([1e-3, -1e-3, -0.4]),
    )


@pytest.mark.slow(50)
def test_a_liquid_that_kicks_make_ring_is_named_alone_and_sized(hanging):
    """Beside it nothing else pushes at its frequency, or bends."""
    rng = np.random.default_rng(SEED)
    liquid = replace(
        effect_named("liquid_slosh").typical(),
        mass=rng.uniform(0.9, 1.1),
        length=rng.uniform(0.09, 0.11),
        damping_ratio=rng.uniform(0.025, 0.035),
        pivot=(rng.uniform(0.25, 0.35), rng.uniform(0.05, 0.15), rng.uniform(-0.35, -0.25)),
    )
    print(f"{liquid.words()}, seed {SEED}")
    log = moved(able(hanging, liquid), (liquid,), 16.0, seed=SEED, law=Kicks())
    found = diagnose([log], hanging)
    (cause,) = found.causes
    assert cause.effect.label == "liquid_slosh"
    assert not cause.ties
    # a pivot on the other side of the CR does nearly the same
    mass_length_damping = slice(0, 3)
    error = np.abs(cause.effect.values - liquid.values)[mass_length_damping]
    assert np.all(error < 1.5 * cause.half_widths[mass_length_damping])


def test_no_liquid_is_sought_where_a_line_is_slower_than_a_pendulum_of_two_metres():
    liquid = effect_named("liquid_slosh").typical()
    assert liquid.at_frequency(0.4, 9.81)
    with pytest.raises(EffectError, match="length"):
        liquid.at_frequency(0.3, 9.81)
