"""What would explain what a model leaves: symptoms fitted beside the base, as long as they pay."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from twin.compare.account import Account, follow, imitated, loosen
from twin.compare.misfit import is_noise
from twin.compare.selection import Score, Screen
from twin.compare.symptoms import Symptom
from twin.predict.body import Body
from twin.predict.parameters.base import BaseParameters
from twin.predict.whitening.innovations import Problem
from twin.predict.whitening.unknowns import Unknowns

Array = NDArray[np.float64]
Pose = Callable[[Sequence[Symptom]], Problem]
Refit = Callable[[Problem, tuple[Symptom, ...], Unknowns], Account | None]

ROUNDS = 4
"""Selections, each where the fit of the one before stands."""
UNSURE = 0.05
"""A symptom that has such a chance of being none, all else free, is left out."""


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
    scores: tuple[Score, ...]
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
        found, scores, seen = _explained(plain, pose, symptoms, follow)
        if plain.follows or found.follows:
            return Side(plain, found, _strengths(found, seen), scores)
    plain = loosen(pose(()), (), start)
    found, scores, seen = _explained(plain, pose, symptoms, loosen)
    if found.chosen and is_noise(found.misfits):
        settled = follow(pose(found.chosen), found.chosen, found.at)
        if settled is not None and settled.follows:
            found = _refined(settled, Screen(settled, seen), pose, seen, follow)
    return Side(plain, found, _strengths(found, seen), scores)


def _explained(
    plain: Account, pose: Pose, symptoms: Sequence[Symptom], refit: Refit
) -> tuple[Account, tuple[Score, ...], tuple[Symptom, ...]]:
    """The account with the symptoms that pay; what each promised at first; those that are seen."""
    screen = Screen(plain, symptoms)
    # what another base does as well is not asked again: beside a friction it would seem to differ
    seen = screen.symptoms
    return _refined(plain, screen, pose, seen, refit), tuple(screen.scores()), seen


def _refined(
    now: Account, screen: Screen, pose: Pose, symptoms: Sequence[Symptom], refit: Refit
) -> Account:
    """After selections and fits in turn, until the selection stays, or comes back."""
    seen = {frozenset(now.chosen): now}
    for _ in range(ROUNDS):
        chosen = screen.select()
        if frozenset(chosen) in seen:
            now = seen[frozenset(chosen)]
            break
        moved = refit(pose(chosen), chosen, _start(now, chosen))
        if moved is None:
            break
        now = seen[frozenset(chosen)] = moved
        screen = Screen(now, symptoms)
    return _without_unsure(now, pose, refit)


def _without_unsure(now: Account, pose: Pose, refit: Refit) -> Account:
    """Without symptoms that stand or fall with each other: of a set that only fits together, none
    has a strength that is sure."""
    while now.chosen:
        covariance, _ = now.covariance()
        spread = covariance[-len(now.strengths) :, -len(now.strengths) :]
        first, doubts = 0, list[tuple[float, Symptom]]()
        for symptom, values in zip(now.chosen, _split(now), strict=True):
            own = slice(first, first + len(values))
            evidence = float(values @ np.linalg.pinv(spread[own, own], hermitian=True) @ values)
            doubts.append((evidence / float(chi2.isf(UNSURE, len(values))), symptom))
            first += len(values)
        least, weak = min(doubts, key=lambda doubt: doubt[0])
        if least > 1.0:
            break
        chosen = tuple(s for s in now.chosen if s is not weak)
        moved = refit(pose(chosen), chosen, _start(now, chosen))
        if moved is None:
            break
        now = moved
    return now


def _start(now: Account, chosen: tuple[Symptom, ...]) -> Unknowns:
    """Where an account stands, with the strengths of other symptoms."""
    known = dict(zip([s.name for s in now.chosen], _split(now), strict=True))
    parts = [known.get(s.name, np.zeros(len(s.perturbations))) for s in chosen]
    return replace(now.at, strengths=np.concatenate([np.zeros(0), *parts]))


def _split(now: Account) -> list[Array]:
    edges = np.cumsum([len(s.perturbations) for s in now.chosen])[:-1]
    return np.split(now.strengths, edges) if now.chosen else []


def _strengths(now: Account, symptoms: Sequence[Symptom]) -> tuple[Strength, ...]:
    if not now.chosen:
        return ()
    screen = Screen(now, symptoms)
    covariance, quantile = now.covariance()
    half = quantile * np.sqrt(np.maximum(np.diag(covariance), 0.0))[-len(now.strengths) :]
    first, found = 0, list[Strength]()
    for symptom, values in zip(now.chosen, _split(now), strict=True):
        last = first + len(values)
        found.append(
            Strength(
                symptom,
                values,
                half[first:last],
                _imitated(now, first, last),
                tuple(screen.ties(symptom)),
            )
        )
        first = last
    return tuple(found)


def _imitated(now: Account, first: int, last: int) -> float:
    """Share of a symptom's effect, at its strengths, that a change of the base could imitate."""
    own = now.now.columns[:, -len(now.strengths) :][:, first:last]
    return imitated(now.now, own @ now.strengths[first:last], len(now.theta))
