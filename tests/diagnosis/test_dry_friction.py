"""Dry friction of a hinge, which sticks now and then and is no torque that wanders; and beside
viscous friction, in readings of a stand that shakes.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from twin.contrast import moved
from twin.diagnosis import diagnose
from twin.effects import effect_named
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series


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


def swing(platform: Platform, dry: float, viscous: float, rng: np.random.Generator) -> Recording:
    """Its rate while it swings freely for 10 s, on a stand that shakes at some 16 Hz by 0.7 deg/s,
    ten times the noise of a reading; integrated by SciPy."""
    inertia = float(platform.inertia[1, 1])
    weight = -platform.gravity * float(platform.center_of_mass_offset[2])

    def falling(_: float, state: np.ndarray) -> list[float]:
        angle, rate = state
        brake = viscous * rate + dry * np.tanh(rate / 1e-3)
        return [rate, -(weight * np.sin(angle) + brake) / inertia]

    time = 0.01 * np.arange(1000)
    start = [np.radians(rng.uniform(25.0, 50.0)), 0.0]
    fallen = solve_ivp(falling, (0.0, time[-1]), start, "LSODA", time, rtol=1e-8, max_step=0.01)
    turn, radius = 2.0 * np.pi * rng.uniform(14.0, 18.0) * 0.01, np.exp(-0.01 * np.pi)
    white = rng.standard_normal(2 * len(time))
    shaken = lfilter([1.0], [1.0, -2.0 * radius * np.cos(turn), radius**2], white)[len(time) :]
    noise = 0.7 * shaken / shaken.std() + 0.07 * rng.standard_normal(len(time))
    rate = fallen.y[1] + np.radians(noise)
    return Recording({"joint_rate": Series(time, rate[:, None], ("pivot",), "rad/s")})


@pytest.mark.slow(25)
def test_frictions_of_a_swing_are_sized_within_their_intervals_beside_a_stand_that_shakes(
    drawn_seed: int,
):
    rng, platform = np.random.default_rng(drawn_seed), load_platform("dfki_pendulum")
    dry, viscous = rng.uniform(0.01, 0.03), rng.uniform(0.005, 0.02)
    found = diagnose([swing(platform, dry, viscous, rng)], platform)
    # drag may tie with little viscous friction
    assert found.verdict in ("explained", "ambiguous")
    shakes = [one for one in found.causes if one.effect.name == "joint_rate_vibration"]
    assert len(found.causes) - len(shakes) == 2
    hidden = {"bearing_coulomb_friction": dry, "bearing_viscous_friction": viscous}
    for name, size in hidden.items():
        named = [one for one in found.causes if one.effect.name == name]
        if not named:
            assert any(name == tie.label for one in found.causes for tie in one.ties)
            continue
        # four standard deviations
        assert abs(named[0].effect.values[0] - size) < 2.0 * named[0].half_widths[0]
        assert named[0].half_widths[0] < 0.15 * size
