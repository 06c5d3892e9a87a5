"""Prediction in independent segments: each has its own start and its own noise scale.

For logs of a machine with a large model error at all times: a gear that chatters, a body that is
pushed. A segment's noise is at least that of its sensors, and the likelihood is maximised over it:
a segment of mean squared residual x costs N x up to x = 1 and N (1 + log x) above. In the iteration
it has the weight 1 / x, so that a disturbed segment does not bias the parameters.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.predict.body import Body, Exact
from twin.predict.innovations import Problem, Unknowns

Array = NDArray[np.float64]
REWEIGHTINGS = 30
ITERATIONS = 15
HALVINGS = 6
CONVERGED = 0.1
"""Fall of the cost at which the iteration ends: a third of a standard deviation."""
DAMPINGS = (1e-3, 1e-2, 1e-1)
"""Tried one after the other where no part of a step is better, though one was foretold to be."""
SHOWN = 1e-9
"""Directions of the unknowns that show less than this share of the best one stay."""


@dataclass(frozen=True)
class Link:
    """A log's segments, the states gone."""

    rows: Array
    """(m, 1 + u) residual and columns."""
    segment: NDArray[np.intp]
    """(m,)."""
    of_state: Array
    """(S, x, x), and with it"""
    affine: Array
    """(S, x, 1 + u): of_state x + affine (1, u) is zero at the best start x."""

    def states(self, change: Array) -> Array:
        """(S, x) best starts for a change (u,) of the shared unknowns."""
        right = self.affine @ np.concatenate([[1.0], change])
        return np.stack(
            [
                -np.linalg.lstsq(a, b, rcond=SHOWN)[0]
                for a, b in zip(self.of_state, right, strict=True)
            ]
        )


@dataclass(frozen=True)
class IndependentSegments:
    """Logs linearised so."""

    at: Unknowns
    exact: tuple[Exact, ...]
    links: tuple[Link, ...]
    residual: Array
    """(m,)."""
    columns: Array
    """(m, p + all biases + a), then what was only added to be scored."""
    cluster: NDArray[np.intp]
    """(m,) which segment of which log a row comes from; -1: what was known beforehand."""
    counts: Array
    """(segments,) numbers predicted in each, all logs."""

    def best(
        self, free: NDArray[np.intp], shift: Array | None = None, *, damping: float = 0.0
    ) -> tuple[Array, float, Array]:
        """The change of some unknowns that is best for the linearised cost.

        The weights follow the change within the linearised problem, which costs no prediction; with
        weights held over a step the iteration would creep.

        Args:
            free: indices of those unknowns.
            shift: a change of all unknowns that comes first.
            damping: Levenberg and Marquardt's, in parts of what each column says by itself.

        Returns:
            The change of all unknowns, the cost after it, and the weights (segments,) there.
        """
        change = np.zeros(self.columns.shape[1])
        first = self.residual if shift is None else self.residual + self.columns @ shift
        ahead = first
        weights = self._weights(ahead)
        for _ in range(REWEIGHTINGS if len(free) else 0):
            root = np.sqrt(self._of_rows(weights))
            step = np.zeros_like(change)
            step[free] = _solved(self.columns[:, free] * root[:, None], -first * root, damping)
            settled = np.allclose(step, change, rtol=1e-3, atol=0.0)
            change, ahead = step, first + self.columns @ step
            weights = self._weights(ahead)
            if settled:
                break
        return change, self._cost(ahead), weights

    @property
    def cost(self) -> float:
        """Where the unknowns stand."""
        return self._cost(self.residual)

    @property
    def weights(self) -> Array:
        """(segments,) where the unknowns stand."""
        return self._weights(self.residual)

    def normal(self, weights: Array) -> Array:
        """A^T A at some weights."""
        weighed = self.columns * np.sqrt(self._of_rows(weights))[:, None]
        return weighed.T @ weighed

    def scores(self, weights: Array, after: Array) -> Array:
        """(segments, unknowns) gradient of each segment, after a change."""
        scores = np.zeros((len(self.counts), self.columns.shape[1]))
        own = self.cluster >= 0
        left = (self.residual + self.columns @ after) * self._of_rows(weights)
        np.add.at(scores, self.cluster[own], (self.columns * left[:, None])[own])
        return scores

    def _spread(self, residual: Array) -> Array:
        """(segments,) mean squared residual."""
        own = self.cluster >= 0
        squares = np.bincount(
            self.cluster[own], np.square(residual[own]), minlength=len(self.counts)
        )
        return squares / np.maximum(self.counts, 1.0)

    def _weights(self, residual: Array) -> Array:
        return 1.0 / np.maximum(self._spread(residual), 1.0)

    def _of_rows(self, weights: Array) -> Array:
        return np.where(self.cluster >= 0, weights[self.cluster], 1.0)

    def _cost(self, residual: Array) -> float:
        x = self._spread(residual)
        own = np.where(x <= 1.0, x, 1.0 + np.log(np.maximum(x, 1.0)))
        known = residual[self.cluster < 0]
        return float(self.counts @ own + known @ known)


