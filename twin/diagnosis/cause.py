"""Results of a diagnosis: causes with sizes, intervals, ties and confidence; rejected candidates;
equations of unnamed laws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2

from twin.conventions.joint import rate_lag
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.explanation import Explanation, unseen
from twin.diagnosis.laws import Law
from twin.diagnosis.screen import EVEN, FALSE_ALARM, TIED, Search, price
from twin.effects import Effect, ScatterEffect, catalogue, effect_named, effects_of
from twin.effects.effect import targets
from twin.identification.prediction_error import NORMAL
from twin.platform import Platform
from twin.predict.body import added_variance
from twin.predict.columns import amplitudes, slopes_of
from twin.recording import Recording

Array = NDArray[np.float64]
LEANS = 0.2
"""Standard deviations by which a component changes with one that is not identifiable, if that is
wrong by its own size, above which its interval is stated only for a given value of the other."""
NEARBY = 1e-4
"""Step of a finite difference, in parts of a component's typical size; and a difference that counts
as 0."""
MOSTLY = 1.645
"""Standard deviations by which an effect must exceed the detection limit to be detected in 95 of
100 logs."""
NAMELESS = 0.2
"""Factor of a cause's confidence beside something unexplained: an upper bound of the share of such
causes in docs/diagnosis.md that are right."""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of one effect's components."""

    deviations: Array
    """(p,) standard deviations, given the components that are not fitted; NaN of those."""
    leaning: NDArray[np.bool_]
    """(p,) which depend on the value of a component that is not fitted."""


def uncertainties_of(explanation: Explanation) -> tuple[Uncertainty, ...]:
    """Uncertainty of each effect by the logs and the priors of sensors alone.

    The prior of a shape and the values of components that are not fitted serve the fit; they are no
    knowledge. A draft's point of 0.3 m above the bearing is a start, and with another point its
    force is another.
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
    # priors of shapes
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
    uncertainties: list[Uncertainty] = []
    first = 0
    for effect, ones in zip(explanation.effects, explanation.free, strict=True):
        part = slice(first, first := first + len(ones))
        share = _least_by(effect, platform)
        deviations = np.linalg.norm(share @ known[part], axis=1)
        leaning = np.abs(share @ moved[part]) @ wrong > LEANS * deviations
        # a component that is not fitted has an uncertainty where it follows one that is
        tells = (np.abs(share) @ ones) > NEARBY
        uncertainties.append(Uncertainty(np.where(tells, deviations, np.nan), leaning & tells))
    return tuple(uncertainties)


def _least_by(effect: Effect, platform: Platform) -> Array:
    """(p, p) derivative of the smallest equivalent effect with respect to the components."""
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
    """A cause that explains the logs about as well in another's place."""

    label: str
    behind: float
    """Evidence that it has less."""


@dataclass(frozen=True)
class Cause:
    """One thing that the model lacks."""

    effect: Effect
    """As fitted."""
    free: NDArray[np.bool_]
    """(p,) which components were fitted; the others are not identifiable and have typical
    values."""
    half_widths: Array
    """(p,) of the 95 % intervals; NaN where not fitted, and where the component depends on one that
    is not: of a force at an unknown distance, only the torque has an interval."""
    beside: Array
    """(p,) of the 95 % intervals given the components that were not fitted."""
    evidence: float
    """Relative to the best model without it."""
    alone: float
    """Evidence of this cause alone, relative to the baseline."""
    confidence: float
    ties: tuple[Tie, ...]


@dataclass(frozen=True)
class Tried:
    """A candidate that is not among the causes."""

    label: str
    evidence: float
    """Evidence that it would add; negative where its price exceeds its gain."""
    alone: float
    """Evidence of it alone, relative to the baseline."""
    detectable: Array
    """(k,) smallest detectable size of each amplitude, alone; infinite where no size within the
    effect's bounds is detectable."""
    names: tuple[str, ...]
    """(k,) of the amplitudes."""
    units: tuple[str, ...]
    """(k,) SI."""

    @property
    def could_show(self) -> bool:
        """Whether any of its amplitudes is detectable."""
        return bool(np.isfinite(self.detectable).any())


