"""A wheel along the spin axis decides whether a spin is stable: on which side, and how fast."""

from dataclasses import replace

import numpy as np
import pytest

from tests.physics.motion import run
from twin.plant.initial import InitialState
from twin.platform import load_platform

SPIN = 0.5
"""[rad/s] about z."""
NUDGE = 1e-6
"""[rad/s] about x."""


@pytest.mark.parametrize(
    ("part", "tolerance"),
    [(-0.5, 8e-8), (-0.01, 5e-8), (0.01, 3e-8), (0.5, 3e-9), (0.99, 8e-10), (1.01, 8e-10)],
)
def test_a_spin_is_unstable_while_its_momentum_lies_between_two_bounds(part, tolerance, agrees):
    """From a nudge about x, w_x = e cos(L t) with A B L^2 = (H - A W) (H - B W), or cosh.

    H is what body and wheel have along z at the spin W; A and B are the body's moments across, its
    wheels about x and y left out: those keep the momentum that they have. `part` is where H lies,
    0 at A W and 1 at B W.
    """
    table = load_platform("sads")
    low, high = 9.0, 11.0
    rotor = np.array([wheel.inertia for wheel in table.wheels])
    along = 12.0
    body = np.diag([low, high, along]) + np.diag([rotor[0], rotor[1], 0.0])
    balanced = replace(
        table,
        inertia=body,
        center_of_mass_offset=np.zeros(3),
        gravity=0.0,
        tilt_limit=np.inf,
        sensors={},
        effects=(),
    )
    momentum = SPIN * (low + part * (high - low))
    wheel = (momentum - along * SPIN) / rotor[2]
    start = InitialState(
        rate_body=np.array([NUDGE, 0.0, SPIN]), wheel_speed=np.array([-NUDGE, 0.0, wheel])
    )
    time, true = run(balanced, start, 30.0)
    square = (momentum - low * SPIN) * (momentum - high * SPIN) / (low * high)
    turn = np.sqrt(complex(square)) * time
    expected = NUDGE * np.stack(
        [np.cos(turn), np.sin(turn) * (momentum - low * SPIN) / (high * np.sqrt(complex(square)))],
        axis=1,
    )
    assert (square > 0.0) == (not 0.0 < part < 1.0)
    error = np.abs(true["rate"][:, :2] - expected.real).max() / np.abs(expected.real).max()
    side = "stable" if square > 0.0 else "unstable"
    agrees(f"dual spin, {side} at {part:g} from A to B: wobble over 30 s", error, tolerance)
