"""Which few causes explain the logs: forward, exchanged, dropped, as long as evidence pays.

Evidence is -2 log L gained, less what the numbers set would have gained by chance or by their
freedom: k (1 + log(gain / k)) for k numbers that all show alike, the price of a normal prior whose
width is the one that the data make likeliest (George and Foster 2000); a direction of a vector that
hardly shows costs little more than what chance gains by it. The usual k log(samples) asks more of
a vector than of a number however many samples say little, and gives weak vectors other names.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from twin.diagnose.weighing import Weighing

Array = NDArray[np.float64]

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


def critical(weighing: Weighing, asked: Sequence[int]) -> float:
    """Surprise that the most surprising cause reaches by chance with probability `FALSE_ALARM`.

    Parametric bootstrap in the whitened linear model, noise N(0, I), the base projected out.
    """
    rng = np.random.default_rng(SEED)
    bases = [weighing.basis(index) for index in asked]
    noise = rng.standard_normal((DRAWS, bases[0].shape[0] if bases else 0))
    # of causes with as many directions the one that gains most is the most surprising
    most: dict[int, Array] = {}
    for index, basis in zip(asked, bases, strict=True):
        along = noise @ basis
        if basis.shape[1] == 1 and weighing.traces[index].low[0] == 0.0:
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
        self, weighing: Weighing, asked: Sequence[int], limit: float | None = None
    ) -> None:
        """Among some.

        Args:
            weighing: of all.
            asked: which of them.
            limit: surprise that noise reaches in a false alarm, where more were asked before; else
                it is that of these.
        """
        self.weighing = weighing
        self.asked = tuple(index for index in asked if weighing.shown(index))
        self._limit = limit

    @cached_property
    def limit(self) -> float:
        """Surprise that noise reaches in a false alarm."""
        return critical(self.weighing, self.asked) if self._limit is None else self._limit

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
        seen = np.count_nonzero(self.weighing.seen(index))
        surprise = float(chi2.logsf(gain, max(seen, 1))) + self.weighing.traces[index].looked
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
            if self.weighing.traces[other].label != self.weighing.traces[index].label
        ]
        return sorted(found, key=lambda one: one[1])

    def apart(self, chosen: tuple[int, ...], index: int) -> dict[str, float]:
        """How far each other cause would be behind in one's place, had the logs no noise and were
        the set the truth, by label: in evidence, or in likelihood alone if that is less."""
        silent = Search(self.weighing.noiseless(chosen), self.asked)
        rest, most = less(chosen, index), silent._gain(chosen)
        found: dict[str, float] = {}
        for other, behind in silent.instead(chosen, index):
            label = self.weighing.traces[other].label
            far = min(behind, most - silent._gain((*rest, other)))
            found[label] = min(far, found.get(label, np.inf))
        return found

    def _others(self, chosen: tuple[int, ...]) -> list[int]:
        taken = {self.weighing.traces[index].label for index in chosen}
        return [i for i in self.asked if self.weighing.traces[i].label not in taken]

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
        return self.weighing.weigh(chosen).gain

    def _price(self, chosen: tuple[int, ...], index: int) -> float:
        gain = self._gain(chosen) - self._gain(less(chosen, index))
        return self._worth(index, max(gain, 0.0))

    def _worth(self, index: int, gain: float) -> float:
        """What a gain must pay for."""
        return price(gain, self.weighing.information(index)) + self.weighing.traces[index].unlikely


def less(chosen: tuple[int, ...], index: int) -> tuple[int, ...]:
    """A set without one."""
    return tuple(one for one in chosen if one != index)
