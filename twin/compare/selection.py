"""Which few symptoms explain a log best, in the linearised problem: forward, swapped, dropped.

All sets are weighed where the model stands, without another rollout; what comes out is then fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from twin.compare.account import Account, Stand, imitated, shown
from twin.compare.symptoms import Symptom

Array = NDArray[np.float64]

FALSE_ALARM = 0.01
"""Chance of naming anything in a log that has nothing, over all that is asked."""
HIDDEN = 1e-2
"""A symptom of which less than this share is left when the base is free is not seen."""
NOT_SHOWN = 1e-6
"""Likewise when the states of the motion are free: a rate does not show what shifts the angle."""
MOST = 3
"""Symptoms named together; beyond, the numbers of a sum of simple laws mean little."""
MINOR = 1e-3
"""A law that brings less than this share of what all bring may be an error in the others' form."""
TIED = 6.0
"""Fall of -2 log L by which two explanations must differ for one to be preferred."""


@dataclass(frozen=True)
class Score:
    """What one symptom promises beside what a fit has."""

    symptom: Symptom
    evidence: float
    """Fall of -2 log L, in units of independent samples; 0 where its sign makes no sense."""
    strengths: Array
    """Linearised."""
    needed: float
    """Evidence that chance gives one of all symptoms once in 100 logs."""

    @property
    def stands_out(self) -> bool:
        """Beyond the chance of a false alarm."""
        return self.evidence > self.needed


class Screen:
    """A fit, linearised in all symptoms that it lacks."""

    def __init__(self, account: Account, symptoms: Sequence[Symptom]) -> None:
        self.account = account
        more = tuple(s for s in symptoms if s not in account.chosen)
        self._all = len(symptoms)
        self._stand: Stand = account.linearised(more)
        own = account.now.columns.shape[1]
        kept = own - len(account.strengths)
        self._base = np.arange(kept)
        self._columns: dict[str, NDArray[np.intp]] = {}
        first = kept
        for symptom in (*account.chosen, *more):
            last = first + len(symptom.perturbations)
            self._columns[symptom.name] = np.arange(first, last)
            first = last
        self._known: dict[frozenset[str], tuple[float, Array]] = {}
        self.symptoms = tuple(s for s in more if not self._hidden(s))

    def scores(self) -> list[Score]:
        """Of all symptoms that the fit lacks, the best first."""
        chosen = self.account.chosen
        before, _ = self._weigh(chosen)
        found: list[Score] = []
        for symptom in self.symptoms:
            after, change = self._weigh((*chosen, symptom))
            strengths = change[self._columns[symptom.name]]
            odd = symptom.dissipative and bool(np.all(strengths < 0.0))
            evidence = 0.0 if odd else max(before - after, 0.0)
            found.append(Score(symptom, evidence, strengths, self._needed(symptom)))
        return sorted(found, key=lambda score: -score.evidence)

    def select(self) -> tuple[Symptom, ...]:
        """The set that explains most, each of its symptoms beyond the chance of a false alarm."""
        chosen: tuple[Symptom, ...] = ()
        everything = (*self.account.chosen, *self.symptoms)
        while len(chosen) < MOST:
            best = min(
                (s for s in everything if s not in chosen),
                key=lambda s: self._cost((*chosen, s)),
                default=None,
            )
            if best is None or self._gain(chosen, best) < self._worth(chosen, best):
                break
            chosen = self._swapped((*chosen, best), everything)
        while chosen:
            rests = [(s, _without(chosen, s)) for s in chosen]
            weak = [
                (self._gain(rest, s), rest)
                for s, rest in rests
                if self._gain(rest, s) < self._worth(rest, s)
            ]
            if not weak:
                break
            chosen = min(weak, key=lambda one: one[0])[1]
        return chosen

    def ties(self, symptom: Symptom) -> list[Symptom]:
        """Others that would stand in for one of the fit's as well."""
        rest = _without(self.account.chosen, symptom)
        limit = self._cost(self.account.chosen) + TIED
        return [s for s in self.symptoms if self._cost((*rest, s)) < limit]

    def _hidden(self, symptom: Symptom) -> bool:
        """Whether other states of the motion, or another base, do the same."""
        if all(shown(self._stand, int(c)) < NOT_SHOWN for c in self._columns[symptom.name]):
            return True
        if self.account.problem.held:
            return False
        effects = self._stand.columns[:, self._columns[symptom.name]].T
        p = len(self.account.theta)
        return all(1.0 - imitated(self._stand, effect, p) < HIDDEN for effect in effects)

    def _swapped(
        self, chosen: tuple[Symptom, ...], everything: Sequence[Symptom]
    ) -> tuple[Symptom, ...]:
        """The set after every exchange of one for another that lowers the cost."""
        while True:
            tries = [
                (*_without(chosen, one), other)
                for one in chosen
                for other in everything
                if other not in chosen
            ]
            best = min(tries, key=self._cost, default=chosen)
            if self._cost(best) > self._cost(chosen) - TIED:
                return chosen
            chosen = best

    def _gain(self, chosen: tuple[Symptom, ...], symptom: Symptom) -> float:
        return self._cost(chosen) - self._cost((*chosen, symptom))

    def _cost(self, chosen: tuple[Symptom, ...]) -> float:
        """Infinite where a sign makes no sense."""
        cost, change = self._weigh(chosen)
        strengths = self._strengths(change)
        odd = any(s.dissipative and bool(np.all(strengths[s.name] < 0.0)) for s in chosen)
        return np.inf if odd else cost

    def _strengths(self, change: Array) -> dict[str, Array]:
        found = {name: change[columns].copy() for name, columns in self._columns.items()}
        first = 0
        for symptom in self.account.chosen:
            last = first + len(symptom.perturbations)
            found[symptom.name] += self.account.strengths[first:last]
            first = last
        return found

    def _weigh(self, chosen: Sequence[Symptom]) -> tuple[float, Array]:
        key = frozenset(s.name for s in chosen)
        if key not in self._known:
            columns = [self._columns[name] for name in sorted(key)]
            gone = [s for s in self.account.chosen if s.name not in key]
            change, cost, _ = self._stand_without(gone, np.concatenate([self._base, *columns]))
            self._known[key] = cost / self.account.inflation, change
        return self._known[key]

    def _stand_without(
        self, gone: list[Symptom], free: NDArray[np.intp]
    ) -> tuple[Array, float, Array]:
        """What the fit has can be taken out again: its strengths go back to 0."""
        if not gone:
            return self._stand.best(free)
        shift = np.zeros(self._columns_count)
        first = 0
        for symptom in self.account.chosen:
            last = first + len(symptom.perturbations)
            if symptom in gone:
                shift[self._columns[symptom.name]] = -self.account.strengths[first:last]
            first = last
        return self._stand.best(free, shift)

    @property
    def _columns_count(self) -> int:
        return int(max(columns[-1] for columns in self._columns.values())) + 1

    def _worth(self, chosen: tuple[Symptom, ...], symptom: Symptom) -> float:
        """What a symptom must bring beside others to be named."""
        brought = self._cost(()) - self._cost(chosen)
        return max(self._needed(symptom), MINOR * brought)

    def _needed(self, symptom: Symptom) -> float:
        freedom = len(symptom.perturbations)
        return float(chi2.isf(FALSE_ALARM / self._all, freedom))


def _without(chosen: tuple[Symptom, ...], symptom: Symptom) -> tuple[Symptom, ...]:
    return tuple(s for s in chosen if s is not symptom)
