"""Fits of a model with effects to logs: base, biases, initial states and effects together.

A fit linearises the effects, takes a step, and forms their columns again until the effects no
longer move. Before that it finds which numbers of each effect the logs determine; the others stay
at their starting values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, compress, pairwise

import numpy as np
from numpy.typing import NDArray

from twin.comparison.account import Account, misfits, misfits_of
from twin.diagnosis.candidates import Candidate, decades, looked_for, usual
from twin.diagnosis.laws import Law, laws_of, unlikely
from twin.diagnosis.screen import KNOWN, SLIGHT, LinearScreen, Trace
from twin.effects import Effect
from twin.identification.noise_processes import likely_noise
from twin.identification.prediction_error import Fit, fit, fit_disturbed
from twin.predict.added import Formed, formed, with_formed
from twin.predict.base import BaseParameters
from twin.predict.body import Body, Exact
from twin.predict.columns import amplitudes, references_of, slopes_of, strengths_of, with_strengths
from twin.predict.forces import Perturbation
from twin.predict.independent_segments import (
    IndependentSegments,
    fit_independent_segments,
    independent_segments,
)
from twin.predict.innovations import Innovations, Problem, Unknowns, retraced
from twin.predict.kalman import EXACT, NoiseProcess

Array = NDArray[np.float64]
BLURRED = 1e-2
"""A component is not fitted if base and other components reproduce more than all but this share of
its column."""
ROUNDS = 6
"""Times that the columns of effects are formed again, at most."""
WORSE, IN_ALL = 3.0, 1e-4
"""Cost, and share of what effects explain, by which a step with new columns may raise the cost."""
IDLE = 0.5
"""Change of the cost below which columns need not be formed again."""
LEAST = 0.1
"""Share of a step below which shortening ends."""
AGAIN = 2
"""Times that a fit starts again where it ended, if that is AWAY standard deviations from where
columns were formed: force and place of a push add up to a torque along their columns only."""
AWAY = 3.0
LARGE = 30.0
"""Standard deviations of an effect's amplitudes above which columns are always formed again."""
SETTLED = 0.1
"""Step of an effect, in standard deviations, below which they are not."""
SIZED, ALIKE = 4, 0.1
"""Iterations for the size of an effect that depends on the path it causes, and the relative change
at which they end."""
NEAR = 0.1
"""Change of the cost a sample up to which columns of other candidates are kept: the path moves by
a third of the noise at most."""
ASTRAY = 0.1
"""A fit diverges if it is less likely by more than this a sample than the one it starts from."""
CROWD = 3
"""Kinds of causes in one diagnosis, at most. A cause that the catalogue lacks is reproduced by
more: six explained an inclinometer's misalignment that was removed from it."""


@dataclass(frozen=True)
class WhitenedRows:
    """Whitened rows: residual + columns u has variance 1 for changes u of base, biases,
    strengths."""

    residual: Array
    """(m,)."""
    columns: Array
    """(m, u)."""
    cluster: NDArray[np.intp]
    """(m,) number of the segment, over all logs; -1 for a prior."""

    @property
    def covariance(self) -> Array:
        """(u, u) of all unknowns."""
        norm = np.linalg.norm(self.columns, axis=0)
        # what changes no row stays where it is, as every direction that the inverse leaves out
        size = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0.0)
        triangle = np.asarray(np.linalg.qr(self.columns * size, mode="r"))
        inverse = np.linalg.pinv(triangle, rcond=1e-12)
        return inverse @ inverse.T * np.outer(size, size)


@dataclass(frozen=True)
class StrengthLayout:
    """Order of strengths: rest angles of springs, undetermined components of each effect, fitted
    components of each effect, coefficients of laws."""

    rests: int
    hidden: tuple[int, ...]
    """Components of each effect."""
    free: tuple[int, ...]
    """Components of each effect."""
    laws: int

    @property
    def count(self) -> int:
        """Of all."""
        return self.rests + sum(self.hidden) + sum(self.free) + self.laws

    @property
    def of_hidden(self) -> list[slice]:
        """By effect."""
        return _slices(self.rests, self.hidden)

    @property
    def of_free(self) -> list[slice]:
        """By effect."""
        return _slices(self.rests + sum(self.hidden), self.free)

    @property
    def of_laws(self) -> slice:
        """All of them."""
        return slice(self.count - self.laws, self.count)

    @property
    def own(self) -> slice:
        """Fitted components and coefficients of laws."""
        return slice(self.rests + sum(self.hidden), self.count)