def link(exact: Exact) -> Link:
    """Eliminate the states of one log, segment by segment."""
    linear = exact.linear
    x = linear.state.shape[-1]
    stack = np.concatenate([linear.state, linear.residual[..., None], linear.shared], axis=-1)
    triangle = np.asarray(np.linalg.qr(stack, mode="r"), dtype=np.float64)
    rest = triangle[:, x:, x:]
    segment = np.repeat(np.arange(len(rest)), rest.shape[1])
    return Link(rest.reshape(-1, rest.shape[-1]), segment, triangle[:, :x, :x], triangle[:, :x, x:])


def independent_segments(
    problem: Problem, at: Unknowns, exact: tuple[Exact, ...]
) -> IndependentSegments:
    """What was linearised at some unknowns, its segments apart."""
    links = tuple(link(item) for item in exact)
    added = exact[0].linear.shared.shape[-1] - len(at.theta) - len(at.biases[0])
    stacked, cluster = problem.stacked(at, links, added)
    counts = np.concatenate([counts_of(body) for body in problem.bodies])
    return IndependentSegments(at, exact, links, stacked[:, 0], stacked[:, 1:], cluster, counts)


def counts_of(body: Body) -> Array:
    """(S,) numbers predicted in each segment."""
    counts = np.zeros(body.grid.segments)
    for output in body.outputs:
        counts += np.bincount(output.segment, minlength=body.grid.segments) * output.slot.shape[1]
    return counts


def fit_independent_segments(problem: Problem, start: Unknowns) -> IndependentSegments:
    """Gauss-Newton; returns the prediction linearised at the unknowns that predict the logs best.

    Raises:
        TwinError: no rigid body has the base that the iteration starts from.
    """
    now = independent_segments(problem, start, problem.exact(start))
    free = np.arange(now.columns.shape[1])
    freed = False
    for _ in range(ITERATIONS):
        step, foretold, _ = now.best(free)
        tried = _moved(problem, now, step)
        if tried is None and now.cost - foretold > CONVERGED:
            tries = (
                _moved(problem, now, now.best(free, damping=damping)[0]) for damping in DAMPINGS
            )
            tried = next((item for item in tries if item is not None), None)
            if tried is None and not freed:
                # columns mislead along states that are far from their best: those go there first
                tried, freed = _moved(problem, now, 0.0 * step, room=CONVERGED), True
                if tried is not None:
                    now = tried
                    continue
        if tried is None:
            break
        fall, now = now.cost - tried.cost, tried
        if fall < CONVERGED:
            break
    return now


def _moved(
    problem: Problem, segments: IndependentSegments, step: Array, room: float = 0.0
) -> IndependentSegments | None:
    """After the largest part of a step that makes things better, or worse by less than so much;
    None without any."""
    for halving in range(HALVINGS if step.any() else 1):
        part = 0.5**halving * step
        try:
            at = segments.at.moved(part, segments.links)
            with np.errstate(all="ignore"):  # of a motion on its way out of physics
                tried = independent_segments(problem, at, problem.exact(at))
        except TwinError:
            continue
        if tried.cost < segments.cost + room:
            return tried
    return None


def _solved(columns: Array, right: Array, damping: float = 0.0) -> Array:
    """Least squares in units of each column's size; damped, if asked, likewise."""
    size = 1.0 / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    columns = columns * size
    if damping:
        columns = np.concatenate([columns, np.sqrt(damping) * np.eye(len(size))])
        right = np.concatenate([right, np.zeros(len(size))])
    return np.linalg.lstsq(columns, right, rcond=SHOWN)[0] * size
