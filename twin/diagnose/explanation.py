"""A model with some effects in it, fitted to the logs: base, biases, initial states and effects.

A fit linearises what effects do where they are, moves them and forms their columns anew, until
they stay. Which of an effect's numbers a log determines is found first; the others are held.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, compress, pairwise

import numpy as np
from numpy.typing import NDArray

from twin.compare.account import Account, misfits, misfits_of
from twin.diagnose.candidates import Candidate, looked_for
from twin.diagnose.laws import Law, laws_of, unlikely
from twin.diagnose.screen import KNOWN, SLIGHT, LinearScreen, Trace
from twin.effects import Effect
from twin.errors import TwinError
from twin.identify.noise_processes import likely_noise
from twin.identify.prediction_error import Fit, fit, fit_disturbed
from twin.platform import Platform
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
from twin.predict.kalman import EXACT, Noise

Array = NDArray[np.float64]
BLURRED = 1e-2
"""A component of which less than this share is left beside base and the others stays as it is."""
ROUNDS = 6
"""Times that the effects' columns are formed anew where the last fit found them."""
WORSE, IN_ALL = 3.0, 1e-4
"""Cost, and share of what effects explain, by which that may do worse than foretold."""
IDLE = 0.5
"""Change of the cost that says that the columns were right."""
LEAST = 0.1
"""Share of such a move below which no more is tried."""
AGAIN = 2
"""Times that a fit begins anew where it ended, AWAY standard deviations from where columns were
formed: a push's force and place may add up to its torque along their columns, and not in truth."""
AWAY = 3.0
LARGE = 30.0
"""Standard deviations of an effect's amplitudes, beyond which columns are formed anew anyway."""
SETTLED = 0.1
"""Move of an effect, in standard deviations, at which they need not be."""
SIZED, ALIKE = 4, 0.1
"""Times that the size is sought of what answers to the path that it makes, and the share of it by
which that may still change."""
NEAR = 0.1
"""Where a fit is likelier by no more than this a sample, its path is a third of the noise away at
most, and what else was asked does there what it did before."""
TURNED = 0.5
"""Turn [rad] from which on its linear column is no guess of where it leads."""
ASTRAY = 0.1
"""A fit that is less likely by more than this a sample than the one it began from has lost it."""
ELSEWHERE = 1.0
"""-2 log L by which a fit from another start must be likelier to be more than the same minimum."""
CROWD = 3
"""Kinds of causes that an answer may have. What the catalogue lacks looks like more of them, each
small beside it: six explained an inclinometer's misalignment that had been left out."""


@dataclass(frozen=True)
class Rows:
    """residual + columns u is white, variance 1, for changes u of base, biases and strengths."""

    residual: Array
    """(m,)."""
    columns: Array
    """(m, u)."""
    cluster: NDArray[np.intp]
    """(m,) which segment of which log each comes from; -1: what was known beforehand."""

    @property
    def covariance(self) -> Array:
        """(u, u) of all that has a column."""
        size = 1.0 / np.maximum(np.linalg.norm(self.columns, axis=0), 1e-300)
        triangle = np.asarray(np.linalg.qr(self.columns * size, mode="r"))
        inverse = np.linalg.pinv(triangle, rcond=1e-12)
        return inverse @ inverse.T * np.outer(size, size)


@dataclass(frozen=True)
class Layout:
    """First where springs rest, then what no log shows of each effect, then the components of each
    that were fitted, then the coefficients of laws."""

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
        """By what the model differs from one without effects and laws: free components, laws."""
        return slice(self.rests + sum(self.hidden), self.count)


def _slices(first: int, counts: tuple[int, ...]) -> list[slice]:
    return [slice(*ends) for ends in pairwise(accumulate(counts, initial=first))]


def between(first: Sequence[Effect], last: Sequence[Effect], share: float) -> tuple[Effect, ...]:
    """So much of the way from one to the other."""
    # a sum may end a rounding beyond a bound
    return tuple(
        end.with_values(np.clip(begin.values + share * (end.values - begin.values), *end.bounds()))
        for begin, end in zip(first, last, strict=True)
    )