def _slices(first: int, counts: tuple[int, ...]) -> list[slice]:
    return [slice(*ends) for ends in pairwise(accumulate(counts, initial=first))]


def between(first: Sequence[Effect], last: Sequence[Effect], share: float) -> tuple[Effect, ...]:
    """Effects at a share of the way from the first to the last."""
    # a sum may end a rounding beyond a bound
    return tuple(
        end.with_values(np.clip(begin.values + share * (end.values - begin.values), *end.bounds()))
        for begin, end in zip(first, last, strict=True)
    )


def held(effect: Effect, parts: Sequence[Perturbation]) -> tuple[Perturbation, ...]:
    """Perturbations of an effect, with the usual width of each shape as its prior.

    Without it, a fit moves a weakly determined shape to where its columns are no longer valid, and
    the amplitude with it: a strong push near the bearing equals a weak one far from it.
    """
    if not parts:
        return ()
    return tuple(
        part if size else replace(part, spread=scale)
        for part, size, scale in zip(
            parts, amplitudes(effect), effect.scale().tolist(), strict=True
        )
    )


def largest(effect: Effect, free: NDArray[np.bool_]) -> float:
    """Largest determined amplitude of an effect, in units of its usual size; 0 without one."""
    size = amplitudes(effect)
    return float(np.abs(effect.values / usual(effect))[size].max()) if (size & free).any() else 0.0


def unseen(
    effects: Sequence[Effect], free: Sequence[NDArray[np.bool_]], most: Sequence[float]
) -> list[NDArray[np.bool_]]:
    """(p,) of each effect, amplitudes that the logs do not determine beside the others."""
    return [
        amplitudes(effect) & ~ones & (size > 0.0)
        for effect, ones, size in zip(effects, free, most, strict=True)
    ]


def whole(
    effects: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    columns: Array,
    strengths: Array,
    layout: StrengthLayout,
) -> Array:
    """Columns of fitted components, each vector's undetermined amplitudes added to its largest
    determined one.

    Args:
        effects: as fitted.
        free: (p,) of each, which components were fitted.
        columns: (m, a) of all strengths.
        strengths: (a,).
        layout: of both.
    """
    first = layout.own.start
    result = columns[:, first:].copy()
    places = zip(effects, free, layout.of_hidden, layout.of_free, strict=True)
    for effect, ones, beside, own in places:
        sizes = np.where(amplitudes(effect)[ones], np.abs(strengths[own]), 0.0)
        if beside.stop > beside.start and sizes.any():
            most = own.start + int(np.argmax(sizes))
            share = strengths[beside] / strengths[most]
            result[:, most - first] += columns[:, beside] @ share
    return result


def farthest(
    before: Sequence[Effect],
    after: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    covariances: Sequence[Array],
) -> float:
    """Largest step of an effect, in standard deviations."""
    return max(
        distance((now.values - then.values)[fitted], spread)
        for then, now, fitted, spread in zip(before, after, free, covariances, strict=True)
    )


def distance(step: Array, spread: Array) -> float:
    """Length of a step, in standard deviations."""
    return float(np.sqrt(max(step @ np.linalg.pinv(spread, hermitian=True) @ step, 0.0)))


