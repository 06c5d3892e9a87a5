"""The linear screen: what any set of causes would gain where a fit stands, and the best set.

All rows of the logs are reduced to a triangle of as many rows as there are unknowns, once. In it
the base, free in every set, is projected out, and a set of causes is weighed in microseconds. Sets
are built forward, exchanged and dropped, as long as evidence pays.

Evidence is -2 log L gained, less what the numbers set would have gained by chance or by their
freedom: k (1 + log(gain / k)) for k numbers that all show alike, the price of a normal prior whose
width is the one that the data make likeliest (George and Foster 2000); a direction of a vector that
hardly shows costs little more than what chance gains by it. Beyond an effect's usual size, that
size has a log-normal prior (`Trace.surplus`). The usual k log(samples) asks more of
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
"""Share of a column below which, the base projected out, it is not identifiable: as much may be the
error of linearising the base."""
FITTED = 2.5e-3
"""The same share for what is fitted already: smaller, so that a cause near that limit is not found,
fitted and dropped again."""
KNOWN = 1e-6
"""The same share for what is linear in its size, as a sensor's constant error: what distinguishes
it from the base is a prior of platform.toml, without an error of linearising."""
ROUNDING = 1e-9
"""Share of the largest singular value below which a direction is numerical error."""
SLIGHT = 1.0
"""Standard deviations by which the largest strength of a cause must change the logs for it to be
observable."""
FALSE_ALARM = 0.003
"""Probability of naming any candidate in logs with nothing hidden."""
DRAWS = 20_000
"""Draws of noise for that probability."""
SEED = 1
MOST = 6
"""Causes in one set, at most."""
TIED = 6.0
"""Difference of evidence below which two explanations tie."""
EVEN = 2.0
"""The same for two that logs like these, without noise, would separate."""


@dataclass(frozen=True)
class Trace:
    """Description of one cause's columns in the linear screen."""

    label: str
    low: Array
    """(k,) bounds of the strengths."""
    high: Array
    shapes: int = 0
    """Number of shape parameters that a fit sets as well."""
    unlikely: float = 0.0
    """-2 log of its prior probability relative to a cause of the catalogue."""
    looked: float = 0.0
    """Logarithm of the number of shapes of which it is the best."""
    exact: bool = False
    """See `Effect`."""
    fitted: bool = False
    """Whether it is fitted already, and its columns are formed at the fit."""
    usual: Array | None = None
    """(k,) usual sizes of the strengths, inf of shapes; None of what has no usual size."""
    decades: float = 1.0
    """1 sigma of the logarithm of its size about the usual one, to base 10."""

    def surplus(self, strengths: Array) -> float:
        """-2 log of the prior probability of a size, relative to a usual one: log-normal above the
        usual size, flat below it."""
        if self.usual is None or not strengths.size:
            return 0.0
        times = float(np.max(np.abs(strengths) / self.usual))
        return (np.log10(max(times, 1.0)) / self.decades) ** 2

    @property
    def hidden(self) -> float:
        """Share of a column that must remain beside the base for it to be identifiable."""
        if self.exact:
            return KNOWN
        return FITTED if self.fitted else HIDDEN


@dataclass(frozen=True)
class Weighed:
    """The linear fit of a set of causes."""

    gain: float
    """Fall of -2 log L."""
    strengths: tuple[Array, ...]
    """Of each, within its bounds."""