@dataclass(frozen=True)
class Equation:
    """A sum of unnamed laws that explains what no cause of the catalogue explains."""

    laws: tuple[Law, ...]
    coefficients: Array
    """(l,) of the laws, each in its unit (SI)."""
    half_widths: Array
    """(l,) of the 95 % intervals."""
    evidence: float
    """Relative to the best set of causes."""


def causes_of(
    explanation: Explanation,
    search: Search,
    others: Mapping[frozenset[str], float],
    *,
    unexplained: bool,
) -> tuple[Cause, ...]:
    """The effects of an explanation as causes, by falling evidence.

    Args:
        explanation: the final one.
        search: the linear screen there.
        others: evidence that other fitted sets lose, by the labels of their causes and laws; of a
            set that was not fitted, the screen's prediction counts.
        unexplained: whether something else is unexplained, which may also explain each cause.
    """
    causes: list[Cause] = []
    labels = frozenset(part.label for part in (*explanation.effects, *explanation.laws))
    for index, (effect, free, known) in enumerate(
        zip(explanation.effects, explanation.free, uncertainties_of(explanation), strict=True)
    ):
        rest = tuple(other for other in explanation.own if other != index)
        remaining = labels - {effect.label}
        linear = search.evidence(explanation.own) - search.evidence(rest)
        evidence = others.get(remaining, linear)
        lost = {
            label: behind
            for item, behind in others.items()
            if len(item) == len(labels) and item > remaining
            for label in item - labels
        }
        instead = _as_fitted(search, search.instead(explanation.own, index), lost)
        if not explanation.follows:
            # the columns of independent segments may predict of a rival what no fit of it shows
            instead = [item for item in instead if search.screen.traces[item[0]].label in lost]
        behind = [far for _, far in instead] + [max(evidence, 0.0)]
        beside = NORMAL * known.deviations
        half = np.where(known.leaning, np.nan, beside)
        share = share_of(behind) * (NAMELESS if unexplained else 1.0)
        alone = search.evidence((index,))
        ties = ties_of(search, instead, search.apart(explanation.own, index))
        least = effect.least(explanation.bodies[0].machine.platform)
        told_of = free | np.isfinite(known.deviations)
        causes.append(Cause(least, told_of, half, beside, evidence, alone, share, ties))
    return tuple(sorted(causes, key=lambda cause: -cause.evidence))


def late_rate(logs: Sequence[Recording]) -> Cause | None:
    """A joint_rate that is late beside the joint_angle of the same hinge, by the two alone.

    Where a model of the motion misses by far, its residual hides what the two sensors of one hinge
    show without it. The lags of all logs must agree. One below a sample's interval is none: a
    controller reads its sensors one after the other.

    Returns:
        The cause, in a tie with an early joint_angle; None without such a lag.
    """
    found = [item for item in map(rate_lag, logs) if item is not None]
    if not found or len(found) < len(logs):
        return None
    lag, half_width = np.array(found).T
    if not (half_width > 0.0).all() or not np.isfinite(half_width).all():
        return None
    weight = np.square(NORMAL / half_width)
    mean, known = float(weight @ lag / weight.sum()), float(NORMAL / np.sqrt(weight.sum()))
    interval = max(float(np.median(np.diff(log["joint_rate"].time))) for log in logs)
    agree = np.abs(lag - mean) < half_width + interval
    if abs(mean) < interval + known or not agree.all():
        return None
    effect = effect_named("clock_lag").typical("joint_rate").with_values(np.array([mean]))
    evidence = (NORMAL * mean / known) ** 2
    tie = Tie(effect.label.replace("joint_rate", "joint_angle"), 0.0)
    half = np.array([known])
    return Cause(
        effect, np.array([True]), half, half, evidence, evidence, share_of((0.0, evidence)), (tie,)
    )