def determined(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: tuple[Effect, ...],
    every: Sequence[Sequence[Perturbation]],
    start: Unknowns,
) -> tuple[NDArray[np.bool_], ...]:
    """Which components the logs determine beside base and the components before them.

    Amplitudes come first, those with the largest columns before others: of a thruster that is
    turned already, a turn about its own axis does what the other two do.

    Args:
        bodies: the logs.
        base: what is fitted of the machine.
        effects: at the values where their columns are formed.
        every: their perturbations, one a component.
        start: base, biases and states; its strengths are not used.

    Returns:
        (p,) of each effect.
    """
    free = [np.ones(len(parts), dtype=bool) for parts in every]
    doubtful = [i for i, parts in enumerate(every) if len(parts) > 1]
    if not doubtful:
        return tuple(free)
    problem = Problem(bodies, base, [part for parts in every for part in parts])
    strengths = np.concatenate([np.zeros(0), *(strengths_of(effect) for effect in effects)])
    innovations = problem.innovations(replace(start, strengths=strengths))
    whole = np.linalg.norm(innovations.columns, axis=0)
    columns = innovations.columns / np.maximum(whole, 1e-300)
    kept = columns.shape[1] - len(strengths)
    reach = [high - low for low, high in (effect.bounds() for effect in effects)]
    felt = whole[kept:] > SLIGHT / np.concatenate([np.zeros(0), *reach])
    basis = np.linalg.qr(columns[:, :kept])[0]
    first = kept
    for i, effect in enumerate(effects):
        least = KNOWN if effect.exact else BLURRED
        amplitude, does = amplitudes(effect), whole[first : first + len(every[i])]
        order = np.lexsort((np.where(amplitude, -does, 0.0), ~amplitude))
        for j in order.tolist():
            column = columns[:, first + j]
            for _ in range(2):
                column = column - basis @ (basis.T @ column)
            size = float(np.linalg.norm(column))
            if size < least or not felt[first - kept + j]:
                free[i][j] = False
            else:
                basis = np.column_stack([basis, column / size])
        first += len(every[i])
    return tuple(free)


