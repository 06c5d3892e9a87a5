"""A fit of a part that may point anywhere begins in more places than one."""

from dataclasses import replace

import numpy as np

from twin.diagnosis.starts import TURNED, starts
from twin.effects import effect_named, parse_effects
from twin.platform import load_platform

SADS = load_platform("sads")
NOZZLE = SADS.thrusters[0]


def nozzle(turn: np.ndarray):
    kind = effect_named("thruster_misalignment")
    return replace(kind.typical(NOZZLE.name), rotation=tuple(turn.tolist()))


def test_a_large_turn_begins_about_each_axis_but_the_parts_own(drawn_seed: int):
    rng = np.random.default_rng(drawn_seed)
    across = np.array(rng.choice([-1.0, 1.0]) * np.cross(NOZZLE.direction, rng.normal(size=3)))
    guess = nozzle(across / np.linalg.norm(across) * rng.uniform(TURNED, 1.4))
    first, *others = starts([guess], (), SADS)
    assert first == (guess,)
    places = np.array([one.values for (one,) in others])
    assert len(places) == 4
    np.testing.assert_allclose(places @ NOZZLE.direction, 0.0, atol=1e-12)
    np.testing.assert_allclose(places.sum(axis=0), 0.0, atol=1e-12)


def test_what_is_fitted_already_and_what_turns_little_begins_where_it_is():
    far, near = nozzle(np.array([1.0, 1.0, 1.0])), nozzle(np.array([0.1, 0.1, 0.1]))
    (bias,) = parse_effects("gyro_bias=9/9/9")
    assert list(starts([far], [far], SADS)) == [(far,)]
    assert list(starts([near, bias], (), SADS)) == [(near, bias)]