def _as_fitted(
    search: Search, instead: Sequence[tuple[int, float]], lost: Mapping[str, float]
) -> list[tuple[int, float]]:
    """Other causes in place of one, and the evidence that is lost; of those that were fitted there,
    by label, what their fits lose."""
    fitted, result = dict(lost), list(instead)
    for place, (other, behind) in enumerate(instead):
        # of several shapes of a cause, the nearest was fitted
        result[place] = (other, fitted.pop(search.screen.traces[other].label, behind))
    return sorted(result, key=lambda item: item[1])


def ties_of(
    search: Search, instead: Sequence[tuple[int, float]], apart: Mapping[str, float]
) -> tuple[Tie, ...]:
    """Causes that tie with one of a set, the nearest first.

    A cause that these logs would separate from it, were it the truth, ties only if the evidence is
    about even.

    Args:
        search: the linear screen.
        instead: `Search.instead` of that cause.
        apart: `Search.apart` of it.
    """
    result: dict[str, Tie] = {}
    for other, behind in instead:
        label = search.screen.traces[other].label
        if behind < (TIED if apart[label] < TIED else EVEN):
            result.setdefault(label, Tie(label, behind))
    return tuple(result.values())


def share_of(behind: Sequence[float]) -> float:
    """Probability of an explanation beside rivals that have so much less evidence."""
    return float(1.0 / (1.0 + np.sum(np.exp(-0.5 * np.clip(behind, -1400.0, 1400.0)))))


def tried_of(
    search: Search, own: tuple[int, ...], candidates: Sequence[Candidate]
) -> tuple[Tried, ...]:
    """All candidates that are not among the causes."""
    first = len(own)
    best: dict[str, Tried] = {}
    for score in search.scores(own):
        if score.index < first:
            continue
        item = candidates[score.index - first]
        size = amplitudes(item.effect)
        names = [name for name, free in zip(item.effect.names, size, strict=True) if free]
        units = [k.unit for k in item.effect.parameters() for _ in range(k.size)]
        screen = search.screen
        seen = screen.identifiability(score.index) * screen.size_of(score.index)
        # the detection limit of the best of many shapes is higher
        needed = float(chi2.isf(np.exp(search.limit - item.looked), len(names)))
        least = (np.sqrt(needed) + MOSTLY) / np.maximum(seen, 1e-300)
        most = np.maximum(np.abs(item.low), np.abs(item.high))
        tried = Tried(
            item.label,
            score.evidence,
            search.evidence((score.index,)),
            np.where(least > most, np.inf, least),
            tuple(names),
            tuple(unit for unit, free in zip(units, size, strict=True) if free),
        )
        best.setdefault(item.label, tried)
    return tuple(best.values())


def equation_of(explanation: Explanation, evidence: float) -> Equation | None:
    """The unnamed laws of an explanation; None without any.

    Args:
        explanation: the final one.
        evidence: of the laws, relative to the best set of causes.
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
    """Causes that only make a sensor scatter more, by the residual of a continuous motion.

    Args:
        explanation: the final one.
        taken: such causes that are found already.
        unexplained: whether something else is unexplained.
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
    known = [item.label for item in (*effects_of(platform), *taken)]
    asked = [item for item in unit if not item.unfit(platform) and item.label not in known]
    result = [item for effect in asked if (item := _cause(explanation, effect, taken)) is not None]
    result.sort(key=lambda cause: -cause.evidence)
    if not result or np.exp(-0.5 * result[0].alone) > FALSE_ALARM / len(asked):
        return ()
    first, *others = result
    behind = {other.effect.label: first.evidence - other.evidence for other in others}
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
    """One such cause fitted to the squared residual; None where it has no evidence."""
    every = (*effects_of(explanation.bodies[0].machine.platform), *taken)
    others = [
        item for item in every if isinstance(item, ScatterEffect) and item.acts_on == effect.acts_on
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
            known = [added_variance(other, body.inputs, output.time) for other in others]
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