@dataclass(frozen=True)
class Explanation:
    """A fitted model."""

    bodies: tuple[Body, ...]
    base: BaseParameters
    effects: tuple[Effect, ...]
    """As fitted."""
    free: tuple[NDArray[np.bool_], ...]
    """(p,) of each effect, which components were fitted."""
    laws: tuple[Law, ...]
    """Unnamed, fitted together with the effects."""
    problem: Problem
    prediction: Innovations | IndependentSegments
    """Of one continuous motion, or of independent segments, where no continuous one fits."""
    converged: bool
    most: tuple[float, ...]
    """Of each effect, 1 sigma about 0 of its undetermined amplitudes."""

    @property
    def at(self) -> Unknowns:
        """Base, biases, states and strengths as fitted."""
        return self.prediction.at

    @property
    def follows(self) -> bool:
        """Whether the prediction is one continuous motion."""
        return isinstance(self.prediction, Innovations)

    @cached_property
    def account(self) -> Account:
        """Residual of each stream, and its correlation."""
        bare = Account(self.problem, (), self.prediction, (), follows=self.follows)
        if isinstance(self.prediction, Innovations):
            return replace(bare, misfits=misfits(self.problem, self.prediction))
        fitted = self.prediction.columns.shape[1]
        return replace(bare, misfits=misfits_of(self.problem, bare.left, fitted))

    @cached_property
    def rows(self) -> WhitenedRows:
        """Whitened."""
        return self._rows(self.prediction)

    @cached_property
    def covariance(self) -> Array:
        """(u, u) of base, biases and strengths."""
        return self.rows.covariance

    def _rows(self, innovations: Innovations | IndependentSegments) -> WhitenedRows:
        if isinstance(innovations, Innovations):
            return WhitenedRows(innovations.residual, innovations.columns, innovations.cluster)
        # a segment weighs by its own scatter, and less where its residual is correlated
        weights = innovations.weights / self.account.inflation
        root = np.sqrt(np.where(innovations.cluster >= 0, weights[innovations.cluster], 1.0))
        return WhitenedRows(
            innovations.residual * root, innovations.columns * root[:, None], innovations.cluster
        )

    @property
    def layout(self) -> StrengthLayout:
        """Order of its strengths."""
        hidden = _counts(unseen(self.effects, self.free, self.most))
        free, laws = _counts(self.free), len(self.laws)
        taken = sum(hidden) + sum(free) + laws
        return StrengthLayout(len(self.at.strengths) - taken, hidden, free, laws)

    @property
    def covariances(self) -> tuple[Array, ...]:
        """(p, p) of the free components of each effect."""
        layout = self.layout
        strengths = self.covariance[-layout.count :, -layout.count :]
        return tuple(strengths[own, own] for own in layout.of_free)

    def instead(
        self, effects: Sequence[Effect], laws: Sequence[Law] = (), *, stated: bool = False
    ) -> "Explanation":
        """Fit other effects and laws, starting here, or here with the base as stated."""
        # a white torque only serves to start a fit
        noise = EXACT if self.noise.white > 0.0 else self.noise
        start = self._stated if stated else self.at
        explanation = explain(
            self.following, self.base, effects, start, laws, follows=self.follows, noise=noise
        )
        if noise.any:
            explanation = explanation.wandering()
        follow = isinstance(self.prediction, Innovations) and isinstance(
            explanation.prediction, Innovations
        )
        if follow and abs(self.cost - explanation.cost) < NEAR * self.samples:
            explanation._formed.update(self._formed)
        return explanation

    def as_stated(self, effects: Sequence[Effect], laws: Sequence[Law] = ()) -> Innovations:
        """The prediction from which a fit with the base as stated starts."""
        posed = _posed(self.following, self.base, effects, laws, self._stated)
        return posed.problem.innovations(posed.start)

    @property
    def _stated(self) -> Unknowns:
        return replace(self.at, theta=self.base.as_stated)

    @property
    def noise(self) -> NoiseProcess:
        """Noise processes, beside the stated white noise of sensors."""
        return self.prediction.noise if isinstance(self.prediction, Innovations) else EXACT

    def wandering(self) -> "Explanation":
        """The same model with the likeliest noise processes, base and effects refitted."""
        assert isinstance(self.prediction, Innovations)
        noise = likely_noise(self.problem, self.prediction, self.noise)
        if noise == self.noise:
            return self
        explanation = self._refitted(fit(self.problem, self.at, noise))
        explanation._formed.update(self._formed)  # along nearly the same path
        return explanation

    def disturbed(self) -> "Explanation":
        """The same model under a white torque of the likeliest intensity, which lets the motion
        follow the logs."""
        assert isinstance(self.prediction, Innovations)
        return self._refitted(
            fit_disturbed(self.problem, Fit(self.prediction, converged=False), self.at)
        )

    def _refitted(self, there: Fit) -> "Explanation":
        """The result of a fit of the same columns under other noise."""
        layout, hidden = self.layout, unseen(self.effects, self.free, self.most)
        change = there.at.strengths - self.at.strengths
        moved: list[Effect] = []
        places = zip(layout.of_hidden, layout.of_free, strict=True)
        for effect, away, free, (beside, own) in zip(
            self.effects, hidden, self.free, places, strict=True
        ):
            values = effect.values.copy()
            values[away] += change[beside]
            values[free] += change[own]
            moved.append(effect.with_values(np.clip(values, *effect.bounds())))
        now = there.innovations
        return replace(self, effects=tuple(moved), prediction=now, converged=there.converged)

    @cached_property
    def following(self) -> tuple[Body, ...]:
        """The logs linearised along the fitted motion, where it is continuous."""
        if not isinstance(self.prediction, Innovations):
            return self.bodies
        now = self.prediction
        return tuple(retraced(self.problem, now, log) for log in range(len(self.bodies)))

    @property
    def cost(self) -> float:
        """-2 log L up to a constant."""
        return self.deflated(self.account.inflation)

    def deflated(self, inflation: float) -> float:
        """-2 log L of samples divided by an inflation, plus that of the priors.

        Args:
            inflation: by which the correlation of the residual reduces the information of samples.
        """
        known = float(np.sum(np.square(self.prediction.residual[self.prediction.cluster < 0])))
        return (self._reached - known) / inflation + known

    @property
    def _reached(self) -> float:
        """-2 log L; of a fit that has not converged, without the gain that its next step
        predicts."""
        if self.converged or not isinstance(self.prediction, Innovations):
            return self.prediction.cost
        return self.prediction.chi2 + self.prediction.logarithm

    @property
    def samples(self) -> int:
        """Number of measured values."""
        return sum(body.samples for body in self.bodies)

    def screen(self, candidates: Sequence[Candidate]) -> LinearScreen:
        """Linear screen of its own effects and laws, then of candidates."""
        parts = [self.sized(candidate) for candidate in candidates]
        return self.weigh(parts, [candidate.trace for candidate in candidates])

    def sized(self, candidate: Candidate) -> tuple[Perturbation, ...]:
        """Perturbations of a candidate; of an effect that depends on the path it causes, at the
        size of its linear estimate."""
        parts, before = candidate.perturbations, np.zeros(len(candidate.perturbations))
        if not any(part.laws for part in parts):
            return parts
        for _ in range(SIZED):
            rows = self.rows_with(parts)
            result = np.linalg.lstsq(rows.columns, -rows.residual, rcond=None)[0][-len(parts) :]
            size = np.clip(result, candidate.low, candidate.high)
            if np.all(np.abs(size - before) <= ALIKE * np.abs(size)):
                break
            parts = tuple(replace(p, size=s) for p, s in zip(parts, size.tolist(), strict=True))
            before = size
        return parts

    def weigh(
        self, more: Sequence[Sequence[Perturbation]], traces: Sequence[Trace]
    ) -> LinearScreen:
        """Linear screen of its own effects and laws, then of others by their perturbations."""
        bare, columns = self.without([part for parts in more for part in parts])
        return LinearScreen(bare.residual, bare.columns, columns, [*self.traces, *traces])

    def without(self, more: Sequence[Perturbation] = ()) -> tuple[WhitenedRows, Array]:
        """The same model without its effects and laws, linearised at this fit.

        Returns:
            Whitened rows of base and biases; columns (m, a) of its effects and laws, then of more.
        """
        layout = self.layout
        strengths = self.at.strengths[layout.rests :]
        taken = len(strengths)
        rests = self._rests(taken)
        now = self._rows_of(self._bare, [*more, *rests.values()])
        first = now.columns.shape[1] - len(rests) - len(more) - taken
        edge, end = first + taken, first + taken + len(more)
        own = now.columns[:, first:edge].copy()
        # without an effect, its part that is not proportional to it is absent too
        for place, rest in zip(rests, now.columns[:, end:].T, strict=True):
            own[:, place] += rest / strengths[place]
        columns = np.column_stack([own, now.columns[:, edge:end]])
        rows = WhitenedRows(now.residual - own @ strengths, now.columns[:, :first], now.cluster)
        placed = replace(layout, rests=0)
        return rows, whole(self.effects, self.free, columns, strengths, placed)

    def _rests(self, count: int) -> dict[int, Perturbation]:
        """Of the last perturbations, forces that do not depend on the strength, by place."""
        own = self.problem.perturbations[len(self.problem.perturbations) - count :]
        return {
            place: Perturbation(f"{part.name} besides", part.unit, force=part.rest)
            for place, part in enumerate(own)
            if part.rest is not None
        }

    @property
    def traces(self) -> list[Trace]:
        """Traces of its effects and laws."""
        mine = [self._trace(i) for i in range(len(self.effects))]
        price = unlikely(laws_of(self.bodies)) if self.laws else 0.0
        return mine + [law.trace(price) for law in self.laws]

    def rows_with(self, perturbations: Sequence[Perturbation]) -> WhitenedRows:
        """Whitened rows with further columns."""
        return self._rows_of(self.prediction.exact, perturbations)

    def _rows_of(
        self, exact: Sequence[Exact], perturbations: Sequence[Perturbation]
    ) -> WhitenedRows:
        new = [perturbation for perturbation in perturbations if perturbation not in self._formed]
        self._formed.update(
            zip(new, formed(self.following, self.prediction.exact, new), strict=True)
        )
        exact = with_formed(exact, [self._formed[perturbation] for perturbation in perturbations])
        if isinstance(self.prediction, Innovations):
            return self._rows(self.problem.whiten(self.at, exact, self.prediction.noise))
        return self._rows(independent_segments(self.problem, self.at, exact))

    @cached_property
    def _bare(self) -> tuple[Exact, ...]:
        """Linearised at this fit, with the base's columns of a model without effects and laws.

        Where only an effect moves a body, a heavier body under a larger effect moves the same: the
        size of the effect is undetermined, its presence is not.
        """
        if not self.own:
            return self.prediction.exact
        return tuple(
            body.without(self.base, item, self.problem.push(log, self.at, stated=False))
            for log, (body, item) in enumerate(zip(self.bodies, self.prediction.exact, strict=True))
        )

    @cached_property
    def _formed(self) -> dict[Perturbation, Formed]:
        """Cache of columns formed at this fit."""
        return {}

    @property
    def significance(self) -> float:
        """Distance of all amplitudes together from 0, in standard deviations: of causes that look
        alike, each may be insignificant beside the others."""
        if not self.effects:
            return 0.0
        layout = self.layout
        own = slice(layout.own.start, layout.of_laws.start)
        size = np.concatenate(
            [amplitudes(effect)[ones] for effect, ones in zip(self.effects, self.free, strict=True)]
        )
        spread = self.covariance[-layout.count :, -layout.count :][own, own]
        return distance(self.at.strengths[own][size], spread[np.ix_(size, size)])

    @property
    def amplitudes(self) -> Array:
        """(a,) strengths of fitted components and laws."""
        return self.at.strengths[self.layout.own]

    @property
    def own(self) -> tuple[int, ...]:
        """Places of its effects and laws in its screen."""
        return tuple(range(len(self.effects) + len(self.laws)))

    def _trace(self, index: int) -> Trace:
        effect, free = self.effects[index], self.free[index]
        strengths = np.zeros(len(free))
        strengths[free] = self.at.strengths[self.layout.of_free[index]]
        # the strength of a shape is its change from where the columns were formed
        origin = np.where(amplitudes(effect), 0.0, effect.values - strengths)
        low, high = effect.bounds()
        return Trace(
            effect.label,
            (low - origin)[free],
            (high - origin)[free],
            looked=looked_for(effect, self.bodies),
            exact=effect.exact,
            fitted=True,
            usual=np.where(amplitudes(effect), usual(effect), np.inf)[free],
            decades=decades(effect),
        )


