"""What a diagnosis names: causes with their sizes, intervals, rivals and confidence, what was
tried, and equations without a name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation, unseen
from twin.diagnose.laws import Law
from twin.diagnose.screen import EVEN, FALSE_ALARM, TIED, Search, price
from twin.effects import Effect, ScatterEffect, catalogue, effects_of
from twin.effects.effect import targets
from twin.identify.prediction_error import NORMAL
from twin.platform import Platform
from twin.predict.body import added_variance
from twin.predict.columns import amplitudes, slopes_of

Array = NDArray[np.float64]
LEANS = 0.2
"""Standard deviations by which a component moves with one that no log tells, if that is wrong by
its own size, from where on it is told only beside that."""
NEARBY = 1e-4
"""Of a component's typical size, to the other end of a finite difference; and what of a difference
is none."""
MOSTLY = 1.645
"""Standard deviations by which what is there must exceed what is needed to be found, so that noise
hides it in 5 of 100 logs."""
NAMELESS = 0.2
"""Of its confidence what a cause keeps beside something without a name: so many of those that
docs/diagnosis.md counts were right, or fewer."""


@dataclass(frozen=True)
class Uncertainty:
    """Of one effect."""

    deviations: Array
    """(p,) standard deviations, those held being what they are; NaN of those."""
    leaning: NDArray[np.bool_]
    """(p,) which would be others, were one that is held another."""


def uncertainties_of(explanation: Explanation) -> tuple[Uncertainty, ...]:
    """Of each effect of an explanation, by the logs and by what is known of sensors.

    A fit moves a shape no further than shapes are like, and holds what no log shows. Neither is
    knowledge: that a draft pushes at a point 0.3 m above the bearing is a place to begin from, and
    as far as the point is another, its force is.
    """
    if not explanation.effects:
        return ()
    platform = explanation.bodies[0].machine.platform
    free, sizes = (
        np.concatenate(explanation.free),
        np.concatenate([*map(amplitudes, explanation.effects)]),
    )
    held = ~free & ~sizes
    slopes = [part for effect in explanation.effects for part in slopes_of(effect, platform)]
    rows = explanation.rows_with(list(compress(slopes, held)))
    edge = rows.columns.shape[1] - np.count_nonzero(held)
    own = edge - len(explanation.laws) - np.count_nonzero(free) + np.arange(np.count_nonzero(free))
    # rows that hold shapes near where they began
    shapes = own[~sizes[free]]
    begun = (rows.cluster < 0) & rows.columns[:, shapes].any(axis=1)
    columns = rows.columns[~begun]
    scale = 1.0 / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    triangle = np.asarray(np.linalg.qr(columns * scale, mode="r"))
    inverse = scale[:edge, None] * np.linalg.pinv(triangle[:edge, :edge], rcond=1e-12)
    moves = (inverse @ triangle[:edge, edge:] / scale[edge:])[own]
    wrong = np.concatenate([np.maximum(np.abs(e.values), e.scale()) for e in explanation.effects])[
        held
    ]
    known, moved = np.zeros((len(free), edge)), np.zeros((len(free), len(wrong)))
    known[free], moved[free] = inverse[own], moves
    hidden = np.concatenate(unseen(explanation.effects, explanation.free, explanation.most))
    known[hidden] = inverse[edge - len(explanation.at.strengths) + explanation.layout.rests :][
        : hidden.sum()
    ]
    found: list[Uncertainty] = []
    first = 0
    for effect, ones in zip(explanation.effects, explanation.free, strict=True):
        part = slice(first, first := first + len(ones))
        share = _least_by(effect, platform)
        deviations = np.linalg.norm(share @ known[part], axis=1)
        leaning = np.abs(share @ moved[part]) @ wrong > LEANS * deviations
        # what is held is told where it goes with what is not
        tells = (np.abs(share) @ ones) > NEARBY
        found.append(Uncertainty(np.where(tells, deviations, np.nan), leaning & tells))
    return tuple(found)


def _least_by(effect: Effect, platform: Platform) -> Array:
    """(p, p) how the smallest effect that does the same goes with the components of one."""
    if effect.least(platform) is effect:
        return np.eye(len(effect.values))
    columns: list[Array] = []
    for unit in np.diag(NEARBY * effect.scale()):
        ends = [np.clip(effect.values + side * unit, *effect.bounds()) for side in (-1.0, 1.0)]
        before, after = (effect.with_values(end).least(platform).values for end in ends)
        columns.append((after - before) / np.sum(ends[1] - ends[0]))
    return np.column_stack(columns)


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
    explanation: Explanation, search: Search, rivals: Mapping[str, float], *, unexplained: bool
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
        zip(explanation.effects, explanation.free, uncertainties_of(explanation), strict=True)
    ):
        rest = tuple(other for other in explanation.own if other != index)
        evidence = search.evidence(explanation.own) - search.evidence(rest)
        instead = _as_fitted(search, search.instead(explanation.own, index), rivals)
        behind = [far for _, far in instead] + [max(evidence, 0.0)]
        beside = NORMAL * known.deviations
        half = np.where(known.leaning, np.nan, beside)
        share = share_of(behind) * (NAMELESS if unexplained else 1.0)
        alone = search.evidence((index,))
        ties = ties_of(search, instead, search.apart(explanation.own, index))
        least = effect.least(explanation.bodies[0].machine.platform)
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
        as_fitted = fitted.pop(search.screen.traces[other].label, behind)
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
        label = search.screen.traces[other].label
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
        screen = search.screen
        seen = screen.seen(score.index) * screen.size_of(score.index)
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


def equation_of(explanation: Explanation, evidence: float) -> Equation | None:
    """The laws of an explanation; None without any.

    Args:
        now: the explanation.
        evidence: that they brought beyond the best that the catalogue offers.
    """
    if not explanation.laws:
        return None
    spread = np.sqrt(np.diag(explanation.covariance))[-len(explanation.laws) :]
    return Equation(
        explanation.laws,
        explanation.at.strengths[explanation.layout.of_laws],
        NORMAL * spread,
        evidence,
    )


def scatter_causes(
    explanation: Explanation, taken: Sequence[Effect] = (), *, unexplained: bool = False
) -> tuple[Cause, ...]:
    """The best one beyond chance, if any, and those beside it; none where no motion follows.

    Args:
        now: the explanation that stands.
        taken: those that are found already.
        unexplained: something is at work that has no name.
    """
    platform = explanation.bodies[0].machine.platform
    if not explanation.follows:
        return ()
    unit = [
        kind(**kind.named([1.0]), target=target)
        for kind in catalogue()
        if issubclass(kind, ScatterEffect) and len(kind.parameters()) == 1
        for target in targets(kind.takes, platform)
    ]
    known = [one.label for one in (*effects_of(platform), *taken)]
    asked = [one for one in unit if not one.unfit(platform) and one.label not in known]
    found = [one for effect in asked if (one := _cause(explanation, effect, taken)) is not None]
    found.sort(key=lambda cause: -cause.evidence)
    if not found or np.exp(-0.5 * found[0].alone) > FALSE_ALARM / len(asked):
        return ()
    first, *others = found
    behind = {one.effect.label: first.evidence - one.evidence for one in others}
    share = share_of([*behind.values(), first.evidence]) * (NAMELESS if unexplained else 1.0)
    ties = tuple(Tie(label, far) for label, far in behind.items() if far < EVEN)
    named = replace(first, confidence=share, ties=ties, alone=first.evidence)
    rest = (
        () if ties else scatter_causes(explanation, (*taken, first.effect), unexplained=unexplained)
    )
    return (named, *rest)


def _cause(
    explanation: Explanation, effect: ScatterEffect, taken: Sequence[Effect]
) -> Cause | None:
    """Alone; its gain as it is stands for its evidence alone."""
    every = (*effects_of(explanation.bodies[0].machine.platform), *taken)
    others = [
        one for one in every if isinstance(one, ScatterEffect) and one.acts_on == effect.acts_on
    ]
    squares: list[Array] = []
    added: list[Array] = []
    stated: list[Array] = []
    for body, every_left in zip(explanation.bodies, explanation.account.left, strict=True):
        for output, left in zip(body.outputs, every_left, strict=True):
            if output.stream != effect.acts_on:
                continue
            squares.append(np.square(left * output.sigma))
            own = added_variance(effect, body.inputs, output.time)
            known = [added_variance(one, body.inputs, output.time) for one in others]
            added.append(own)
            stated.append(sum(known, start=np.zeros_like(own)))
    if not any(own.any() for own in added):
        return None
    square, more, declared = map(np.concatenate, (squares, added, stated))

    def cost(numbers: Array) -> float:
        variance = np.exp(numbers[0]) + declared + np.square(numbers[1] / scale) * more
        return float(np.sum(np.log(variance) + square / variance))

    scale = np.sqrt(more.mean() / square.mean())
    quiet = np.log(max(float(np.mean(square - declared)), 1e-3 * float(square.mean())))
    none = minimize(lambda a: cost(np.array([a[0], 0.0])), [quiet], method="Nelder-Mead")
    best = minimize(cost, [float(none.x[0]), 0.3], method="Nelder-Mead")
    gain = float(none.fun - best.fun)
    evidence = gain - price(gain, np.ones(1))
    if evidence <= 0.0:
        return None
    size = abs(float(best.x[1]))
    step = 0.02 * size
    side = [cost(np.array([best.x[0], size + sign * step])) for sign in (-1.0, 1.0)]
    bend = max((side[0] + side[1] - 2.0 * float(best.fun)) / step**2, 1e-300)
    half = NORMAL * np.sqrt(2.0 / bend) / scale
    there = effect.with_values(np.clip([size / scale], *effect.bounds()))
    width = np.array([half])
    return Cause(there, np.array([True]), width, width, evidence, gain, 1.0, ())
