"""Selection of the few symptoms that explain a log, and free runs.

Sets of symptoms are compared in the linearised problem, by addition, exchange and removal; the
selected set is then fitted together with the base.

A free run starts from the filter's state at an instant and continues under the commands. Every
model starts from the same states: those of the best model, from what was measured before.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from twin import rotation
from twin.comparison.account import Account, Stand, follow, imitated, is_noise, loosen, shown
from twin.comparison.symptoms import Symptom
from twin.predict.base import BaseParameters
from twin.predict.body import Body
from twin.predict.innovations import Innovations, Problem, Unknowns
from twin.predict.states import States

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
HORIZONS = (1.0, 10.0, 60.0)
"""[s]."""
INSTANTS = 20
"""Runs of one horizon."""
DRAWS = 2
"""Of the start of each run, for the perfect model."""
SEED = 1
Pose = Callable[[Sequence[Symptom]], Problem]
Refit = Callable[[Problem, tuple[Symptom, ...], Unknowns], Account | None]
ROUNDS = 4
"""Selections, each where the fit of the one before stands."""
UNSURE = 0.05
"""A symptom that has such a chance of being none, all else free, is left out."""


@dataclass(frozen=True)
class SymptomScore:
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
        own = account.prediction.columns.shape[1]
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

    def scores(self) -> list[SymptomScore]:
        """Of all symptoms that the fit lacks, the best first."""
        chosen = self.account.chosen
        before, _ = self._weigh(chosen)
        result: list[SymptomScore] = []
        for symptom in self.symptoms:
            after, change = self._weigh((*chosen, symptom))
            strengths = change[self._columns[symptom.name]]
            odd = not symptom.is_possible(strengths)
            evidence = 0.0 if odd else max(before - after, 0.0)
            result.append(SymptomScore(symptom, evidence, strengths, self._needed(symptom)))
        return sorted(result, key=lambda score: -score.evidence)

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
            chosen = min(weak, key=lambda item: item[0])[1]
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
                (*_without(chosen, item), other)
                for item in chosen
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
        """Infinite where a strength makes no sense."""
        cost, change = self._weigh(chosen)
        strengths = self._strengths(change)
        possible = all(s.is_possible(strengths[s.name]) for s in chosen)
        return cost if possible else np.inf

    def _strengths(self, change: Array) -> dict[str, Array]:
        result = {name: change[columns].copy() for name, columns in self._columns.items()}
        first = 0
        for symptom in self.account.chosen:
            last = first + len(symptom.perturbations)
            result[symptom.name] += self.account.strengths[first:last]
            first = last
        return result

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


@dataclass(frozen=True)
class FreeRun:
    """Runs of one length."""

    horizon: float
    """[s]."""
    time: Array
    """(r, m) [s]."""
    as_built: Array
    """(r, m, 1), (r, m, 4) or (r, m, 3) position."""
    best: Array
    """Likewise, of the best model."""
    errors: tuple[float, float, float]
    """Typical (median) error at the end [rad]: as built, of the best model, of a perfect one."""
    along: tuple[float, float]
    """Median over the runs of the rms error along each [rad]: as built, of the best model. A few
    runs scatter less in it than at their ends."""
    places: tuple[float, float, float] | None = None
    """As `errors`, of x and y [m]; None of a base that does not glide on a floor."""


def free_run(horizon: float, as_built: Account, best: Account) -> FreeRun | None:
    """Run both models; None where the log is too short."""
    body = best.problem.bodies[0]
    grid = body.grid
    count = round(horizon / grid.step)
    last = float(body.motion.time[-1])
    fits = [s for s in range(1, grid.segments) if grid.starts[s] + horizon <= last + 1e-9]
    if not fits or count < 1:
        return None
    chosen = np.array(fits)[np.unique(np.linspace(0, len(fits) - 1, INSTANTS).astype(np.intp))]
    mean, spread = _filtered(best, chosen)
    rng = np.random.default_rng(SEED)
    drawn = [_drawn(mean, spread, rng) for _ in range(DRAWS)]
    built = _positions(body, as_built, chosen, count, [mean])[0]
    better, *perfect = _positions(body, best, chosen, count, [mean, *drawn])
    time = grid.starts[chosen][:, None] + grid.step * np.arange(count + 1)
    known = _known(best, time.ravel()).reshape(better.shape)
    along = [
        float(np.median(np.sqrt(np.mean(np.square(_angles(path, known)), axis=1))))
        for path in (built, better)
    ]
    truth = known[:, -1]
    pairs = (
        (built[:, -1], truth),
        (better[:, -1], truth),
        (np.concatenate(perfect)[:, -1], np.tile(better[:, -1], (DRAWS, 1))),
    )
    errors = _three(_typical(*pair) for pair in pairs)
    places = None
    if truth.shape[-1] == 3:
        places = _three(
            float(np.median(np.linalg.norm((position - known)[:, :2], axis=1)))
            for position, known in pairs
        )
    return FreeRun(horizon, time, built, better, errors, (along[0], along[1]), places)


def _three(values: Iterable[float]) -> tuple[float, float, float]:
    built, best, perfect = values
    return built, best, perfect


def _known(account: Account, time: Array) -> Array:
    """(r, .) position: on the fitted path where the motion follows it, else as smoothed."""
    body = account.problem.bodies[0]
    if not account.follows or _torque_wanders(account):
        return body.motion.at(time).position
    segment, into = body.grid.place(time)
    return account.prediction.exact[0].path.position[0, segment, np.round(into).astype(np.intp)]


def _torque_wanders(account: Account) -> bool:
    return (
        isinstance(account.prediction, Innovations) and account.prediction.noise.torque is not None
    )


def _filtered(account: Account, chosen: NDArray[np.intp]) -> tuple[States, Array]:
    """States (r, .) at the starts of segments, from those before, with the covariance (r, x, x) of
    how far they are from `_known`."""
    exact = account.prediction.exact[0]
    linear = exact.linear
    before = chosen - 1
    if isinstance(account.prediction, Innovations):
        link = account.prediction.chains[0]
        mean = np.stack([link.seen[s][:, 0] for s in before])
        # the fitted path is known with hindsight, and shares with the start what came before it
        known = link.hindsight() if account.follows else np.stack(link.seen_spread)
        spread = known[before]
        if account.prediction.noise.any:
            x, moved = linear.transition.shape[-1], account.prediction.linear[0]
            carry = moved.transition[before]
            mean = moved.jump[before] + np.einsum("rxy,ry->rx", carry, mean)
            spread = carry @ spread @ carry.transpose(0, 2, 1) + moved.spread[before]
            return account.at.starts[0][chosen].moved(mean[:, :x]), spread[:, :x, :x]
    else:
        link = account.prediction.links[0]
        mean = link.states(np.zeros(linear.shared.shape[-1]))[before]
        _, _, weights = account.prediction.best(np.arange(0))
        inverse = np.linalg.pinv(link.of_state[before])
        spread = inverse @ inverse.transpose(0, 2, 1) / weights[before, None, None]
    carry = linear.transition[before]
    path = exact.path
    end = path[0, before, -1]
    return end.moved(np.einsum("rxy,ry->rx", carry, mean)), carry @ spread @ carry.transpose(
        0, 2, 1
    )


def _drawn(mean: States, spread: Array, rng: np.random.Generator) -> States:
    values, vectors = np.linalg.eigh(spread)
    noise = rng.normal(size=values.shape) * np.sqrt(np.maximum(values, 0.0))
    return mean.moved(np.einsum("rxy,ry->rx", vectors, noise))


def _positions(
    body: Body, account: Account, chosen: NDArray[np.intp], count: int, starts: list[States]
) -> list[Array]:
    """Of each set of starts, (r, count + 1, .)."""
    problem = account.problem
    model: mujoco.MjModel = problem.base.model(account.theta)
    push = problem.push(0, account.at)
    rows = np.tile(chosen, len(starts))
    path = body.rollouts.onward(model, rows, States.joined(starts), count, push)
    return np.split(path, len(starts))


def _typical(position: Array, truth: Array) -> float:
    """Median angle between two sets of positions [rad]."""
    return float(np.median(_angles(position, truth)))


def _angles(position: Array, truth: Array) -> Array:
    """(...) between positions (..., 1) or (..., 4), or of headings (..., 3) [rad]."""
    if position.shape[-1] != 4:
        return np.abs(position - truth)[..., -1]
    turn = rotation.multiply(rotation.conjugate(truth), position)
    return np.asarray(np.linalg.norm(rotation.to_rotation_vector(turn), axis=-1))


@dataclass(frozen=True)
class Strength:
    """A symptom with the strengths that a log gives it, and their 95 % intervals."""

    symptom: Symptom
    values: Array
    half: Array
    imitated: float
    """Share of its effect on the log that a change of the base could imitate."""
    ties: tuple[Symptom, ...]
    """What would explain the log as well in its place."""


@dataclass(frozen=True)
class Side:
    """One way to set the base: what is missed without any symptom, and with those that pay."""

    plain: Account
    explained: Account
    """`plain` itself where nothing pays."""
    strengths: tuple[Strength, ...]
    scores: tuple[SymptomScore, ...]
    """Of every symptom, where `plain` stands, the best first; empty where none was asked for."""

    @property
    def healthy(self) -> bool:
        """Whether the plain model leaves nothing but noise, and nothing stands out in it."""
        return self.plain.follows and not self.strengths


def side(
    body: Body,
    base: BaseParameters,
    symptoms: Sequence[Symptom],
    theta: Array,
    biases: Array,
    *,
    held: bool,
    content: bool = False,
) -> Side:
    """Fit a log without and with symptoms.

    Args:
        body: the log.
        base: its base parameters.
        symptoms: to choose from.
        theta: where the base starts.
        biases: where the sensors' constant errors start.
        held: leave the base there.
        content: ask for no symptoms where nothing but noise is left without them.
    """

    def pose(chosen: Sequence[Symptom]) -> Problem:
        more = [p for symptom in chosen for p in symptom.perturbations]
        return Problem([body], base, more, held=held)

    start = pose(()).start(theta, [biases])
    plain = follow(pose(()), (), start)
    if plain is not None and plain.follows and content:
        return Side(plain, plain, (), ())
    if plain is not None:
        account, scores, seen = _explained(plain, pose, symptoms, follow)
        if plain.follows or account.follows:
            return Side(plain, account, _strengths(account, seen), scores)
    plain = loosen(pose(()), (), start)
    account, scores, seen = _explained(plain, pose, symptoms, loosen)
    if account.chosen and is_noise(account.misfits):
        settled = follow(pose(account.chosen), account.chosen, account.at)
        if settled is not None and settled.follows:
            account = _refined(settled, Screen(settled, seen), pose, seen, follow)
    return Side(plain, account, _strengths(account, seen), scores)


def _explained(
    plain: Account, pose: Pose, symptoms: Sequence[Symptom], refit: Refit
) -> tuple[Account, tuple[SymptomScore, ...], tuple[Symptom, ...]]:
    """The account with the symptoms that pay; what each promised at first; those that are seen."""
    screen = Screen(plain, symptoms)
    # what another base does as well is not asked again: beside a friction it would seem to differ
    seen = screen.symptoms
    return _refined(plain, screen, pose, seen, refit), tuple(screen.scores()), seen


def _refined(
    current: Account, screen: Screen, pose: Pose, symptoms: Sequence[Symptom], refit: Refit
) -> Account:
    """After selections and fits in turn, until the selection stays, or comes back."""
    seen = {frozenset(current.chosen): current}
    for _ in range(ROUNDS):
        chosen = screen.select()
        if frozenset(chosen) in seen:
            current = seen[frozenset(chosen)]
            break
        moved = refit(pose(chosen), chosen, _start(current, chosen))
        if moved is None:
            break
        beyond = [
            s for s, values in zip(chosen, _split(moved), strict=True) if not s.is_possible(values)
        ]
        if beyond:
            symptoms = [s for s in symptoms if s not in beyond]
        else:
            current = seen[frozenset(chosen)] = moved
        screen = Screen(current, symptoms)
    return _without_unsure(current, pose, refit)


def _without_unsure(current: Account, pose: Pose, refit: Refit) -> Account:
    """Without symptoms that stand or fall with each other: of a set that only fits together, none
    has a strength that is sure."""
    while current.chosen:
        covariance, _ = current.covariance()
        spread = covariance[-len(current.strengths) :, -len(current.strengths) :]
        first, doubts = 0, list[tuple[float, Symptom]]()
        for symptom, values in zip(current.chosen, _split(current), strict=True):
            own = slice(first, first + len(values))
            evidence = float(values @ np.linalg.pinv(spread[own, own], hermitian=True) @ values)
            doubts.append((evidence / float(chi2.isf(UNSURE, len(values))), symptom))
            first += len(values)
        least, weak = min(doubts, key=lambda doubt: doubt[0])
        if least > 1.0:
            break
        chosen = tuple(s for s in current.chosen if s is not weak)
        moved = refit(pose(chosen), chosen, _start(current, chosen))
        if moved is None:
            break
        current = moved
    return current


def _start(account: Account, chosen: tuple[Symptom, ...]) -> Unknowns:
    """Where an account stands, with the strengths of other symptoms."""
    known = dict(zip([s.name for s in account.chosen], _split(account), strict=True))
    parts = [known.get(s.name, np.zeros(len(s.perturbations))) for s in chosen]
    return replace(account.at, strengths=np.concatenate([np.zeros(0), *parts]))


def _split(account: Account) -> list[Array]:
    edges = np.cumsum([len(s.perturbations) for s in account.chosen])[:-1]
    return np.split(account.strengths, edges) if account.chosen else []


def _strengths(account: Account, symptoms: Sequence[Symptom]) -> tuple[Strength, ...]:
    if not account.chosen:
        return ()
    screen = Screen(account, symptoms)
    covariance, quantile = account.covariance()
    half = quantile * np.sqrt(np.maximum(np.diag(covariance), 0.0))[-len(account.strengths) :]
    first, result = 0, list[Strength]()
    for symptom, values in zip(account.chosen, _split(account), strict=True):
        last = first + len(values)
        result.append(
            Strength(
                symptom,
                values,
                half[first:last],
                _imitated(account, first, last),
                tuple(screen.ties(symptom)),
            )
        )
        first = last
    return tuple(result)


def _imitated(account: Account, first: int, last: int) -> float:
    """Share of a symptom's effect, at its strengths, that a change of the base could imitate."""
    own = account.prediction.columns[:, -len(account.strengths) :][:, first:last]
    return imitated(account.prediction, own @ account.strengths[first:last], len(account.theta))