def explain(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: Sequence[Effect],
    start: Unknowns,
    laws: Sequence[Law] = (),
    *,
    follows: bool = True,
    noise: NoiseProcess = EXACT,
) -> Explanation:
    """Fit a model with these effects.

    Args:
        bodies: the logs.
        base: parameters of the machine that are fitted.
        effects: at their starting values.
        start: base, biases and states; its strengths are not used.
        laws: unnamed, fitted as well.
        follows: whether the motion is continuous; else segments are independent.
        noise: noise processes of a continuous motion and of its sensors.

    Raises:
        TwinError: no rigid body has the base that the iteration starts from.
    """
    effects = tuple(effect.least(bodies[0].machine.platform) for effect in effects)
    now, away = _explained(tuple(bodies), base, effects, start, laws, follows, noise)
    shaped = any(not amplitudes(effect).all() for effect in effects)
    for _ in range(AGAIN if shaped and follows else 0):
        if away < AWAY:
            break
        # which components are fitted is decided again
        there, far = _explained(now.following, base, now.effects, now.at, now.laws, True, noise)
        if far > away and not there.cost < now.cost:
            break
        now, away = there, far
    return now


def _explained(
    bodies: tuple[Body, ...],
    base: BaseParameters,
    effects: tuple[Effect, ...],
    start: Unknowns,
    laws: Sequence[Law],
    follows: bool,
    noise: NoiseProcess,
) -> tuple[Explanation, float]:
    """A fit, and the distance of its effects from where their columns were formed."""
    now = _fitted(bodies, base, effects, tuple(laws), start, follows, noise)
    formed_at, share = effects, 1.0
    sigmas = now.significance
    for rounds in range(ROUNDS if effects else 0):
        # a large effect changes the motion along which its columns were formed
        as_foretold = not follows or rounds > 0 or sigmas < LARGE
        if (as_foretold and _far(formed_at, now) < SETTLED) or share < LEAST:
            break
        there = between(formed_at, now.effects, share)
        tried = _fitted(now.following, base, there, now.laws, now.at, follows, noise, before=now)
        settled = _far(there, tried) < SETTLED
        if follows and not settled and tried.cost > now.cost + WORSE + IN_ALL * sigmas**2:
            # along the path of another model a fit may seem likelier than any is along its own
            ends, more = tried.effects, tried.following
            again = _fitted(more, base, ends, tried.laws, tried.at, follows, noise, before=tried)
            if abs(again.cost - tried.cost) < IDLE and not astray(now, again):
                now, formed_at = again, ends
                break
            share *= 0.5
            continue
        fallen = abs(now.cost - tried.cost)
        now, formed_at, share = tried, there, 1.0
        if follows and fallen < IDLE:
            break
    return now, _far(formed_at, now) if effects else 0.0


