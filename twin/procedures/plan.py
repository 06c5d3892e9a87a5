"""What to do about an identified mass moment: done, a move, or a better look.

Vertical balancing comes from below: with the CM above the CR the body falls over. So the height
is raised by at most half of what is left, identified anew after each step, and kept where m r_z and
three standard deviations stay below zero by a margin.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MARGIN = 0.2
"""By which the CM stays below the CR, in parts of the mass moment that the target allows."""
AIM = 0.5
"""Height that is aimed at, below the CR, in the same parts."""
WORTH = 0.25
"""Height by which a further step must raise the CM where the target is kept already, in the same
parts: so a balancing ends where it was aimed, and not wherever it first does well enough."""
SIGMAS = 3.0
"""Standard deviations that the CM stays below the CR besides."""
KNOWN = 0.2
"""Standard deviation of m r_z, in parts of itself or of the target's, that is good enough to move
by."""


@dataclass(frozen=True)
class Aim:
    """What is to be reached."""

    torque: float
    """Gravity torque that may be left at the worst attitude [N m]."""
    gravity: float
    """[m/s^2]."""

    @property
    def moment(self) -> float:
        """m r that may be left [kg m]."""
        return self.torque / self.gravity

    def is_known(self, moment: Array, covariance: Array) -> bool:
        """Whether m r (3,) with its covariance (3, 3) is good enough to move by."""
        size = max(float(np.linalg.norm(moment)), AIM * self.moment)
        worst = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        return worst < KNOWN * size

    def is_kept(self, moment: Array, covariance: Array, quantile: float) -> bool:
        """Whether the upper end of the interval keeps the target and the CM is surely below."""
        low = -MARGIN * self.moment
        below = moment[2] + SIGMAS * float(np.sqrt(covariance[2, 2])) <= low
        _, _, high = length(moment, covariance, quantile)
        return bool(below and high <= self.moment)

    def is_worth(self, change: Array) -> bool:
        """Whether a change (3,) of m r raises the CM by so much that a kept target is no reason to
        leave it."""
        return bool(change[2] > WORTH * self.moment)

    def change(self, moment: Array, covariance: Array, *, in_plane: bool) -> Array:
        """(3,) mass moment to add [kg m]: all of it in the plane, the height from below.

        Args:
            moment: (3,) m r [kg m].
            covariance: (3, 3) of it.
            in_plane: whether the masses, rather than a law, bring the CM under the CR.
        """
        sigma = float(np.sqrt(covariance[2, 2]))
        goal = -max(AIM * self.moment, MARGIN * self.moment + SIGMAS * sigma)
        height = float(moment[2])
        raised = goal if height > goal else min(goal, 0.5 * height)
        across = -moment[:2] if in_plane else np.zeros(2)
        return np.array([*across, raised - height])


def length(vector: Array, covariance: Array, quantile: float) -> tuple[float, float, float]:
    """|vector| of a vector (k,) that is known to a covariance (k, k), and its interval.

    To first order: that of the component along it.
    """
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        half = quantile * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        return 0.0, 0.0, half
    along = vector / size
    half = quantile * float(np.sqrt(along @ covariance @ along))
    return size, max(size - half, 0.0), size + half
