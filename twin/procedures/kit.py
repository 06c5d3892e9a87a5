"""A machine as a procedure handles it: how it leans, swings and is nudged, run by run."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.controller import AnyController
from twin.platform import Platform
from twin.procedures.means import Reach, mean_inertia
from twin.rotation import vertical_body
from twin.signals import Estimate

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLEAR = 0.5
"""Part of the way to the stop within which the body is clear of it."""
NEAR = 0.9
"""Part of that way beyond which the stop may touch: what is recorded there is worth nothing."""
STILL = 0.6
"""Of the rate that a nudge gives: a body that is slower has come to rest."""
LEAST_RATE = 1e-3
"""[rad/s]: nothing more still is asked for."""
NUDGED = 4.0
"""For which the masses stand aside at most [s]."""
CROSSWISE = 0.6
"""Of a nudge, in parts of that along: both horizontal axes are to swing."""
ARRIVED = 5e-5
"""[m]: a mass so near to its goal is there, but for its play."""


@dataclass(frozen=True)
class Kit:
    """One platform and the laws that act on it."""

    platform: Platform
    reach: Reach
    laws: dict[str, AnyController]

    def lean(self, estimate: Estimate) -> Array:
        """(n,) towards the stop, in parts of the way to it."""
        stop = min(self.platform.stop_angle, 0.5 * np.pi)
        return self.platform.lean(estimate.attitude) / stop

    def away(self, goal: Array, estimate: Estimate) -> Mask:
        """(n,) whether a mass is not yet where it is to be, (n, stages) [m]."""
        return np.abs(estimate.stage_position - goal).max(axis=1) > ARRIVED

    def across(self, rate: Array, estimate: Estimate) -> Array:
        """(n,) of a body rate (n, 3), what is not a turn about the vertical [rad/s]."""
        up = vertical_body(estimate.attitude)
        along = np.einsum("ni,ni->n", rate, up)[:, None] * up
        return np.asarray(np.linalg.norm(rate - along, axis=1))

    def still(self, amplitude: Array, stiffness: Array) -> Array:
        """(n,) rate below which the body has come to rest [rad/s]."""
        return STILL * np.maximum(amplitude * self.frequency(stiffness), LEAST_RATE)

    def aside_for(self, stiffness: Array) -> Array:
        """(n,) for how long a nudge lasts [s]: a sixth of a period or less."""
        return np.minimum(NUDGED, 1.0 / self.frequency(stiffness))

    def nudge(self, goal: Array, amplitude: Array, stiffness: Array) -> Array:
        """(n, stages) where masses at `goal` go aside, to make the body swing by the amplitude.

        A mass moment d for a time T turns a body at rest to the rate g d T / J, and that is the
        amplitude times sqrt(k / J). Towards the middle of each travel; never up or down.
        """
        rate = amplitude * self.frequency(stiffness)
        impulse = rate * mean_inertia(self.platform)
        size = impulse / (self.platform.gravity * self.aside_for(stiffness))
        low, high = self.reach.masses.travel
        inward = self.reach.moment(0.5 * (low + high) - goal)
        sign = np.where(inward < 0.0, -1.0, 1.0)
        aside = sign * size[:, None] * np.array([1.0, CROSSWISE, 0.0])
        return np.clip(goal + self.reach.masses.positions(aside), low, high)

    def frequency(self, stiffness: Array) -> Array:
        """(n,) sqrt(k / J) of the hanging body [rad/s]."""
        return np.sqrt(stiffness / mean_inertia(self.platform))