def _far(formed_at: Sequence[Effect], explanation: Explanation) -> float:
    """Distance of effects from where their columns were formed, in standard deviations."""
    return farthest(formed_at, explanation.effects, explanation.free, explanation.covariances)


def _fitted(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: tuple[Effect, ...],
    laws: tuple[Law, ...],
    start: Unknowns,
    follows: bool,
    noise: NoiseProcess,
    *,
    before: Explanation | None = None,
) -> Explanation:
    """A fit with columns of effects at their current values; `before` is the fit that led there."""
    posed = _posed(bodies, base, effects, laws, start, before)
    if follows:
        result = fit(posed.problem, posed.start, noise)
        now, converged = result.innovations, result.converged
    else:
        now, converged = fit_independent_segments(posed.problem, posed.start), True
    sizes = [strengths_of(effect) for effect in effects]
    masks = [*unseen(effects, posed.free, posed.most), *posed.free]
    parts = [*posed.layout.of_hidden, *posed.layout.of_free]
    for size, places, part in zip([*sizes, *sizes], masks, parts, strict=True):
        size[places] = now.at.strengths[part]
    moved = tuple(map(with_strengths, effects, sizes))
    return Explanation(
        tuple(bodies), base, moved, posed.free, laws, posed.problem, now, converged, posed.most
    )


