"""A prediction linearised in its shared unknowns, and the cost that a fit minimises.

A segment that the model misses, because somebody pushed the machine, must not bend the parameters:
each segment has a noise scale of its own, at least that of its sensors, and the likelihood is taken
at its best. So a segment whose mean squared residual is x (in units of the noise) costs N x up to
x = 1 and N (1 + log x) beyond; in the iteration it weighs 1 / x.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REWEIGHTINGS = 30


@dataclass(frozen=True)
class Linear:
    """A linearised prediction: residual and columns, the initial states projected out."""

    residual: list[Array]
    """Of each segment, (N_s,)."""
    columns: list[Array]
    """Of each segment, (N_s, parameters)."""

    def after(self, step: Array) -> list[Array]:
        """The residual of each segment after a step of the parameters."""
        return [r + a @ step for r, a in zip(self.residual, self.columns, strict=True)]

    def weighed(self, like: list[Array]) -> "Linear":
        """Each segment at the weight that such a residual gives it."""
        roots = [np.sqrt(_weight(r)) for r in like]
        return Linear(
            [root * r for root, r in zip(roots, self.residual, strict=True)],
            [root * a for root, a in zip(roots, self.columns, strict=True)],
        )

    @property
    def normal(self) -> Array:
        """Sum of A^T A."""
        return np.sum([a.T @ a for a in self.columns], axis=0)

    @property
    def gradient(self) -> Array:
        """Sum of A^T r."""
        pairs = zip(self.columns, self.residual, strict=True)
        return np.sum([a.T @ r for a, r in pairs], axis=0)


def project(residual: list[Array], columns: list[Array], local: list[Array]) -> Linear:
    """Take out of residual and columns what the initial states can explain."""
    orthogonal = [np.linalg.qr(own)[0] for own in local]
    return Linear(
        [r - q @ (q.T @ r) for r, q in zip(residual, orthogonal, strict=True)],
        [a - q @ (q.T @ a) for a, q in zip(columns, orthogonal, strict=True)],
    )


def cost(residual: list[Array]) -> float:
    """Twice the negative log-likelihood, each segment at its own best noise scale."""
    total = 0.0
    for r in residual:
        x = float(r @ r) / len(r)
        total += len(r) * (x if x <= 1.0 else 1.0 + float(np.log(x)))
    return total


def _weight(residual: Array) -> float:
    return 1.0 / max(float(residual @ residual) / len(residual), 1.0)


def shared_step(flat: Linear, free: Mask) -> tuple[Array, list[Array]]:
    """The step of the free shared unknowns that is best for the linearised cost, and what is left.

    The weights follow the step within the linearised problem, which costs no prediction; with
    weights held over a step the iteration would creep.
    """
    step, ahead = np.zeros(len(free)), flat.residual
    for _ in range(REWEIGHTINGS if free.any() else 0):
        linear = flat.weighed(ahead)
        previous = step.copy()
        step[free] = -_solve(linear.normal[np.ix_(free, free)], linear.gradient[free])
        ahead = flat.after(step)
        if np.allclose(step, previous, rtol=1e-3, atol=0.0):
            break
    return step, ahead


def best_step(
    residual: list[Array], columns: list[Array], local: list[Array], free: Mask
) -> tuple[Array, Array]:
    """The step of the shared unknowns and of each initial state."""
    step, _ = shared_step(project(residual, columns, local), free)
    back = [
        -np.linalg.lstsq(own, r + a @ step, rcond=None)[0]
        for own, r, a in zip(local, residual, columns, strict=True)
    ]
    return step, np.array(back, dtype=np.float64)


def _solve(normal: Array, right: Array) -> Array:
    """Solve scaled normal equations; what the data do not show stays where it is."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * np.outer(scale, scale)
    return scale * np.linalg.lstsq(scaled, scale * right, rcond=1e-10)[0]
