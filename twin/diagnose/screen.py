"""The linear screen: what any set of causes would gain where a fit stands, and the best set.

All rows of the logs are reduced to a triangle of as many rows as there are unknowns, once. In it
the base, free in every set, is projected out, and a set of causes is weighed in microseconds. Sets
are built forward, exchanged and dropped, as long as evidence pays.

Evidence is -2 log L gained, less what the numbers set would have gained by chance or by their
freedom: k (1 + log(gain / k)) for k numbers that all show alike, the price of a normal prior whose
width is the one that the data make likeliest (George and Foster 2000); a direction of a vector that
hardly shows costs little more than what chance gains by it. The usual k log(samples) asks more of
a vector than of a number however many samples say little, and gives weak vectors other names.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

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
FALSE_ALARM = 0.003
"""Chance of naming anything in logs that hide nothing, over all that is asked."""
DRAWS = 20_000
"""Of noise, from which that chance is found."""
SEED = 1
MOST = 6
"""Causes named together."""
TIED = 6.0
"""Evidence by which two explanations must differ for one to be preferred."""
EVEN = 2.0
"""And by which those must that logs like these could have told apart."""


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


class LinearScreen:
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

    def noiseless(self, chosen: Sequence[int]) -> "LinearScreen":
        """The same causes, had the logs no noise and a set, as it is weighed, been all there is."""
        found = self.weigh(chosen)
        parts = [self.signature(i, s) for i, s in zip(chosen, found.strengths, strict=True)]
        return self.showing(sum(parts, start=np.zeros_like(self._residual)))

    def showing(self, signal: Array) -> "LinearScreen":
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


@dataclass(frozen=True)
class Score:
    """What a cause promises beside those that are chosen."""

    index: int
    gain: float
    """Fall of -2 log L."""
    evidence: float
    surprise: float
    """Logarithm of the chance that noise gains as much for this cause, or for one of those that it
    was taken from (at most; Bonferroni)."""


def price(gain: float, information: Array) -> float:
    """What must be taken off a gain that was had by setting some numbers.

    -2 log of their likelihood under a prior of one width for all, that which most likely gains so
    much, beside their best: sum of 1 + log(1 + information width^2).

    Args:
        gain: fall of -2 log L.
        information: (k,) of them along as many directions, of a strength of 1: by how much one
            that is true lowers it.
    """
    count = information.size
    if not count:
        return 0.0
    width_squared = max(gain - count, 0.0) / float(np.sum(information))
    return count + float(np.sum(np.log1p(information * width_squared)))


def critical(screen: LinearScreen, asked: Sequence[int]) -> float:
    """Surprise that the most surprising cause reaches by chance with probability `FALSE_ALARM`.

    Parametric bootstrap in the whitened linear model, noise N(0, I), the base projected out.
    """
    rng = np.random.default_rng(SEED)
    bases = [screen.basis(index) for index in asked]
    noise = rng.standard_normal((DRAWS, bases[0].shape[0] if bases else 0))
    # of causes with as many directions the one that gains most is the most surprising
    most: dict[int, Array] = {}
    for index, basis in zip(asked, bases, strict=True):
        along = noise @ basis
        if basis.shape[1] == 1 and screen.traces[index].low[0] == 0.0:
            along = np.maximum(along, 0.0)
        gain = np.sum(np.square(along), axis=1)
        directions = max(basis.shape[1], 1)
        most[directions] = np.maximum(most.get(directions, 0.0), gain)
    least = np.zeros(DRAWS)
    for directions, gain in most.items():
        least = np.minimum(least, chi2.logsf(gain, directions))
    return float(np.quantile(least, FALSE_ALARM))


class Search:
    """Sets of causes, weighed."""

    def __init__(
        self, screen: LinearScreen, asked: Sequence[int], limit: float | None = None
    ) -> None:
        """Among some.

        Args:
            screen: of all.
            asked: which of them.
            limit: surprise that noise reaches in a false alarm, where more were asked before; else
                it is that of these.
        """
        self.screen = screen
        self.asked = tuple(index for index in asked if screen.shown(index))
        self._limit = limit

    @cached_property
    def limit(self) -> float:
        """Surprise that noise reaches in a false alarm."""
        return critical(self.screen, self.asked) if self._limit is None else self._limit

    def scores(self, chosen: tuple[int, ...] = ()) -> list[Score]:
        """Of all causes beside those chosen, the best first."""
        found = [self.score(chosen, index) for index in self._others(chosen)]
        return sorted(found, key=lambda score: -score.evidence)

    def score(self, chosen: tuple[int, ...], index: int) -> Score:
        """Of one beside those chosen."""
        return self.scored(index, self._gain((*chosen, index)) - self._gain(chosen))

    def scored(self, index: int, gain: float) -> Score:
        """Of one that was seen to gain so much."""
        gain = max(gain, 0.0)
        seen = np.count_nonzero(self.screen.seen(index))
        surprise = float(chi2.logsf(gain, max(seen, 1))) + self.screen.traces[index].looked
        return Score(index, gain, gain - self._worth(index, gain), surprise)

    def pays(self, score: Score) -> bool:
        """Whether a cause is worth its price, and more surprising than chance."""
        return score.surprise < self.limit and score.evidence > 0.0

    def evidence(self, chosen: tuple[int, ...]) -> float:
        """Of a set against nothing at all.

        Each cause pays for what it gains beside the others; and all of them at least as much as if
        they came in turn, the strongest first: several that can do without any one of them gain
        next to nothing each, and had them all for nothing.
        """
        beside = sum(self._price(chosen, index) for index in chosen)
        strongest = sorted(chosen, key=lambda index: -self._gain((index,)))
        in_turn = sum(
            self._price(tuple(strongest[: place + 1]), index)
            for place, index in enumerate(strongest)
        )
        return self._gain(chosen) - max(beside, in_turn)

    def best(self) -> tuple[int, ...]:
        """The set with the most evidence, each of its causes beyond the chance of a false alarm."""
        chosen: tuple[int, ...] = ()
        while len(chosen) < MOST:
            out = [score for score in self.scores(chosen) if self.pays(score)]
            if not out:
                break
            chosen = self._exchanged((*chosen, out[0].index))
        while chosen:
            beside = [self.score(less(chosen, index), index) for index in chosen]
            weak = [score for score in beside if not self.pays(score)]
            if not weak:
                break
            chosen = less(chosen, min(weak, key=lambda s: s.evidence).index)
        return chosen

    def instead(self, chosen: tuple[int, ...], index: int) -> list[tuple[int, float]]:
        """Each other cause in one's place: which, and the evidence that is lost; the best first.

        A vector that would have to point just so to do what a number does loses by its freedom.
        """
        rest = less(chosen, index)
        evidence = self.evidence(chosen)
        found = [
            (other, evidence - self.evidence((*rest, other)))
            for other in self._others(rest)
            if self.screen.traces[other].label != self.screen.traces[index].label
        ]
        return sorted(found, key=lambda one: one[1])

    def apart(self, chosen: tuple[int, ...], index: int) -> dict[str, float]:
        """How far each other cause would be behind in one's place, had the logs no noise and were
        the set the truth, by label: in evidence, or in likelihood alone if that is less."""
        silent = Search(self.screen.noiseless(chosen), self.asked)
        rest, most = less(chosen, index), silent._gain(chosen)
        found: dict[str, float] = {}
        for other, behind in silent.instead(chosen, index):
            label = self.screen.traces[other].label
            far = min(behind, most - silent._gain((*rest, other)))
            found[label] = min(far, found.get(label, np.inf))
        return found

    def _others(self, chosen: tuple[int, ...]) -> list[int]:
        taken = {self.screen.traces[index].label for index in chosen}
        return [i for i in self.asked if self.screen.traces[i].label not in taken]

    def _exchanged(self, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """After every exchange of one for another that adds evidence."""
        now = self.evidence(chosen)
        while True:
            tries = [
                (*rest, other)
                for rest in (less(chosen, index) for index in chosen)
                for other in self._others(rest)
            ]
            best = max(tries, key=self.evidence, default=chosen)
            there = self.evidence(best)
            if there <= now + 1e-6:
                return chosen
            chosen, now = best, there

    def _gain(self, chosen: tuple[int, ...]) -> float:
        return self.screen.weigh(chosen).gain

    def _price(self, chosen: tuple[int, ...], index: int) -> float:
        gain = self._gain(chosen) - self._gain(less(chosen, index))
        return self._worth(index, max(gain, 0.0))

    def _worth(self, index: int, gain: float) -> float:
        """What a gain must pay for."""
        return price(gain, self.screen.information(index)) + self.screen.traces[index].unlikely


def less(chosen: tuple[int, ...], index: int) -> tuple[int, ...]:
    """A set without one."""
    return tuple(one for one in chosen if one != index)
