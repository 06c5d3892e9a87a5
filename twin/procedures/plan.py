"""What to do about an identified mass moment: done, a move, or a better look.

Vertical balancing comes from below: with the CM above the CR the body falls over. So the height
is raised by at most half of what is left, identified anew after each step, and kept where m r_z and
three standard deviations stay below zero by a margin.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

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

    |v| is too long where v is small, since errors across it only ever lengthen it: on average
    |v|^2 = |truth|^2 + tr C. So the low end is that of the component along v, what lies across
    taken off, and it is 0 where the k-dimensional 95 % region of v holds the origin. The high end
    bounds |u| in the ellipsoid (u - v)^T C^-1 (u - v) <= quantile^2: to first order it is the
    component's, too, and it is longer where another direction is known far worse.

    It is the project's own. Drawn (k = 2, 3; axes known alike to 30 times worse; truths of 0 to 5
    standard deviations) it holds the truth 93 times in 100 or more: 94 to 98 with axes alike, and
    up to always for a truth along the best known of axes that are not.
    """
    size = float(np.linalg.norm(vector))
    turned = float(np.sqrt(vector @ covariance @ vector))
    worst = float(np.linalg.eigvalsh(covariance)[-1])
    high = float(np.sqrt(size**2 + 2.0 * quantile * turned + quantile**2 * worst))
    if size == 0.0 or _may_be_nothing(vector, covariance, quantile):
        return size, 0.0, high
    along = turned / size
    across = float(np.trace(covariance)) - along**2
    low = float(np.sqrt(max(size**2 - across, 0.0))) - quantile * along
    return size, max(low, 0.0), high


def _may_be_nothing(vector: Array, covariance: Array, quantile: float) -> bool:
    """Whether v^T C^-1 v is within its 95 %, also of a C without an inverse: c C >= v v^T."""
    edge = quantile**2 * chi2.ppf(0.95, len(vector)) / chi2.ppf(0.95, 1)
    return bool(np.linalg.eigvalsh(edge * covariance - np.outer(vector, vector))[0] >= 0.0)