class LinearScreen:
    """Linear model of whitened innovations, residual + columns s, for the strengths s of causes."""

    def __init__(
        self, residual: Array, base: Array, columns: Array, traces: Sequence[Trace]
    ) -> None:
        """Project the base out, and reduce the rows by a QR decomposition.

        Args:
            residual: (m,) of a model without the causes.
            base: (m, p) columns of what every set fits as well.
            columns: (m, sum of k) of the causes in their order.
            traces: of the causes.
        """
        self.traces = tuple(traces)
        edges = np.cumsum([0, *(len(trace.low) for trace in traces)])
        self._own = [np.arange(i, j) for i, j in zip(edges, edges[1:], strict=False)]
        whole = np.linalg.norm(columns, axis=0)
        reach = [np.maximum(np.abs(trace.low), np.abs(trace.high)) for trace in self.traces]
        observable = whole > SLIGHT / np.concatenate([np.zeros(0), *reach])
        self._observable = observable
        self.size = np.where(observable, whole, 1.0)
        """(sum of k,) of each column before the base was projected out."""
        scaled = np.column_stack([base / _norms(base), columns / self.size, residual])
        triangle = np.asarray(np.linalg.qr(scaled, mode="r"), dtype=np.float64)
        p = base.shape[1]
        own = triangle[p:, p:-1]
        counts = [len(trace.low) for trace in self.traces]
        least = np.repeat([trace.hidden for trace in self.traces], counts)
        self._columns = np.where(observable & (np.linalg.norm(own, axis=0) > least), own, 0.0)
        self._like_base = np.where(observable, triangle[:p, p:-1], 0.0)
        self._residual = triangle[p:, -1]
        self._known: dict[frozenset[int], Weighed] = {}
        self._information: dict[int, Array] = {}

    def identifiability(self, index: int) -> Array:
        """(k,) share of each column of a cause that no change of the base reproduces; 0 where it is
        not identifiable."""
        return np.linalg.norm(self._columns[:, self._own[index]], axis=0)

    def identifiable(self, index: int) -> bool:
        """Whether any column of a cause is identifiable beside the base."""
        return bool(np.any(self.identifiability(index) > 0.0))

    def observable(self, index: int) -> bool:
        """Whether a cause within its bounds changes these logs."""
        return bool(self._observable[self._own[index]].any())

    def information(self, index: int) -> Array:
        """(k,) Fisher information along each direction that a fit of a cause sets, for a strength
        of 1; of its shapes, which have no column, the mean of the others."""
        if index not in self._information:
            own = self._own[index]
            columns = self._columns[:, own] * self.size[own]
            count = int(np.count_nonzero(self.identifiability(index)))
            sizes = np.square(np.linalg.svd(columns, compute_uv=False))[:count]
            mean = float(sizes.mean()) if count else 1.0
            self._information[index] = np.append(sizes, np.full(self.traces[index].shapes, mean))
        return self._information[index]

    def basis(self, index: int) -> Array:
        """(r, k) orthonormal basis of a cause's columns."""
        columns = self._columns[:, self._own[index]]
        left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        return left[:, sizes > HIDDEN * max(float(sizes.max(initial=0.0)), HIDDEN)]

    def signature(self, index: int, strengths: Array) -> Array:
        """(r,) change of the innovations by a cause, the base projected out."""
        own = self._own[index]
        return self._columns[:, own] @ (strengths * self.size[own])

    def weigh(self, chosen: Sequence[int]) -> Weighed:
        """The linear fit of a set."""
        key = frozenset(chosen)
        if key not in self._known:
            self._known[key] = self._weigh(sorted(key))
        result = self._known[key]
        place = {index: i for i, index in enumerate(sorted(key))}
        return Weighed(result.gain, tuple(result.strengths[place[index]] for index in chosen))

    def size_of(self, index: int) -> Array:
        """(k,) norm of each column of a cause, the base not projected out."""
        return self.size[self._own[index]]

    def beyond(self, chosen: Sequence[int], others: Sequence[int]) -> tuple[float, float]:
        """Gain of further causes together beside a set, base and set held; and its degrees of
        freedom.

        Of a direction that the base reproduces in part, only the rest counts. With the base free,
        the difference to it may be the machine's response to noise through its control law, which
        correlates with the residual.

        The sum of share z^2 is approximated by a chi-square of the same mean and variance
        (Satterthwaite 1946).
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
        """The same causes, for logs without noise in which a set, as fitted, is the truth."""
        result = self.weigh(chosen)
        parts = [self.signature(i, s) for i, s in zip(chosen, result.strengths, strict=True)]
        return self.showing(sum(parts, start=np.zeros_like(self._residual)))

    def showing(self, signal: Array) -> "LinearScreen":
        """The same causes, for logs whose residual is a given signal (r,)."""
        same = copy(self)
        same._residual, same._known = -signal, {}
        return same

    def left(self, chosen: Sequence[int]) -> Array:
        """(r,) residual of a set's linear fit."""
        result = self.weigh(chosen)
        parts = [self.signature(i, s) for i, s in zip(chosen, result.strengths, strict=True)]
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
        """Bounded least squares: strengths outside their bounds are fixed there one after
        another."""
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
class CauseScore:
    """Evidence of a cause beside a set, by the linear screen."""

    index: int
    gain: float
    """Fall of -2 log L."""
    evidence: float
    surprise: float
    """Logarithm of the probability that noise gains as much for this cause or for any other shape
    of it (Bonferroni's bound)."""


def price(gain: float, information: Array) -> float:
    """Price of parameters that a fit sets, to be subtracted from its gain.

    -2 log of the marginal likelihood under a Gaussian prior, relative to the maximum: the sum of
    1 + log(1 + information width^2). The prior has one width for all parameters, the likeliest for
    this gain.

    Args:
        gain: fall of -2 log L.
        information: (k,) Fisher information of each parameter, for a strength of 1.
    """
    count = information.size
    if not count:
        return 0.0
    width_squared = max(gain - count, 0.0) / float(np.sum(information))
    return count + float(np.sum(np.log1p(information * width_squared)))


