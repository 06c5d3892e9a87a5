"""Take the states out of a linearised prediction: what is left depends on shared unknowns only.

A Kalman filter over the starts of the segments, its mean an affine function of the shared unknowns,
whitens what the segments say of them; a backward pass gives the states back. The first state is
unknown altogether. Nothing grows along the chain, be the machine unstable or not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgeqrf, dgeqrf_lwork

from twin.predict.whitening.linearised import Linearised
from twin.predict.whitening.spread import joined_root, root_of_any

Array = NDArray[np.float64]

_NOTHING = 1e-7
"""What the first segment does not show of its start is known this much worse than its numbers by
themselves, each in its own unit: they may be known to 1 rad/s and to 1e-12 rad."""


@dataclass(frozen=True)
class Chain:
    """residual + columns u is white noise of variance 1, the states gone.

    An affine function of u is kept as a matrix (x, 1 + u), its constant first.
    """

    rows: Array
    """(m, 1 + u) residual and columns."""
    segment: NDArray[np.intp]
    """(m,) the segment that each row comes from."""
    seen: list[Array]
    """Mean of each start, when its segment has been seen but none after it."""
    seen_spread: list[Array]
    """Likewise, its covariance (x, x)."""
    pull: list[Array]
    """h^T S^-1 times the innovation of each start."""
    keep: list[Array]
    """I - K h of each start."""
    told: list[Array]
    """(x, x) h^T S^-1 h of each start: what its segment says of it."""
    transition: Array
    logarithm: float
    """Log-determinant of the covariance that was divided out."""

    def states(self, change: Array) -> Array:
        """(S, x) smoothed starts for a change (u,) of the shared unknowns."""
        return self.backward(change)[0]

    def backward(self, change: Array) -> tuple[Array, Array]:
        """Smoothed starts (S, x), and their adjoints (S, x): what all from a start on says of it.

        A start is its mean before it was seen, and its covariance then times its adjoint. Bryson
        and Frazier's backward pass, which inverts no covariance: without noise in the motion these
        become singular.
        """
        u = np.concatenate([[1.0], change])
        adjoint = np.zeros(len(self.seen[0]))
        states: list[Array] = []
        adjoints: list[Array] = []
        for s in range(len(self.seen) - 1, -1, -1):
            after = self.transition[s].T @ adjoint if states else adjoint
            states.append(self.seen[s] @ u + self.seen_spread[s] @ after)
            adjoint = self.keep[s].T @ after - self.pull[s] @ u
            adjoints.append(adjoint)
        return np.stack(states[::-1]), np.stack(adjoints[::-1])

    def hindsight(self) -> Array:
        """(S, x, x) covariance of what later segments still change in each start, once seen."""
        says = np.zeros_like(self.seen_spread[0])
        found: list[Array] = []
        for s in range(len(self.seen) - 1, -1, -1):
            after = self.transition[s].T @ says @ self.transition[s] if found else says
            found.append(self.seen_spread[s] @ after @ self.seen_spread[s])
            says = self.keep[s].T @ after @ self.keep[s] + self.told[s]
        return np.stack(found[::-1])


def growth(linear: Linearised) -> float:
    """Logarithm of how much a volume of states grows along those directions in which it grows."""
    basis = np.eye(linear.state.shape[-1])
    total = np.zeros(len(basis))
    for transition in linear.transition:
        basis, triangle = np.linalg.qr(transition @ basis)
        total += np.log(np.abs(np.diag(triangle)))
    return float(np.sum(np.maximum(total, 0.0)))


def chain(linear: Linearised) -> Chain:
    """Eliminate the states of one log."""
    x = linear.state.shape[-1]
    triangle = np.stack([_triangle(linear, s) for s in range(len(linear.residual))])
    of_state, affine = triangle[:, :x, :x], triangle[:, :x, x:]
    rows = list(triangle[:, x:, x:])
    segment = [np.full(len(block), s) for s, block in enumerate(rows)]
    first = _regular(np.concatenate([of_state[0], affine[0]], axis=1))
    inverse = np.linalg.inv(first[:, :x])
    # The covariance's root is carried on: a heading that nothing tells may be open by radians where
    # the tilt is known to 1e-9, and their squares lie farther apart than a number has digits.
    mean: Array = -inverse @ first[:, x:]
    root: Array = np.asarray(inverse, dtype=np.float64)
    seen, seen_spread = [mean], [root @ root.T]
    logarithm = 2.0 * float(np.log(np.abs(np.diag(first))).sum())
    logarithm -= 2.0 * float(np.log(linear.known[linear.known > 0.0]).sum())
    pull, kept, told = [np.zeros_like(mean)], [np.zeros_like(root)], [np.zeros_like(root)]
    for s in range(1, len(of_state)):
        step = linear.transition[s - 1]
        push = np.column_stack([linear.jump[s - 1], linear.jump_shared[s - 1]])
        mean = step @ mean + push
        root = joined_root(step @ root, root_of_any(linear.spread[s - 1]))
        h = of_state[s]
        lower, gain, root = _updated(h, root)
        logarithm += 2.0 * float(np.log(np.diag(lower)).sum())
        white = np.linalg.solve(lower, affine[s] + h @ mean)
        rows.append(white)
        segment.append(np.full(x, s))
        mean = mean - gain @ white
        keep = np.eye(x) - gain @ np.linalg.solve(lower, h)
        seen.append(mean)
        seen_spread.append(root @ root.T)
        pull.append(h.T @ np.linalg.solve(lower.T, white))
        kept.append(keep)
        told.append(h.T @ np.linalg.solve(lower @ lower.T, h))
    return Chain(
        np.concatenate(rows),
        np.concatenate(segment),
        seen,
        seen_spread,
        pull,
        kept,
        told,
        linear.transition,
        logarithm,
    )


def _updated(h: Array, root: Array) -> tuple[Array, Array, Array]:
    """Root of the covariance of what h shows in white noise; how far a unit of its innovation moves
    the state; and the root of the state's covariance then.

    Args:
        h: (x, x).
        root: (x, x) of the covariance before.
    """
    x = len(h)
    lower = joined_root(np.block([[np.eye(x), h @ root], [np.zeros((x, x)), root]]))
    return lower[:x, :x], lower[x:, :x], lower[x:, x:]


def _triangle(linear: Linearised, segment: int) -> Array:
    """(k, k) of a segment's k = x + 1 + u columns: all that its rows say, and of the first one
    what is known of its start beforehand.

    LAPACK called in place: as `np.linalg.qr`, which copies the rows twice, and there are many.
    """
    x = linear.state.shape[2]
    shared = linear.shared[segment].T
    # not all that is shared does anything in it
    acting = np.flatnonzero(shared.any(axis=1))
    kept = np.concatenate([np.arange(x + 1), x + 1 + acting])
    n, k = shared.shape[1], len(kept)
    known = np.flatnonzero(linear.known) if segment == 0 else np.zeros(0, dtype=np.intp)
    columns = np.zeros((max(n + len(known), k), k), order="F")
    columns.T[:x, :n] = linear.state[segment].T
    columns.T[x, :n] = linear.residual[segment]
    columns.T[x + 1 :, :n] = shared[acting]
    columns[n + np.arange(len(known)), known] = linear.known[known]
    work = int(dgeqrf_lwork(*columns.shape)[0])
    factored = dgeqrf(columns, lwork=work, overwrite_a=True)[0]
    width = x + 1 + linear.shared.shape[-1]
    triangle = np.zeros((width, width))
    triangle[:k, kept] = np.triu(factored[:k])
    return triangle


def _regular(triangle: Array) -> Array:
    """(x, x + 1 + u) rows, with what they do not show of the state held weakly where it is."""
    x = len(triangle)
    shown = np.linalg.norm(triangle[:, :x], axis=0)
    least = np.min(shown[shown > 0.0], initial=1.0)
    floor = _NOTHING * np.where(shown > 0.0, shown, least)
    weak = np.column_stack([np.diag(floor), np.zeros((x, triangle.shape[1] - x))])
    joined: Array = np.asarray(np.linalg.qr(np.concatenate([triangle, weak]), mode="r"))
    return joined[:x]