def held(effect: Effect, parts: Sequence[Perturbation]) -> tuple[Perturbation, ...]:
    """Its perturbations, those of its shape moved by a fit no further than what shapes are like.

    What a log hardly tells, a fit would follow to where the columns mean nothing any more, and an
    amplitude with it: a draft that pushes hard near the bearing is one that pushes far from it.
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
    """Of its amplitudes, in units of what each is usually like, if a log shows any."""
    size = amplitudes(effect)
    return float(np.abs(effect.values / usual(effect))[size].max()) if (size & free).any() else 0.0


def usual(effect: Effect) -> Array:
    """(p,) what each component is usually like; the same for all of a vector."""
    scale = effect.scale()
    ends = np.cumsum([0, *(known.size for known in effect.parameters())])
    return np.concatenate(
        [np.full(j - i, scale[i:j].max()) for i, j in zip(ends, ends[1:], strict=False)]
    )


def unseen(
    effects: Sequence[Effect], free: Sequence[NDArray[np.bool_]], most: Sequence[float]
) -> list[NDArray[np.bool_]]:
    """(p,) of each effect, amplitudes that no log shows beside the others."""
    return [
        amplitudes(effect) & ~ones & (size > 0.0)
        for effect, ones, size in zip(effects, free, most, strict=True)
    ]


def whole(
    effects: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    columns: Array,
    strengths: Array,
    layout: Layout,
) -> Array:
    """Columns without the first, of amplitudes of each effect that no log shows: they come and go
    with the largest that one does. `layout` is that of the columns and their strengths."""
    first = layout.own.start
    found = columns[:, first:].copy()
    places = zip(effects, free, layout.of_hidden, layout.of_free, strict=True)
    for effect, ones, beside, own in places:
        sizes = np.where(amplitudes(effect)[ones], np.abs(strengths[own]), 0.0)
        if beside.stop > beside.start and sizes.any():
            most = own.start + int(np.argmax(sizes))
            share = strengths[beside] / strengths[most]
            found[:, most - first] += columns[:, beside] @ share
    return found


def in_sigmas(
    effects: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    covariances: Sequence[Array],
) -> float:
    """How far the largest effect's amplitudes are from none, given the covariances of what was
    fitted of each effect; 0 without any."""
    sizes = [0.0]
    for effect, fitted, spread in zip(effects, free, covariances, strict=True):
        own = amplitudes(effect)[fitted]
        if own.any():
            sizes.append(distance(effect.values[fitted][own], spread[np.ix_(own, own)]))
    return max(sizes)


def farthest(
    before: Sequence[Effect],
    after: Sequence[Effect],
    free: Sequence[NDArray[np.bool_]],
    covariances: Sequence[Array],
) -> float:
    """How far effects have moved at most, likewise."""
    return max(
        distance((now.values - then.values)[fitted], spread)
        for then, now, fitted, spread in zip(before, after, free, covariances, strict=True)
    )


def distance(step: Array, spread: Array) -> float:
    """Of a step, in standard deviations."""
    return float(np.sqrt(max(step @ np.linalg.pinv(spread, hermitian=True) @ step, 0.0)))


def determined(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: tuple[Effect, ...],
    every: Sequence[Sequence[Perturbation]],
    start: Unknowns,
) -> tuple[NDArray[np.bool_], ...]:
    """Which components logs show beside base and the components before them, amplitudes first.

    Of amplitudes those come first that do most: where a thruster is turned already, a turn about
    its own axis does a little, and all of it the others do too.

    Args:
        bodies: the logs.
        base: what is fitted of the machine.
        effects: at the values where their columns are formed.
        every: their perturbations, one a component.
        start: where the base, the biases and the states stand; its strengths are not used.

    Returns:
        (p,) of each effect.
    """
    free = [np.ones(len(parts), dtype=bool) for parts in every]
    doubtful = [i for i, parts in enumerate(every) if len(parts) > 1]
    if not doubtful:
        return tuple(free)
    problem = Problem(bodies, base, [part for parts in every for part in parts])
    strengths = np.concatenate([np.zeros(0), *(strengths_of(effect) for effect in effects)])
    now = problem.innovations(replace(start, strengths=strengths))
    whole = np.linalg.norm(now.columns, axis=0)
    columns = now.columns / np.maximum(whole, 1e-300)
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
    """Effects as the logs would have them."""

    bodies: tuple[Body, ...]
    base: BaseParameters
    effects: tuple[Effect, ...]
    """As fitted."""
    free: tuple[NDArray[np.bool_], ...]
    """Of each effect, which components were fitted."""
    laws: tuple[Law, ...]
    """Without a name, fitted beside the effects."""
    problem: Problem
    prediction: Innovations | IndependentSegments
    """Where it was fitted: a motion that follows the model, or segments apart where none does."""
    converged: bool
    most: tuple[float, ...]
    """Of each effect, how large its amplitudes may be that no log shows: 1 sigma about 0."""

    @property
    def at(self) -> Unknowns:
        """Where base, biases, states and strengths stand."""
        return self.prediction.at

    @property
    def follows(self) -> bool:
        """Whether the motion follows the model."""
        return isinstance(self.prediction, Innovations)

    @cached_property
    def account(self) -> Account:
        """The same as a comparison has it: what each stream leaves, and how that is correlated."""
        bare = Account(self.problem, (), self.prediction, (), follows=self.follows)
        if isinstance(self.prediction, Innovations):
            return replace(bare, misfits=misfits(self.problem, self.prediction))
        fitted = self.prediction.columns.shape[1]
        return replace(bare, misfits=misfits_of(self.problem, bare.left, fitted))

    @cached_property
    def rows(self) -> Rows:
        """Whitened."""
        return self._rows(self.prediction)

    @cached_property
    def covariance(self) -> Array:
        """Of base, biases and strengths."""
        return self.rows.covariance

    def _rows(self, now: Innovations | IndependentSegments) -> Rows:
        if isinstance(now, Innovations):
            return Rows(now.residual, now.columns, now.cluster)
        # a segment counts as much as its own scatter lets it, and a coloured one for less
        weights = now.weights / self.account.inflation
        root = np.sqrt(np.where(now.cluster >= 0, weights[now.cluster], 1.0))
        return Rows(now.residual * root, now.columns * root[:, None], now.cluster)

    @property
    def layout(self) -> Layout:
        """Of its strengths."""
        hidden = _counts(unseen(self.effects, self.free, self.most))
        free, laws = _counts(self.free), len(self.laws)
        taken = sum(hidden) + sum(free) + laws
        return Layout(len(self.at.strengths) - taken, hidden, free, laws)

    @property
    def covariances(self) -> tuple[Array, ...]:
        """(p, p) of the free components of each effect."""
        layout = self.layout
        strengths = self.covariance[-layout.count :, -layout.count :]
        return tuple(strengths[own, own] for own in layout.of_free)

    def instead(self, effects: Sequence[Effect], laws: Sequence[Law] = ()) -> "Explanation":
        """Other effects and laws, fitted from where this one stands."""
        # a white torque has only led the motion to the logs
        noise = EXACT if self.noise.white > 0.0 else self.noise
        found = explain(
            self.following, self.base, effects, self.at, laws, follows=self.follows, noise=noise
        )
        if noise.any:
            found = found.wandering()
        follow = isinstance(self.prediction, Innovations) and isinstance(
            found.prediction, Innovations
        )
        if follow and abs(self.cost - found.cost) < NEAR * self.samples:
            found._formed.update(self._formed)
        return found

    @property
    def noise(self) -> Noise:
        """What disturbs the motion and the sensors, beside their white noise."""
        return self.prediction.noise if isinstance(self.prediction, Innovations) else EXACT

    def wandering(self) -> "Explanation":
        """The same with the noise processes that the logs ask for, base and effects fitted anew."""
        assert isinstance(self.prediction, Innovations)
        noise = likely_noise(self.problem, self.prediction, self.noise)
        if noise == self.noise:
            return self
        found = self._refitted(fit(self.problem, self.at, noise))
        found._formed.update(self._formed)  # along nearly the same path
        return found

    def disturbed(self) -> "Explanation":
        """The same under a white torque, as large as the logs ask for, that draws the motion to
        them."""
        assert isinstance(self.prediction, Innovations)
        return self._refitted(
            fit_disturbed(self.problem, Fit(self.prediction, converged=False), self.at)
        )

    def _refitted(self, there: Fit) -> "Explanation":
        """Where a fit of the same columns under other noise ends, the effects in its sizes."""
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
        """The logs, along the motion that it gives them, if that follows them."""
        if not isinstance(self.prediction, Innovations):
            return self.bodies
        now = self.prediction
        return tuple(retraced(self.problem, now, log) for log in range(len(self.bodies)))

    @property
    def cost(self) -> float:
        """-2 log L up to a constant."""
        return self.deflated(self.account.inflation)

    def deflated(self, inflation: float) -> float:
        """-2 log L where samples say so many times less than white noise does; of what is known
        beforehand, nothing is inflated."""
        known = float(np.sum(np.square(self.prediction.residual[self.prediction.cluster < 0])))
        return (self._reached - known) / inflation + known

    @property
    def _reached(self) -> float:
        """-2 log L of where it stands: of a fit that has not settled the next step may foretell
        what no step reaches."""
        if self.converged or not isinstance(self.prediction, Innovations):
            return self.prediction.cost
        return self.prediction.chi2 + self.prediction.logarithm

    @property
    def samples(self) -> int:
        """Measured numbers."""
        return sum(body.samples for body in self.bodies)

    def screen(self, candidates: Sequence[Candidate]) -> LinearScreen:
        """Its own effects and laws, then candidates, weighed where it stands."""
        parts = [self.sized(one) for one in candidates]
        return self.weigh(parts, [one.trace for one in candidates])

    def sized(self, one: Candidate) -> tuple[Perturbation, ...]:
        """What answers to the path that it makes, in the size that the logs ask for."""
        parts, before = one.perturbations, np.zeros(len(one.perturbations))
        if not any(part.laws for part in parts):
            return parts
        for _ in range(SIZED):
            rows = self.rows_with(parts)
            found = np.linalg.lstsq(rows.columns, -rows.residual, rcond=None)[0][-len(parts) :]
            size = np.clip(found, one.low, one.high)
            if np.all(np.abs(size - before) <= ALIKE * np.abs(size)):
                break
            parts = tuple(replace(p, size=s) for p, s in zip(parts, size.tolist(), strict=True))
            before = size
        return parts

    def weigh(
        self, more: Sequence[Sequence[Perturbation]], traces: Sequence[Trace]
    ) -> LinearScreen:
        """Its own effects and laws, then others by their perturbations."""
        bare, columns = self.without([part for parts in more for part in parts])
        return LinearScreen(bare.residual, bare.columns, columns, [*self.traces, *traces])

    def without(self, more: Sequence[Perturbation] = ()) -> tuple[Rows, Array]:
        """The model that lacks its effects and laws, and what those add.

        Returns:
            Rows of base and biases, whitened, where it stands; and columns (m, a) of its effects
            and laws, then of more.
        """
        layout = self.layout
        strengths = self.at.strengths[layout.rests :]
        taken = len(strengths)
        rests = self._rests(taken)
        now = self._rows_of(self._bare, [*more, *rests.values()])
        first = now.columns.shape[1] - len(rests) - len(more) - taken
        edge, end = first + taken, first + taken + len(more)
        own = now.columns[:, first:edge].copy()
        # without the effect its rest is not there either
        for place, rest in zip(rests, now.columns[:, end:].T, strict=True):
            own[:, place] += rest / strengths[place]
        columns = np.column_stack([own, now.columns[:, edge:end]])
        left = Rows(now.residual - own @ strengths, now.columns[:, :first], now.cluster)
        placed = replace(layout, rests=0)
        return left, whole(self.effects, self.free, columns, strengths, placed)

    def _rests(self, count: int) -> dict[int, Perturbation]:
        """What the last so many perturbations push whatever their strengths, by place."""
        own = self.problem.perturbations[len(self.problem.perturbations) - count :]
        return {
            place: Perturbation(f"{part.name} besides", part.unit, force=part.rest)
            for place, part in enumerate(own)
            if part.rest is not None
        }

    @property
    def traces(self) -> list[Trace]:
        """Of its effects and laws."""
        mine = [self._trace(i) for i in range(len(self.effects))]
        price = unlikely(laws_of(self.bodies)) if self.laws else 0.0
        return mine + [law.trace(price) for law in self.laws]

    def rows_with(self, perturbations: Sequence[Perturbation]) -> Rows:
        """Whitened where it stands, with further columns."""
        return self._rows_of(self.prediction.exact, perturbations)

    def _rows_of(self, exact: Sequence[Exact], perturbations: Sequence[Perturbation]) -> Rows:
        new = [one for one in perturbations if one not in self._formed]
        self._formed.update(
            zip(new, formed(self.following, self.prediction.exact, new), strict=True)
        )
        exact = with_formed(exact, [self._formed[one] for one in perturbations])
        if isinstance(self.prediction, Innovations):
            return self._rows(self.problem.whiten(self.at, exact, self.prediction.noise))
        return self._rows(independent_segments(self.problem, self.at, exact))

    @cached_property
    def _bare(self) -> tuple[Exact, ...]:
        """Where it stands, the base's columns as they are without its effects and laws.

        Where nothing but an effect turns a body, a heavier body under more of it moves the same:
        its size is open, which is no reason to doubt that it is there.
        """
        if not self.own:
            return self.prediction.exact
        return tuple(
            body.without(self.base, one, self.problem.push(log, self.at, stated=False))
            for log, (body, one) in enumerate(zip(self.bodies, self.prediction.exact, strict=True))
        )

    @cached_property
    def _formed(self) -> dict[Perturbation, Formed]:
        """Columns of all that was asked here; most of it is asked again."""
        return {}

    @property
    def amplitudes(self) -> Array:
        """(a,) strengths by which the model differs from one without effects and laws."""
        return self.at.strengths[self.layout.own]

    @property
    def own(self) -> tuple[int, ...]:
        """Its effects and laws among what it weighs."""
        return tuple(range(len(self.effects) + len(self.laws)))

    def _trace(self, index: int) -> Trace:
        effect, free = self.effects[index], self.free[index]
        strengths = np.zeros(len(free))
        strengths[free] = self.at.strengths[self.layout.of_free[index]]
        # a shape's strength counts from where the columns were formed
        origin = np.where(amplitudes(effect), 0.0, effect.values - strengths)
        low, high = effect.bounds()
        looked = looked_for(effect, self.bodies)
        low, high = (low - origin)[free], (high - origin)[free]
        exact = effect.exact
        return Trace(effect.label, low, high, looked=looked, exact=exact, fitted=True)


def explain(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: Sequence[Effect],
    start: Unknowns,
    laws: Sequence[Law] = (),
    *,
    follows: bool = True,
    noise: Noise = EXACT,
) -> Explanation:
    """Fit a model with these effects.

    Args:
        bodies: the logs.
        base: what is fitted of the machine.
        effects: at their first guesses.
        start: where the base, the biases and the states start; its strengths are not used.
        laws: without a name, fitted besides.
        follows: whether the motion is to follow the model; else segments are fitted apart.
        noise: what disturbs a motion that follows, and the sensors.

    Raises:
        TwinError: no rigid body has the base that the iteration starts from.
    """
    effects = tuple(effect.least(bodies[0].machine.platform) for effect in effects)
    now, away = _explained(tuple(bodies), base, effects, start, laws, follows, noise)
    shaped = any(not amplitudes(effect).all() for effect in effects)
    for _ in range(AGAIN if shaped and follows else 0):
        if away < AWAY:
            break
        # what is held is chosen anew, too
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
    noise: Noise,
) -> tuple[Explanation, float]:
    """Such a fit, and how far its effects ended from where their columns were formed."""
    now = _fitted(bodies, base, effects, tuple(laws), start, follows, noise)
    formed_at, share = effects, 1.0
    sigmas = in_sigmas(now.effects, now.free, now.covariances)
    for rounds in range(ROUNDS if effects else 0):
        # a large effect leads along another motion than that along which its columns were formed
        as_foretold = not follows or rounds > 0 or sigmas < LARGE
        if (as_foretold and _far(formed_at, now) < SETTLED) or share < LEAST:
            break
        there = between(formed_at, now.effects, share)
        tried = _fitted(now.following, base, there, now.laws, now.at, follows, noise, before=now)
        settled = _far(there, tried) < SETTLED
        if follows and not settled and tried.cost > now.cost + WORSE + IN_ALL * sigmas**2:
            share *= 0.5
            continue
        fallen = abs(now.cost - tried.cost)
        now, formed_at, share = tried, there, 1.0
        if follows and fallen < IDLE:
            break
    return now, _far(formed_at, now) if effects else 0.0


def _far(formed_at: Sequence[Effect], now: Explanation) -> float:
    """From where their columns were formed, in standard deviations."""
    return farthest(formed_at, now.effects, now.free, now.covariances)


def _fitted(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: tuple[Effect, ...],
    laws: tuple[Law, ...],
    start: Unknowns,
    follows: bool,
    noise: Noise,
    *,
    before: Explanation | None = None,
) -> Explanation:
    """With the columns of the effects as they are where they are now; `before` with them as they
    were, where a fit of the same has ended."""
    platform = bodies[0].machine.platform
    every = [slopes_of(effect, platform) for effect in effects]
    free = before.free if before else determined(bodies, base, effects, every, start)
    every = [held(effect, parts) for effect, parts in zip(effects, every, strict=True)]
    # as large as the largest; base and the others are no better known than that lets them be
    most = before.most if before else tuple(map(largest, effects, free))
    hidden = unseen(effects, free, most)
    rests = [part for effect in effects for part in references_of(effect, bodies)]
    blurred = [
        replace(part, spread=size * one)
        for effect, parts, away, size in zip(effects, every, hidden, most, strict=True)
        for part, one in compress(zip(parts, usual(effect).tolist(), strict=False), away)
    ]
    own = [part for parts, ones in zip(every, free, strict=True) for part in compress(parts, ones)]
    problem = Problem(bodies, base, [*rests, *blurred, *own, *(law.perturbation for law in laws)])
    sizes = [strengths_of(effect) for effect in effects]
    masks = [*hidden, *free]
    first = [size[places] for size, places in zip([*sizes, *sizes], masks, strict=True)]
    # where columns are only formed anew, what else was fitted stays
    stays = before.at.strengths if before else np.zeros(len(problem.perturbations))
    layout = Layout(len(rests), _counts(hidden), _counts(free), len(laws))
    strengths = np.concatenate([stays[: layout.rests], *first, stays[layout.of_laws]])
    at = replace(start, strengths=strengths)
    if follows:
        found = fit(problem, at, noise)
        now, converged = found.innovations, found.converged
    else:
        now, converged = fit_independent_segments(problem, at), True
    parts = [*layout.of_hidden, *layout.of_free]
    for size, places, part in zip([*sizes, *sizes], masks, parts, strict=True):
        size[places] = now.at.strengths[part]
    moved = tuple(map(with_strengths, effects, sizes))
    return Explanation(tuple(bodies), base, moved, free, laws, problem, now, converged, most)


def _counts(masks: Sequence[NDArray[np.bool_]]) -> tuple[int, ...]:
    return tuple(int(mask.sum()) for mask in masks)


def starts(
    effects: Sequence[Effect], fitted: Collection[Effect], platform: Platform
) -> Iterator[tuple[Effect, ...]]:
    """A set of effects as it is, then with each large turn that is but guessed about each axis.

    Args:
        effects: the set.
        fitted: those of it that are no guesses.
        platform: what they are effects of.
    """
    yield tuple(effects)
    for index, guess in enumerate(effects):
        turn = _turn_of(guess)
        size = float(np.linalg.norm(guess.values[turn]))
        if size < TURNED or guess in fitted:
            continue
        low, high = guess.bounds()
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            values = guess.values.copy()
            values[turn] = np.clip(size * axis, low[turn], high[turn])
            # about the part's own axis nothing turns
            other = guess.with_values(values).least(platform)
            if np.linalg.norm(other.values[turn]) > 0.5 * size:
                yield (*effects[:index], other, *effects[index + 1 :])


def _turn_of(effect: Effect) -> NDArray[np.bool_]:
    """(p,) which of its components are a vector of angles; none if it has no such."""
    known = effect.parameters()
    return np.concatenate(
        [np.full(one.size, one.unit == "rad" and one.size == 3 and one.amplitude) for one in known]
    )


def guesses(
    now: Explanation, asked: Sequence[Candidate], screen: LinearScreen, chosen: tuple[int, ...]
) -> list[Effect]:
    """The chosen effects, new ones with their linearised strengths; no laws."""
    found: list[Effect] = []
    for index, own in zip(chosen, screen.weigh(chosen).strengths, strict=True):
        if index < len(now.effects):
            found.append(now.effects[index])
        elif len(now.own) <= index < len(now.own) + len(asked):
            effect = asked[index - len(now.own)].effect
            strengths = strengths_of(effect)
            strengths[amplitudes(effect)] = own
            found.append(with_strengths(effect, strengths))
    return found


def fitted(
    now: Explanation, effects: Sequence[Effect], laws: Sequence[Law] = ()
) -> Explanation | None:
    """Other effects and laws in place of its own; None where no machine can have them."""
    best: Explanation | None = None
    for start in starts(effects, now.effects, now.bodies[0].machine.platform):
        with suppress(TwinError):
            found = now.instead(start, laws)
            best = found if best is None or found.cost < best.cost - ELSEWHERE else best
        # wherever one of a crowd points, it stands in for something else
        if best is not None and len(effects) > CROWD:
            break
    return best


def followed(
    now: Explanation, effects: Sequence[Effect], laws: Sequence[Law] = ()
) -> Explanation | None:
    """Likewise; None too where the fit loses the motion."""
    found = fitted(now, effects, laws)
    return None if found is None or astray(now, found) else found


def astray(now: Explanation, tried: Explanation) -> bool:
    """Whether a fit has lost the motion that it should follow."""
    return now.follows and not tried.cost < now.cost + ASTRAY * now.samples
