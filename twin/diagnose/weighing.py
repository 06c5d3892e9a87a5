"""What any set of causes would gain, where a fit stands: the linearised problem in small.

All rows of the logs are squeezed into a triangle of as many rows as there are unknowns, once. In it
the base, free in every set, is projected out, and a set of causes is weighed in microseconds.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

HIDDEN = 1e-2
"""A direction of which less than this share is left when the base is free cannot be told from it:
what is left may be the error of a linearised base."""
FITTED = 2.5e-3
"""Less of what a fit has settled where it stands, or a share close to that would be found, fitted,
and dropped as none."""
KNOWN = 1e-6
"""But of what is linear in its size, a sensor's constant error. What is left of that beside the
base is what platform.toml says of either, and no error."""
ROUNDING = 1e-9
"""Share of the largest singular value below which a direction is none."""
SLIGHT = 1.0
"""Nor is one seen whose largest strength changes the logs by no more standard deviations."""


@dataclass(frozen=True)
class Trace:
    """What one cause does to the whitened innovations, the base projected out."""

    label: str
    low: Array
    """(k,) bounds of the strengths."""
    high: Array
    shapes: int = 0
    """Numbers that a fit of it would set besides."""
    unlikely: float = 0.0
    """-2 log of how probable it is beforehand beside a cause of the catalogue."""
    looked: float = 0.0
    """Logarithm of how many like it were looked among, of which it is the best."""
    exact: bool = False
    """See `Effect`."""
    fitted: bool = False
    """Whether a fit has settled it where its columns are formed."""

    @property
    def hidden(self) -> float:
        """Share that must be left of a column for it to be told from the base."""
        if self.exact:
            return KNOWN
        return FITTED if self.fitted else HIDDEN


@dataclass(frozen=True)
class Weighed:
    """The best that a set of causes can do."""

    gain: float
    """Fall of -2 log L."""
    strengths: tuple[Array, ...]
    """Of each, within its bounds."""


class Weighing:
    """residual + columns s, for the strengths s of all causes; white, variance 1."""

    def __init__(
        self, residual: Array, base: Array, columns: Array, traces: Sequence[Trace]
    ) -> None:
        """Squeeze.

        Args:
            residual: (m,) of a model without any of the causes.
            base: (m, p) what is free in every set.
            columns: (m, sum of k) of the causes in their order.
            traces: of the causes.
        """
        self.traces = tuple(traces)
        edges = np.cumsum([0, *(len(trace.low) for trace in traces)])
        self._own = [np.arange(i, j) for i, j in zip(edges, edges[1:], strict=False)]
        whole = np.linalg.norm(columns, axis=0)
        reach = [np.maximum(np.abs(trace.low), np.abs(trace.high)) for trace in self.traces]
        felt = whole > SLIGHT / np.concatenate([np.zeros(0), *reach])
        self._felt = felt
        self.size = np.where(felt, whole, 1.0)
        """(sum of k,) of each column before the base was projected out."""
        scaled = np.column_stack([base / _norms(base), columns / self.size, residual])
        triangle = np.asarray(np.linalg.qr(scaled, mode="r"), dtype=np.float64)
        p = base.shape[1]
        own = triangle[p:, p:-1]
        counts = [len(trace.low) for trace in self.traces]
        least = np.repeat([trace.hidden for trace in self.traces], counts)
        self._columns = np.where(felt & (np.linalg.norm(own, axis=0) > least), own, 0.0)
        self._like_base = np.where(felt, triangle[:p, p:-1], 0.0)
        self._residual = triangle[p:, -1]
        self._known: dict[frozenset[int], Weighed] = {}
        self._information: dict[int, Array] = {}

    def seen(self, index: int) -> Array:
        """(k,) share of each column of a cause that no change of the base could take; 0 of those
        that cannot be told from it."""
        return np.linalg.norm(self._columns[:, self._own[index]], axis=0)

    def shown(self, index: int) -> bool:
        """Whether any of a cause is left beside the base."""
        return bool(np.any(self.seen(index) > 0.0))

    def felt(self, index: int) -> bool:
        """Whether any of a cause does anything to these logs, within its bounds."""
        return bool(self._felt[self._own[index]].any())

    def information(self, index: int) -> Array:
        """(k,) of a cause along each direction that a fit of it would set: squared length of what
        it does there at strength 1; of its shapes, which have no strength, as on average."""
        if index not in self._information:
            own = self._own[index]
            columns = self._columns[:, own] * self.size[own]
            count = int(np.count_nonzero(self.seen(index)))
            shown = np.square(np.linalg.svd(columns, compute_uv=False))[:count]
            mean = float(shown.mean()) if count else 1.0
            self._information[index] = np.append(shown, np.full(self.traces[index].shapes, mean))
        return self._information[index]

    def basis(self, index: int) -> Array:
        """(r, k) orthonormal directions of a cause."""
        columns = self._columns[:, self._own[index]]
        left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        return left[:, sizes > HIDDEN * max(float(sizes.max(initial=0.0)), HIDDEN)]

    def signature(self, index: int, strengths: Array) -> Array:
        """(r,) what a cause of these strengths does, the base projected out."""
        own = self._own[index]
        return self._columns[:, own] @ (strengths * self.size[own])

    def weigh(self, chosen: Sequence[int]) -> Weighed:
        """The best that a set can do."""
        key = frozenset(chosen)
        if key not in self._known:
            self._known[key] = self._weigh(sorted(key))
        found = self._known[key]
        place = {index: i for i, index in enumerate(sorted(key))}
        return Weighed(found.gain, tuple(found.strengths[place[index]] for index in chosen))

    def size_of(self, index: int) -> Array:
        """(k,) length of each column of a cause at strength 1, the base not projected out."""
        return self.size[self._own[index]]

    def beyond(self, chosen: Sequence[int], others: Sequence[int]) -> tuple[float, float]:
        """What others gain together beside a set, the base and the set staying where they are; and
        in how many directions, as chi-square has them.

        Not the base's own: what others do that it could do too counts for the share that it could
        not. Were it free beside them, what tells it from them might be no more than how the machine
        trembled under a law that answers to noise; and what follows the noise of the samples before
        seems, less its mean over those after, to know of the noise.

        The sum of share z^2 is taken for a chi-square of the same mean and variance (Satterthwaite
        1946).
        """
        taken = np.concatenate([np.zeros(0, dtype=np.intp), *(self._own[i] for i in chosen)])
        basis = np.linalg.qr(self._columns[:, taken])[0]
        wanted = np.concatenate([self._own[i] for i in others])
        columns = np.concatenate([self._like_base[:, wanted], self._columns[:, wanted]])
        left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        apart = left[len(self._like_base) :, sizes > ROUNDING * sizes[0]]
        gain = float(np.sum(np.square(apart.T @ self.left(chosen))))
        free = apart - basis @ (basis.T @ apart)
        share = np.square(np.linalg.svd(free, compute_uv=False))
        total, squares = float(np.sum(share)), float(np.sum(np.square(share)))
        if squares == 0.0:  # the set does all that they do
            return 0.0, 1.0
        return gain * total / squares, total**2 / squares

    def noiseless(self, chosen: Sequence[int]) -> "Weighing":
        """The same causes, had the logs no noise and a set, as it is weighed, been all there is."""
        found = self.weigh(chosen)
        parts = [self.signature(i, s) for i, s in zip(chosen, found.strengths, strict=True)]
        return self.showing(sum(parts, start=np.zeros_like(self._residual)))

    def showing(self, signal: Array) -> "Weighing":
        """The same causes, were a signature (r,) all that the logs show."""
        same = copy(self)
        same._residual, same._known = -signal, {}
        return same

    def left(self, chosen: Sequence[int]) -> Array:
        """(r,) what a set leaves."""
        found = self.weigh(chosen)
        parts = [self.signature(i, s) for i, s in zip(chosen, found.strengths, strict=True)]
        return self._residual + sum(parts, start=np.zeros_like(self._residual))

    def _weigh(self, chosen: list[int]) -> Weighed:
        own = [self._own[index] for index in chosen]
        columns = np.concatenate([np.zeros(0, dtype=np.intp), *own])
        low = np.concatenate([np.zeros(0), *(self.traces[i].low for i in chosen)])
        high = np.concatenate([np.zeros(0), *(self.traces[i].high for i in chosen)])
        strengths = self._bounded(columns, low, high)
        left = self._residual + self._columns[:, columns] @ (strengths * self.size[columns])
        gain = float(self._residual @ self._residual - left @ left)
        edges = np.cumsum([len(part) for part in own])[:-1]
        return Weighed(gain, tuple(np.split(strengths, edges)) if own else ())

    def _bounded(self, columns: Index, low: Array, high: Array) -> Array:
        """Least squares, those that leave their bounds held there one after the other."""
        strengths = np.zeros(len(columns))
        free = np.ones(len(columns), dtype=bool)
        for _ in range(len(columns) + 1):
            fixed = self._columns[:, columns[~free]] @ (strengths * self.size[columns])[~free]
            solved = np.linalg.lstsq(
                self._columns[:, columns[free]], -self._residual - fixed, rcond=1e-9
            )[0]
            strengths[free] = solved / self.size[columns[free]]
            out = np.maximum(low - strengths, strengths - high) * self.size[columns]
            worst = int(np.argmax(np.where(free, out, -np.inf))) if len(columns) else 0
            if not len(columns) or not free.any() or out[worst] <= 0.0:
                break
            strengths[worst] = np.clip(strengths[worst], low[worst], high[worst])
            free[worst] = False
        return strengths


def _norms(columns: Array) -> Array:
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
