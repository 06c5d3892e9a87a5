"""What a diagnosis names: causes with sizes and rivals, what was tried, laws without a name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation
from twin.diagnose.law import Law
from twin.diagnose.search import EVEN, TIED, Search
from twin.diagnose.told import told
from twin.effects import Effect
from twin.identify.prediction_error import NORMAL
from twin.predict.effects.columns import amplitudes

Array = NDArray[np.float64]

MOSTLY = 1.645
"""Standard deviations by which what is there must exceed what is needed to be found, so that noise
hides it in 5 of 100 logs."""
NAMELESS = 0.2
"""Of its confidence what a cause keeps beside something without a name: so many of those that
docs/diagnosis.md counts were right, or fewer."""


@dataclass(frozen=True)
class Tie:
    """A cause that would explain the logs about as well in another's place."""

    label: str
    behind: float
    """Evidence by which it is behind."""


@dataclass(frozen=True)
class Cause:
    """One thing that the model lacks."""

    effect: Effect
    """As fitted."""
    free: NDArray[np.bool_]
    """(p,) which components were fitted; the others cannot be told and keep typical values."""
    half_widths: Array
    """(p,) of the 95 % intervals; NaN where not fitted, and where the others are told only beside
    one that is not: of a force at an unknown distance its torque alone."""
    beside: Array
    """(p,) likewise, those that were not fitted being what they are."""
    evidence: float
    """Against the best model without it."""
    alone: float
    """Evidence on its own, against no cause at all."""
    confidence: float
    ties: tuple[Tie, ...]


@dataclass(frozen=True)
class Tried:
    """A cause that was asked for, beside the final ones."""

    label: str
    evidence: float
    """What it would add now; below 0: its numbers cost more than they gain."""
    alone: float
    """What it would have explained on its own."""
    detectable: Array
    """(k,) size of each amplitude that would have been found, alone; infinite where no size that
    the effect can have would have been."""
    names: tuple[str, ...]
    """(k,) of the amplitudes."""
    units: tuple[str, ...]
    """(k,) SI."""

    @property
    def could_show(self) -> bool:
        """Whether these logs could have shown any of it."""
        return bool(np.isfinite(self.detectable).any())


@dataclass(frozen=True)
class Equation:
    """A sum of products that explains what no cause of the catalogue does."""

    laws: tuple[Law, ...]
    coefficients: Array
    """(l,) of the laws, each in its unit (SI)."""
    half_widths: Array
    """(l,) of the 95 % intervals."""
    evidence: float
    """Against the best that the catalogue offers."""


def causes_of(
    now: Explanation, search: Search, rivals: Mapping[str, float], *, unexplained: bool
) -> tuple[Cause, ...]:
    """The effects of an explanation, the surest first.

    Args:
        now: the explanation.
        search: where it stands.
        rivals: by how much those are behind that were fitted in an only cause's place, by label.
        unexplained: something is at work that has no name; it may be all of what a cause was
            found for.
    """
    found: list[Cause] = []
    for index, (effect, free, known) in enumerate(
        zip(now.effects, now.free, told(now), strict=True)
    ):
        rest = tuple(other for other in now.own if other != index)
        evidence = search.evidence(now.own) - search.evidence(rest)
        instead = _as_fitted(search, search.instead(now.own, index), rivals)
        behind = [far for _, far in instead] + [max(evidence, 0.0)]
        beside = NORMAL * known.deviations
        half = np.where(known.leaning, np.nan, beside)
        share = share_of(behind) * (NAMELESS if unexplained else 1.0)
        alone = search.evidence((index,))
        ties = ties_of(search, instead, search.apart(now.own, index))
        least = effect.least(now.bodies[0].machine.platform)
        told_of = free | np.isfinite(known.deviations)
        found.append(Cause(least, told_of, half, beside, evidence, alone, share, ties))
    return tuple(sorted(found, key=lambda cause: -cause.evidence))


def _as_fitted(
    search: Search, instead: Sequence[tuple[int, float]], rivals: Mapping[str, float]
) -> list[tuple[int, float]]:
    """What could stand in a cause's place, those that were fitted there no further behind than that
    showed."""
    fitted, found = dict(rivals), list(instead)
    for place, (other, behind) in enumerate(instead):
        # of a cause of many shapes it was the nearest that was fitted
        as_fitted = fitted.pop(search.weighing.traces[other].label, behind)
        found[place] = (other, min(behind, as_fitted))
    return sorted(found, key=lambda one: one[1])


def ties_of(
    search: Search, instead: Sequence[tuple[int, float]], apart: Mapping[str, float]
) -> tuple[Tie, ...]:
    """What could stand in the place of one of a set, the nearest first.

    What these logs would tell from it, were it the truth, is only where it came out about even; its
    confidence says how far the rest is behind.

    Args:
        search: where it stands.
        instead: `Search.instead` of that one.
        apart: `Search.apart` of it.
    """
    found: dict[str, Tie] = {}
    for other, behind in instead:
        label = search.weighing.traces[other].label
        if behind < (TIED if apart[label] < TIED else EVEN):
            found.setdefault(label, Tie(label, behind))
    return tuple(found.values())


def share_of(behind: Sequence[float]) -> float:
    """Probability of an explanation beside rivals that are so much behind in evidence."""
    return float(1.0 / (1.0 + np.sum(np.exp(-0.5 * np.clip(behind, -1400.0, 1400.0)))))


def tried_of(search: Search, own: tuple[int, ...], asked: Sequence[Candidate]) -> tuple[Tried, ...]:
    """Every cause that is not among the final ones."""
    first = len(own)
    best: dict[str, Tried] = {}
    for score in search.scores(own):
        if score.index < first:
            continue
        one = asked[score.index - first]
        size = amplitudes(one.effect)
        names = [name for name, free in zip(one.effect.names, size, strict=True) if free]
        units = [k.unit for k in one.effect.parameters() for _ in range(k.size)]
        weighing = search.weighing
        seen = weighing.seen(score.index) * weighing.size_of(score.index)
        # of what rings anywhere, as many frequencies could have seemed to by chance
        needed = float(chi2.isf(np.exp(search.limit - one.looked), len(names)))
        least = (np.sqrt(needed) + MOSTLY) / np.maximum(seen, 1e-300)
        most = np.maximum(np.abs(one.low), np.abs(one.high))
        tried = Tried(
            one.label,
            score.evidence,
            search.evidence((score.index,)),
            np.where(least > most, np.inf, least),
            tuple(names),
            tuple(unit for unit, free in zip(units, size, strict=True) if free),
        )
        best.setdefault(one.label, tried)
    return tuple(best.values())


def equation_of(now: Explanation, evidence: float) -> Equation | None:
    """The laws of an explanation; None without any.

    Args:
        now: the explanation.
        evidence: that they brought beyond the best that the catalogue offers.
    """
    if not now.laws:
        return None
    spread = np.sqrt(np.diag(now.covariance))[-len(now.laws) :]
    return Equation(now.laws, now.at.strengths[now.layout.of_laws], NORMAL * spread, evidence)
