"""A body that spins on its bearing: free and symmetric, free and of three moments, and heavy."""

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from tests.effects.motion import apart
from tests.physics.motion import rigid, run
from twin.plant.initial import InitialState
from twin.rotation import from_rotation_vector, multiply, rotate, vertical_body

ACROSS, ALONG = 0.03, 0.05
"""Moments of inertia of the tops, across their axis and along it [kg m^2]."""
TOP = np.diag([ACROSS, ACROSS, ALONG])
UP = np.array([0.0, 0.0, 1.0])


def greatest_turn(expected: np.ndarray, found: np.ndarray) -> float:
    """Largest angle between two series of attitudes [deg]."""
    return float(np.degrees(max(apart(*pair) for pair in zip(expected, found, strict=True))))


def test_a_free_symmetric_body_nutates_about_its_momentum(agrees):
    """R(t) = exp(H t / A) R(0) exp((1 - C / A) w_z t z), H the momentum in the room."""
    start = from_rotation_vector(np.array([0.3, -0.2, 0.5]))
    rate = np.array([0.2, -0.1, 0.4])
    time, true = run(rigid(TOP), InitialState(attitude=start, rate_body=rate), 300.0)
    precession = rotate(start, TOP @ rate) / ACROSS
    spin = (1.0 - ALONG / ACROSS) * rate[2] * UP
    turned = multiply(from_rotation_vector(time[:, None] * precession), start)
    expected = multiply(turned, from_rotation_vector(time[:, None] * spin))
    error = greatest_turn(expected, true["attitude"])
    agrees("free symmetric top: precession and nutation over 300 s", error, 5e-9, "deg")


def test_a_free_body_of_three_moments_tumbles_as_jacobi_says(agrees):
    """Euler's equations from a turn without w_y: w = (a cn, b sn, c dn)."""
    low, middle, high = moments = np.array([0.02, 0.03, 0.045])
    x, z = 0.3, 0.4
    time, true = run(rigid(np.diag(moments)), InitialState(rate_body=np.array([x, 0.0, z])), 300.0)
    momentum, energy = (high * z) ** 2 + (low * x) ** 2, high * z**2 + low * x**2
    assert momentum > middle * energy, "it turns about the axis of its largest moment"
    frequency = np.sqrt((high - middle) * (momentum - low * energy) / (low * middle * high))
    modulus = (middle - low) * (high * energy - momentum)
    modulus /= (high - middle) * (momentum - low * energy)
    sn, cn, dn, _ = ellipj(frequency * time, modulus)
    y = np.sqrt((high * energy - momentum) / (middle * (high - middle)))
    expected = np.stack([x * cn, y * sn, z * dn], axis=1)
    error = np.abs(true["rate"] - expected).max()
    agrees("free body of three moments: rate over 300 s, by Jacobi", error, 2e-10, "rad/s")


@pytest.mark.parametrize("moment", [2e-3, -2e-3], ids=["upright", "hanging"])
def test_a_heavy_top_precesses_steadily_at_the_rate_of_its_quadratic(moment, agrees):
    """A cos(theta) p^2 - C w_z p + m r g = 0 for the turn p about the vertical."""
    platform = rigid(TOP, moment)
    lean, spin = 0.5, 5.0
    turn = min(np.roots([ACROSS * np.cos(lean), -ALONG * spin, platform.gravity * moment]), key=abs)
    start = from_rotation_vector(np.array([lean, 0.0, 0.0]))
    own = spin - turn * np.cos(lean)
    rate = turn * vertical_body(start) + own * UP
    time, true = run(platform, InitialState(attitude=start, rate_body=rate), 60.0)
    turned = multiply(from_rotation_vector(time[:, None] * turn * UP), start)
    expected = multiply(turned, from_rotation_vector(time[:, None] * own * UP))
    name = "upright" if moment > 0.0 else "hanging"
    error = greatest_turn(expected, true["attitude"])
    agrees(f"heavy top, {name}: steady precession over 60 s", error, 4e-6, "deg")


def test_a_heavy_top_let_go_nutates_as_elliptic_functions_say(agrees):
    """u = cos(theta) moves between the roots of u'^2 = (a - b u)(1 - u^2) - (p - s u)^2."""
    moment, lean, spin = 2e-3, 0.5, 5.0
    platform = rigid(TOP, moment)
    start = InitialState(
        attitude=from_rotation_vector(np.array([lean, 0.0, 0.0])), rate_body=spin * UP
    )
    time, true = run(platform, start, 60.0)
    highest = np.cos(lean)
    pull, own = 2.0 * platform.gravity * moment / ACROSS, ALONG * spin / ACROSS
    # let go at its highest, which is one root: the other two are those of a quadratic
    ends = np.roots([pull, -(own**2), own**2 * highest - pull])
    lowest, far = np.sort(ends)
    modulus = (highest - lowest) / (far - lowest)
    pace = 0.5 * np.sqrt(pull * (far - lowest))
    sn = ellipj(ellipk(modulus) - pace * time, modulus)[0]
    expected = lowest + (highest - lowest) * sn**2
    found = vertical_body(true["attitude"])[:, 2]
    error = np.abs(found - expected).max() / (highest - lowest)
    agrees("heavy top: nutation over 60 s, by elliptic functions", error, 5e-6, "of its range")
