"""What rings as commands repeat is named, though what it leaves stands out at their harmonics."""

from dataclasses import replace

import numpy as np
import pytest

from tests.effects.motion import Kicks
from twin.contrast import moved
from twin.diagnosis import diagnose
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import candidates_of, resonators
from twin.diagnosis.residual_test import residual_test
from twin.effects import Effect, able, effect_named
from twin.platform import Platform, load_platform

LENGTH = 16.0


@pytest.fixture(scope="module")
def hanging() -> Platform:
    """Its masses low, its thrusters off."""
    sads = replace(load_platform("sads"), thrusters=(), gas=None, tilt_limit=np.pi)
    kept = {name: one for name, one in sads.sensors.items() if name != "gas_pressure"}
    low = np.array([1e-3, -1e-3, -0.4])
    return replace(sads, sensors=kept, center_of_mass_offset=low)


def a_panel(rng: np.random.Generator) -> Effect:
    """About an axis that the kicks turn well."""
    axis = np.array([rng.choice([-1.0, 1.0]), *rng.uniform(-0.5, 0.5, 2)])
    return replace(
        effect_named("flexible_appendage").typical(),
        frequency=rng.uniform(0.55, 1.2),
        damping_ratio=rng.uniform(0.02, 0.04),
        inertia=rng.uniform(0.05, 0.2),
        axis=tuple(axis.tolist()),
    )


@pytest.mark.slow(45)
def test_a_panel_is_named_alone_at_whatever_frequency(hanging, drawn_seed):
    """Or with a liquid, where they do the same.

    A liquid is not drawn: faster than the machine turns, it lags its tilt, which is the torque of a
    viscous friction and a swirl to within the noise of most draws.
    """
    hidden = a_panel(np.random.default_rng(drawn_seed))
    print(hidden.words())
    log = moved(able(hanging, hidden), (hidden,), LENGTH, seed=drawn_seed, law=Kicks())
    found = diagnose([log], hanging)
    (cause,) = found.causes
    assert hidden.label in (cause.effect.label, *(tie.label for tie in cause.ties))


@pytest.mark.slow
def test_a_panel_that_hardly_changes_the_mean_squares_is_named_by_its_line(hanging):
    hidden = a_panel(np.random.default_rng(1357113302))
    log = moved(able(hanging, hidden), (hidden,), LENGTH, seed=1357113302, law=Kicks())
    found = diagnose([log], hanging)
    before = residual_test(found.baseline)
    assert before.chance > 0.01, "else it is no case of this law"
    assert before.lines
    assert [cause.effect.label for cause in found.causes] == [hidden.label]


def test_what_may_ring_is_asked_for_all_over_the_spectrum_and_nothing_else_is(hanging):
    log = moved(hanging, (), 10.0, seed=1, law=Kicks())
    bodies = baseline_of([log], hanging).bodies
    found = resonators(candidates_of(bodies).asked, bodies)
    assert {one.label for one in found} == {"flexible_appendage", "liquid_slosh"}
    panels = sorted({one.effect.values[0] for one in found if one.label == "flexible_appendage"})
    assert panels[0] == pytest.approx(0.2)
    assert np.all(np.diff(np.log(panels)) < 0.2), "what is damped by 5 % rings between them"