@dataclass(frozen=True)
class _Posed:
    """A problem with columns of effects at their current values, and where its fit begins."""

    problem: Problem
    start: Unknowns
    layout: StrengthLayout
    free: tuple[NDArray[np.bool_], ...]
    """(p,) of each effect, which components are fitted."""
    most: tuple[float, ...]
    """Of each effect, 1 sigma about 0 of its undetermined amplitudes."""


def _posed(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: Sequence[Effect],
    laws: Sequence[Law],
    start: Unknowns,
    before: Explanation | None = None,
) -> _Posed:
    """The problem of a fit; `before` is the fit that led there."""
    platform = bodies[0].machine.platform
    every = [slopes_of(effect, platform) for effect in effects]
    free = before.free if before else determined(bodies, base, tuple(effects), every, start)
    every = [held(effect, parts) for effect, parts in zip(effects, every, strict=True)]
    # undetermined amplitudes have a prior of the size of the largest determined one
    most = before.most if before else tuple(map(largest, effects, free))
    hidden = unseen(effects, free, most)
    rests = [part for effect in effects for part in references_of(effect, bodies)]
    blurred = [
        replace(part, spread=size * item)
        for effect, parts, away, size in zip(effects, every, hidden, most, strict=True)
        for part, item in compress(zip(parts, usual(effect).tolist(), strict=False), away)
    ]
    own = [part for parts, ones in zip(every, free, strict=True) for part in compress(parts, ones)]
    problem = Problem(bodies, base, [*rests, *blurred, *own, *(law.perturbation for law in laws)])
    sizes = [strengths_of(effect) for effect in effects]
    first = [size[places] for size, places in zip([*sizes, *sizes], [*hidden, *free], strict=True)]
    # where columns are only formed again, other strengths are kept
    stays = before.at.strengths if before else np.zeros(len(problem.perturbations))
    layout = StrengthLayout(len(rests), _counts(hidden), _counts(free), len(laws))
    strengths = np.concatenate([stays[: layout.rests], *first, stays[layout.of_laws]])
    return _Posed(problem, replace(start, strengths=strengths), layout, free, most)


def _counts(masks: Sequence[NDArray[np.bool_]]) -> tuple[int, ...]:
    return tuple(int(mask.sum()) for mask in masks)


def astray(explanation: Explanation, tried: Explanation) -> bool:
    """Whether a fit diverges from the logs, compared with the one it starts from."""
    return explanation.follows and not tried.cost < explanation.cost + ASTRAY * explanation.samples
