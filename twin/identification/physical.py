"""The rigid body nearest to what logs say: what noise took beyond the possible is given back.

A body of mass m, mass moment h and inertia J about a point is made of positive masses only if

    P = [[m, h^T], [h, tr(J) / 2 - J]]

has no negative eigenvalue: J is positive, its moments keep the triangle inequality, and h is not
longer than such a body has room for (P. M. Wensing, S. Kim and J.-J. E. Slotine, IEEE RA-L 3,
2018). Such P are a convex set, linear in J and h. The projection on it, in the metric of the
covariance, brings an estimate nearer to every body there is, so intervals around it cover no less.
P is kept possible by its Cholesky factor (C. Rucker and P. M. Wensing, IEEE RA-L 7, 2022), without
the logarithm on its diagonal: what is sought lies on the border, where an entry of it is 0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.model import carried_properties
from twin.predict.base import ENTRIES, BaseParameters

Array = NDArray[np.float64]

THINNEST = 1e-6
"""Of the mean eigenvalue of tr(J) / 2 - J: where the projection starts, inside the possible."""
ROUNDING = 1e-12
"""Of a covariance, as correlations: parts that are smaller are not known."""
NEGLIGIBLE = 1e-3
"""Standard deviations that an estimate is moved without a word."""
NOT_NOISE = 3.0
"""Standard deviations that noise carries an estimate no further than once in 700 logs."""


@dataclass(frozen=True)
class Nearest:
    """The nearest rigid body."""

    theta: Array
    """(p,)."""
    distance: float
    """How far the estimate was from it, in standard deviations; 0: it was one."""

    @property
    def sentence(self) -> str:
        """What to say of it; empty where nothing is."""
        if self.distance == 0.0:
            return ""
        said = (
            f"What fits best is {self.distance:.1f} standard deviations from any rigid body; the "
            "nearest one is given."
        )
        if self.distance <= NOT_NOISE:
            return said
        return f"{said} That is not noise: look at the mass, the wheels' inertia and the model."


def nearest_body(base: BaseParameters, theta: Array, covariance: Array) -> Nearest:
    """Project an estimate (p,) with its covariance (p, p) on the bodies that there are.

    What the machine carries is known; the rest of it, its bus, must be a body. On a hinge J keeps
    its stated proportions, so it is returned as it is.
    """
    machine = base.machine
    if machine.platform.base.kind != "ball":
        return Nearest(theta, 0.0)
    carried = carried_properties(machine.model, machine.base_body)
    mass = machine.platform.mass - carried.mass
    known = np.array([carried.inertia[i, j] for i, j in ENTRIES])
    entries = base.entries(theta) - np.concatenate([known, carried.center_of_mass_offset])
    moment, second = entries[6:], _second_moment(entries[:6])
    core = second - np.outer(moment, moment) / mass
    size, axes = np.linalg.eigh(core)
    floor = THINNEST * float(np.abs(size).mean())
    if size[0] >= 0.0:
        return Nearest(theta, 0.0)
    lower = np.linalg.cholesky((axes * np.maximum(size, floor)) @ axes.T)
    inside = np.tril_indices(3, -1)
    metric = _metric(covariance)
    count = len(base.joints)

    def change(x: Array) -> Array:
        factor = np.diag(x[:3])
        factor[inside] = x[3:6]
        body = factor @ factor.T + np.outer(x[6:9], x[6:9]) / mass
        inertia = np.trace(body) * np.eye(3) - body
        found = np.concatenate([[inertia[i, j] for i, j in ENTRIES], x[6:9]])
        return np.concatenate([found - entries, x[9:]])

    start = np.concatenate([np.diag(lower), lower[inside], moment, np.zeros(count)])
    best = least_squares(lambda x: metric @ change(np.asarray(x)), start)
    distance = float(np.sqrt(2.0 * best.cost))
    if distance < NEGLIGIBLE:
        return Nearest(theta, 0.0)
    return Nearest(theta + change(np.asarray(best.x)), distance)


def _metric(covariance: Array) -> Array:
    """M with M^T M = covariance^-1; of what a fit that did not settle left, too, where rounding
    may have spoilt a covariance of which little is known."""
    size = np.sqrt(np.abs(np.diag(covariance)))
    share, axes = np.linalg.eigh(covariance / np.outer(size, size))
    return (axes / np.sqrt(np.maximum(share, ROUNDING * share[-1]))).T / size


def _second_moment(inertia: Array) -> Array:
    """(3, 3) tr(J) / 2 - J of (6,) entries."""
    tensor = np.empty((3, 3))
    for value, (i, j) in zip(inertia, ENTRIES, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return 0.5 * np.trace(tensor) * np.eye(3) - tensor