def critical(screen: LinearScreen, asked: Sequence[int]) -> float:
    """Surprise that the most surprising candidate reaches with probability `FALSE_ALARM` in noise.

    Parametric bootstrap in the whitened linear model, noise N(0, I), the base projected out.
    """
    rng = np.random.default_rng(SEED)
    bases = [screen.basis(index) for index in asked]
    noise = rng.standard_normal((DRAWS, bases[0].shape[0] if bases else 0))
    # among causes of equal degrees of freedom, the largest gain is the most surprising
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
    """Search over sets of causes in a linear screen."""

    def __init__(
        self, screen: LinearScreen, asked: Sequence[int], limit: float | None = None
    ) -> None:
        """Set up a search.

        Args:
            screen: of all causes.
            asked: places of those to search among; those that are not identifiable are left out.
            limit: surprise of a false alarm, where it is known from a larger set; else that of
                these.
        """
        self.screen = screen
        self.asked = tuple(index for index in asked if screen.identifiable(index))
        self._limit = limit

    @cached_property
    def limit(self) -> float:
        """Surprise that noise reaches with probability `FALSE_ALARM`."""
        return critical(self.screen, self.asked) if self._limit is None else self._limit

    def scores(self, chosen: tuple[int, ...] = ()) -> list[CauseScore]:
        """Scores of all other causes beside a set, by falling evidence."""
        result = [self.score(chosen, index) for index in self._others(chosen)]
        return sorted(result, key=lambda score: -score.evidence)

    def score(self, chosen: tuple[int, ...], index: int) -> CauseScore:
        """Score of one cause beside a set."""
        gain = self._gain((*chosen, index)) - self._gain(chosen)
        return self.scored(index, gain, self.surplus((*chosen, index), index))

    def scored(self, index: int, gain: float, surplus: float = 0.0) -> CauseScore:
        """Score of a cause of known gain, and of known improbability of its size."""
        gain = max(gain, 0.0)
        directions = np.count_nonzero(self.screen.identifiability(index))
        surprise = float(chi2.logsf(gain, max(directions, 1))) + self.screen.traces[index].looked
        return CauseScore(index, gain, gain - self._worth(index, gain) - surplus, surprise)

    def pays(self, score: CauseScore) -> bool:
        """Whether a cause has evidence, and is more surprising than a false alarm."""
        return score.surprise < self.limit and score.evidence > 0.0

    def evidence(self, chosen: tuple[int, ...]) -> float:
        """Evidence of a set against no cause.

        Each cause has the price of its gain beside the others. The total is at least the price of
        adding them one by one, the strongest first: of several that can replace each other, each
        gains little beside the others, and the first price alone would be too low.
        """
        beside = sum(self._price(chosen, index) for index in chosen)
        strongest = sorted(chosen, key=lambda index: -self._gain((index,)))
        in_turn = sum(
            self._price(tuple(strongest[: place + 1]), index)
            for place, index in enumerate(strongest)
        )
        return self._gain(chosen) - max(beside, in_turn)

    def best(self) -> tuple[int, ...]:
        """The set of the highest evidence in which each cause pays: greedy addition with exchanges,
        then removal."""
        chosen: tuple[int, ...] = ()
        while len(chosen) < MOST:
            out = [score for score in self.scores(chosen) if self.pays(score)]
            if not out:
                break
            chosen = self._exchanged((*chosen, out[0].index))
        while chosen:
            beside = [self.score(without(chosen, index), index) for index in chosen]
            weak = [score for score in beside if not self.pays(score)]
            if not weak:
                break
            chosen = without(chosen, min(weak, key=lambda s: s.evidence).index)
        return chosen

    def instead(self, chosen: tuple[int, ...], index: int) -> list[tuple[int, float]]:
        """Other causes in place of one, with the evidence that is lost, by rising loss.

        A vector that only reproduces a scalar loses by its additional parameters.
        """
        rest = without(chosen, index)
        evidence = self.evidence(chosen)
        result = [
            (other, evidence - self.evidence((*rest, other)))
            for other in self._others(rest)
            if self.screen.traces[other].label != self.screen.traces[index].label
        ]
        return sorted(result, key=lambda item: item[1])

    def apart(self, chosen: tuple[int, ...], index: int) -> dict[str, float]:
        """Evidence that each other cause in place of one would lose in logs without noise of which
        the set is the truth, by label; or likelihood alone, if that is less."""
        silent = Search(self.screen.noiseless(chosen), self.asked)
        rest, most = without(chosen, index), silent._gain(chosen)
        result: dict[str, float] = {}
        for other, behind in silent.instead(chosen, index):
            label = self.screen.traces[other].label
            far = min(behind, most - silent._gain((*rest, other)))
            result[label] = min(far, result.get(label, np.inf))
        return result

    def _others(self, chosen: tuple[int, ...]) -> list[int]:
        taken = {self.screen.traces[index].label for index in chosen}
        return [i for i in self.asked if self.screen.traces[i].label not in taken]

    def _exchanged(self, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """The set after all exchanges of one cause for another that add evidence."""
        now = self.evidence(chosen)
        while True:
            tries = [
                (*rest, other)
                for rest in (without(chosen, index) for index in chosen)
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
        gain = self._gain(chosen) - self._gain(without(chosen, index))
        return self._worth(index, max(gain, 0.0)) + self.surplus(chosen, index)

    def surplus(self, chosen: tuple[int, ...], index: int) -> float:
        """Price of the size that a cause has in a set."""
        strengths = self.screen.weigh(chosen).strengths[chosen.index(index)]
        return self.screen.traces[index].surplus(strengths)

    def _worth(self, index: int, gain: float) -> float:
        """Price of a cause at a gain."""
        return price(gain, self.screen.information(index)) + self.screen.traces[index].unlikely


def without(chosen: tuple[int, ...], index: int) -> tuple[int, ...]:
    """A set without one of its causes."""
    return tuple(item for item in chosen if item != index)
