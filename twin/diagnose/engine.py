"""Which causes, noise processes and laws explain logs: a beam search over refitted sets.

A state is a set of causes, and laws without a name, fitted to the logs beside the base. Where it
stands, the linear screen (`Search`) says which other sets promise to be likelier; those are fitted,
the few best are screened in turn, and the search ends where no set promises more than the best has.
The score of a state is -2 log L and the price of all that it sets (`Line.score`).

The screen grows as it is needed: the catalogue at its usual shapes; then the same causes beside
noise processes (draughts, an attitude reference that strays); then frequencies that stand out of
what the best state leaves, and laws without a name. In the end the best state is compared with laws
alone, with refits without each of its causes, and with the rivals of its only cause.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np

from twin.diagnose.candidates import Candidate, resonators, ringing, winding
from twin.diagnose.explanation import (
    CROWD,
    Explanation,
    astray,
    explain,
    fitted,
    followed,
    guesses,
    in_sigmas,
)
from twin.diagnose.laws import Law, laws_of, unlikely
from twin.diagnose.residual_test import ResidualTest, lines_of, residual_test, slow_line_of
from twin.diagnose.screen import TIED, Search, less
from twin.effects import Effect, able, with_effects
from twin.errors import TwinError
from twin.identify.prediction_error import NORMAL, WORTHWHILE
from twin.model import compile_model
from twin.predict.independent_segments import independent_segments

Say = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """All numbers of the search."""

    beam: int = 2
    """States that go on."""
    singles: int = 4
    """Causes that are fitted singly where a state stands, those that promise most."""
    rounds: int = 6
    """Steps of the beam."""
    nearly: float = 0.7
    """Share of what a whole set gains, from where on one cause of it is fitted by itself first: the
    others may be what its linear column lacks."""
    weak: float = 0.03
    """Share of the strongest new cause's evidence below which another one waits until that is
    fitted: as much may be the error of its column."""
    near: float = 12.0
    """Evidence by which a rival may be behind to be fitted in a cause's place,"""
    near_share: float = 0.05
    """or that share of the cause's own evidence, where that is more."""
    rivals: int = 3
    """That are fitted, the nearest."""
    inexact: float = 1e-4
    """Share of the strongest cause's gain that the rest may seem to bring: a motion with a strong
    cause in it is followed no more exactly, for its base's columns lack how that answers."""


SETTINGS = Settings()


@dataclass(frozen=True)
class SearchState:
    """A state of the search: an explanation, and the screen where it stands."""

    explanation: Explanation
    candidates: tuple[Candidate, ...] = ()
    """What is screened beside the explanation's own parts."""
    laws: tuple[Law, ...] = ()
    """Screened too, after the candidates."""
    nameless: float = 0.0
    """Evidence that laws without a name bring beyond the best set of causes; 0 without any."""
    rivals: Mapping[str, float] = field(default_factory=dict[str, float])
    """By how much causes that were fitted in an only one's place are behind, by label."""

    @cached_property
    def search(self) -> Search:
        """The screen; of a state that does not go on it is never formed."""
        return search_from(self.explanation, self.candidates, self.laws)

    @cached_property
    def residual_test(self) -> ResidualTest:
        """What it does not explain."""
        return residual_test(self.explanation)

    @cached_property
    def price(self) -> float:
        """Of all that was set to have it so."""
        own, price = self.explanation.own, WORTHWHILE * self.explanation.noise.processes
        if not own:
            return price
        alone = search_from(self.explanation, ())
        return price + alone.screen.weigh(own).gain - alone.evidence(own)

    def score(self, inflation: float) -> float:
        """-2 log L, where samples say so many times less than white noise does, and the price; the
        lower the better."""
        return self.explanation.deflated(inflation) + self.price

    @cached_property
    def best(self) -> tuple[int, ...]:
        """The set with the most evidence by the screen."""
        return self.search.best()

    @cached_property
    def lawful(self) -> bool:
        """Whether a law without a name would pay, which the sum of all residuals may not show."""
        laws = laws_of(self.explanation.bodies)
        own = tuple(self.explanation.own)
        scores = search_from(self.explanation, (), laws).scores(own)
        return bool(scores) and scores[0].evidence > 0.0

    @cached_property
    def settled(self) -> bool:
        """Whether it leaves no more than noise, and the screen has nothing better.

        What segments apart are screened by beside a cause is what the motion as a whole shows.
        """
        if self.residual_test.doubtful:
            return False
        if not self.explanation.follows:
            return True
        return set(self.best) == set(self.explanation.own) and not self.lawful


def search_from(
    explanation: Explanation, candidates: Sequence[Candidate], laws: Sequence[Law] = ()
) -> Search:
    """Among an explanation's own parts and all that can be asked."""
    price = unlikely(laws) if laws else 0.0
    parts = [*map(explanation.sized, candidates), *((law.perturbation,) for law in laws)]
    screen = explanation.weigh(
        parts, [*(one.trace for one in candidates), *(law.trace(price) for law in laws)]
    )
    return Search(screen, range(len(screen.traces)))


@dataclass(frozen=True)
class _Move:
    """A set to be fitted from where a state stands."""

    state: SearchState
    chosen: tuple[int, ...]

    @property
    def gain(self) -> float:
        """Evidence that the screen promises."""
        search = self.state.search
        return search.evidence(self.chosen) - search.evidence(self.state.explanation.own)

    @property
    def key(self) -> frozenset[object]:
        """Equal for sets that are the same but for where their fits begin."""
        state, first = self.state, len(self.state.explanation.own)
        candidates = [
            state.candidates[i - first]
            for i in self.chosen
            if first <= i < first + len(state.candidates)
        ]
        shaped = [(one.label, one.effect.values.tobytes()) for one in candidates if one.looked]
        labels = [state.search.screen.traces[index].label for index in self.chosen]
        base = (
            b""
            if state.explanation.follows or state.explanation.own
            else state.explanation.at.theta.tobytes()
        )
        return frozenset([*labels, *shaped, state.explanation.noise.wanders, base])


class Engine:
    """The search for what explains logs."""

    def __init__(self, candidates: Sequence[Candidate], say: Say) -> None:
        """Among candidates.

        Args:
            asked: all that the logs can be asked for, at their usual shapes.
            say: takes a sentence of what is being done.
        """
        self.candidates = tuple(one for one in candidates if not one.effect.winds)
        self.winding = tuple(one for one in candidates if one.effect.winds)
        """Of which no number of waves is usual: asked for where something is left."""
        self.say = say
        self._barred: set[str] = set()
        self._seen: set[frozenset[object]] = set()
        self._named: SearchState | None = None
        self._baseline: Explanation | None = None
        self._inflation = np.inf
        self._likeliest: dict[frozenset[str], SearchState] = {}

    def explained(self, baseline: Explanation) -> SearchState:
        """From a model without causes to one that no other set of causes betters."""
        self._begin(baseline)
        self.say("causes weighed")
        lines = [self._state_of(explanation) for explanation in _starts(baseline)]
        beam = self._grown(lines) if baseline.follows else self._single_causes(lines[0])
        if not beam[0].settled:
            more = (
                self._with_noise_processes(baseline)
                if baseline.follows
                else self._grown([self._state_of(baseline)])
            )
            beam = self._best([*beam, *more])
        # what wanders passes for a law without a name, and for what rings
        if not beam[0].settled or beam[0].explanation.noise.any:
            beam = self._widened(baseline, beam)
        return self._finished(self._verified(beam[0]))

    def onward(self, baseline: Explanation, segments: SearchState) -> SearchState | None:
        """On from the causes that segments predicted apart have, along a motion that follows the
        model; None where that does not settle."""
        if not segments.explanation.effects:
            return None
        try:
            there = explain(
                baseline.bodies,
                baseline.base,
                segments.explanation.effects,
                segments.explanation.at,
            )
        except TwinError:
            return None
        if not there.converged:
            return None
        self._begin(baseline)
        state = self._state_of(there, segments.candidates)
        return self._finished(self._verified(self._grown([state])[0]))

    def _begin(self, baseline: Explanation) -> None:
        self._seen.clear()
        self._likeliest.clear()
        self._named, self._baseline, self._inflation = None, baseline, np.inf

    def _single_causes(self, state: SearchState) -> list[SearchState]:
        """Over segments apart: each of the few causes that promise most, fitted singly, up to one
        that leaves no more than noise. What it is worth there says only which to try."""
        states, tried = list[SearchState](), dict[str, int]()
        for score in state.search.scores():
            if len(tried) < SETTINGS.singles:
                tried.setdefault(state.search.screen.traces[score.index].label, score.index)
        for index in tried.values():
            there = self._moved(_Move(state, (index,)), state)
            if there is not None:
                states.append(there)
                if there.settled:
                    break
        return self._best(states) or [state]

    def _with_noise_processes(self, baseline: Explanation) -> list[SearchState]:
        """The best states whose noise wanders; none where it does not."""
        self.say("noise processes")
        noisy = baseline.wandering()
        if not noisy.noise.any:
            return []
        return [
            state for state in self._grown([self._state_of(noisy)]) if state.explanation.noise.any
        ]

    def _widened(self, baseline: Explanation, beam: list[SearchState]) -> list[SearchState]:
        """On, asked also for frequencies that stand out, for what may ring anywhere, and for laws
        without a name."""
        self.say("frequencies and laws without a name")
        starts = (
            [beam[0]] if beam[0].explanation is baseline else [beam[0], self._state_of(baseline)]
        )
        anywhere = self._ringing_anywhere(baseline)
        wide: list[SearchState] = []
        for state in starts:
            hertz = lines_of(state.explanation) or slow_line_of(state.explanation)
            lines = ringing(self.candidates, hertz, baseline.bodies)
            candidates = (*self.candidates, *lines, *anywhere, *self._winding(state.explanation))
            laws = tuple(laws_of(baseline.bodies)) if state.explanation.follows else ()
            wide.append(self._state_of(state.explanation, candidates, laws))
        return self._grown([*wide, *self._stepped(wide)])

    def _ringing_anywhere(self, baseline: Explanation) -> tuple[Candidate, ...]:
        """Of each cause that rings, where beside nothing else it promises most: where commands
        repeat, it leaves lines at their harmonics, not at its own frequency."""
        if not baseline.follows or not baseline.converged:
            return ()
        scan = resonators(self.candidates, baseline.bodies)
        search, best = search_from(baseline, scan), dict[str, Candidate]()
        for score in search.scores():
            if search.pays(score):
                best.setdefault(scan[score.index].label, scan[score.index])
        return tuple(best.values())

    def _winding(self, explanation: Explanation) -> tuple[Candidate, ...]:
        """Of what makes waves around the turn of a hinge, the numbers of them that promise most."""
        # a few waves that a segment apart sees no whole one of stand in for a torque
        scan = winding(self.winding, explanation.bodies) if explanation.follows else ()
        if not scan:
            return ()
        search, first = search_from(explanation, scan), len(explanation.own)
        scores = (score for score in search.scores(explanation.own) if search.pays(score))
        return tuple(scan[score.index - first] for score in islice(scores, SETTINGS.singles))

    def _grown(self, beam: Sequence[SearchState]) -> list[SearchState]:
        """Step by step, until the best settles or no set promises more."""
        states = self._best(beam)
        for _ in range(SETTINGS.rounds):
            if states[0].settled:
                break
            new = list(self._stepped(states))
            if not new:
                break
            states = self._best([*states, *new])
        return states

    def _stepped(self, states: Sequence[SearchState]) -> Iterator[SearchState]:
        """The sets that promise more than the best state has, fitted; up to one that settles."""
        best = min(map(self._score, states))
        for state in states:
            for move in self._moves(state):
                crowd = len(_kinds(state, move.chosen)) > CROWD
                if crowd or move.key in self._seen or not self._promised(move) < best:
                    continue
                self._seen.add(move.key)
                there = self._moved(move, states[0])
                if there is None:
                    continue
                yield there
                if there.settled:
                    return
                best = min(best, self._score(there))

    def _moves(self, state: SearchState) -> Iterator[_Move]:
        """Those worth a fit from where a state stands: single causes that gain nearly as much as a
        whole set, the set, and what is strongest in it."""
        search, own = state.search, set(state.explanation.own)
        chosen = _few(state, state.best)
        kept = tuple(index for index in chosen if index in own)
        new = [index for index in chosen if index not in own]
        if len(new) <= 1:
            if set(chosen) != own:
                yield _Move(state, chosen)
            if state.residual_test.doubtful:
                yield from (_Move(state, (*kept, index)) for index in self._singles(state, kept))
            return
        gain = search.screen.weigh
        threshold = SETTINGS.nearly * (gain(chosen).gain - gain(kept).gain)
        singles = self._singles(state, kept)
        first = [i for i in singles if gain((*kept, i)).gain - gain(kept).gain >= threshold]
        yield from (_Move(state, (*kept, index)) for index in first)
        yield _Move(state, (*kept, *_strong(search, chosen, new)))
        strongest = max(
            new, key=lambda i: search.evidence(chosen) - search.evidence(less(chosen, i))
        )
        for index in dict.fromkeys([strongest, *(singles if not own else ())]):
            yield _Move(state, (*kept, index))

    def _singles(self, state: SearchState, kept: tuple[int, ...]) -> list[int]:
        """Causes that promise most beside those that are kept, one of each label."""
        found: dict[str, int] = {}
        for score in state.search.scores(kept):
            if len(found) == SETTINGS.singles:
                break
            if state.search.pays(score):
                found.setdefault(state.search.screen.traces[score.index].label, score.index)
        return list(found.values())

    def _moved(self, move: _Move, best: SearchState) -> SearchState | None:
        """Fitted; None where no machine can have it, or where the fit loses the motion."""
        state, explanation = move.state, move.state.explanation
        effects = guesses(explanation, state.candidates, state.search.screen, move.chosen)
        laws = _laws(state, move.chosen)
        names = sorted([*(one.label for one in effects), *(law.label for law in laws)])
        self.say("fitting " + ", ".join(names))
        lead = best.explanation if best.explanation.noise.white > 0.0 else explanation
        there = fitted(lead, effects, laws)
        if there is not None and there.laws:
            # their columns were formed along a motion that lacked them
            there = followed(there, there.effects, there.laws) or there
        meant = effects if there is None else there.effects
        known = {effect.label for effect in explanation.effects}
        barred = {e.label for e in meant if e.label not in known and not _possible(explanation, e)}
        if there is None or barred:
            self._barred |= barred
            return None
        if lead is explanation and astray(explanation, there):
            return None
        return self._state_of(there, state.candidates, state.laws)

    def _state_of(
        self,
        explanation: Explanation,
        candidates: Sequence[Candidate] = (),
        laws: Sequence[Law] = (),
    ) -> SearchState:
        candidates = tuple(
            one for one in candidates or self.candidates if one.label not in self._barred
        )
        state = SearchState(explanation, candidates, tuple(laws))
        self._inflation = min(self._inflation, explanation.account.inflation)
        if not explanation.laws and (
            self._named is None or self._score(state) < self._score(self._named)
        ):
            self._named = state
        known = self._likeliest.setdefault(_labels(explanation), state)
        self._likeliest[_labels(explanation)] = min(known, state, key=self._score)
        return state

    def _best(self, lines: Iterable[SearchState]) -> list[SearchState]:
        """Those that go on."""
        return sorted(lines, key=self._score)[: SETTINGS.beam]

    def _score(self, state: SearchState) -> float:
        """All by one inflation, that of the best: what a poor fit leaves has the longest memory. A
        white torque only leads a motion to the logs, and scores last."""
        return np.inf if state.explanation.noise.white > 0.0 else state.score(self._inflation)

    def _promised(self, move: _Move) -> float:
        """The score that the screen promises."""
        own = move.state.explanation.account.inflation
        return move.state.score(self._inflation) - move.gain * own / self._inflation

    def _verified(self, state: SearchState) -> SearchState:
        """Against laws without a name in place of causes beside such laws, refits without each of
        its causes, and rivals in its only one's place."""
        while True:
            fewer = self._nameless(state) or self.without_one(state)
            if fewer is None:
                best = self.against_rivals(state)
                if best.explanation is state.explanation:
                    return best
                fewer = replace(best, rivals={})
            state = self._grown([fewer])[0]

    def _nameless(self, state: SearchState) -> SearchState | None:
        """Laws without a name alone; None where causes beside them bring more.

        A cause may stand in for the terms of a law: beside one it is no likelier beforehand than
        another law.
        """
        if not state.explanation.laws or not state.explanation.effects:
            return None
        first = len(state.explanation.own) + len(state.candidates)
        laws = [
            *state.explanation.own[len(state.explanation.effects) :],
            *range(first, first + len(state.laws)),
        ]
        chosen = Search(state.search.screen, laws, state.search.limit).best()
        there = self._moved(_Move(state, chosen), state) if chosen else None
        spare = TIED + unlikely(state.laws) * len(state.explanation.effects)
        if there is None or self._score(there) > self._score(state) + spare:
            return None
        return there

    def without_one(self, state: SearchState) -> SearchState | None:
        """Without what a refit shows to be needless, the weakest first; None if all is needed."""
        explanation, search = state.explanation, state.search
        gain = {i: search.score(less(explanation.own, i), i).gain for i in explanation.own}
        for out in self._groups(state, gain):
            effects = [effect for i, effect in enumerate(explanation.effects) if i not in out]
            laws = [
                law
                for i, law in enumerate(explanation.laws, len(explanation.effects))
                if i not in out
            ]
            labels = ", ".join(search.screen.traces[index].label for index in out)
            self.say(f"fitting without {labels}")
            bare = None if effects or laws or explanation.noise.any else self._baseline
            fewer = bare or followed(explanation, effects, laws)
            if fewer is None:
                continue
            there = self._state_of(fewer, state.candidates, state.laws)
            # what was added and is dropped again may have led the fit away
            there = min(there, self._likeliest[_labels(fewer)], key=self._score)
            rest = [gain[i] for i in explanation.own if i not in out]
            spare = SETTINGS.inexact * max(rest, default=0.0)
            cost = there.explanation.deflated(self._inflation) - explanation.deflated(
                self._inflation
            )
            lost = search.scored(out[0], cost)
            chance = len(out) == 1 and not search.pays(lost) and not there.residual_test.doubtful
            # of two sets that tie the smaller one, and none of what may be none
            if len(out) > 1 or all(_may_be_none(explanation, index) for index in out):
                spare += TIED
            if self._score(there) < self._score(state) + spare or chance:
                return there
        return None

    def _groups(self, state: SearchState, gain: Mapping[int, float]) -> list[tuple[int, ...]]:
        """What a state is held against refits without: all that its columns show to be needless,
        then each cause and law, that of the least gain first; none of a crowd, whose every fit is
        long."""
        search, own = state.search, state.explanation.own
        needed = Search(search.screen, own, search.limit).best()
        needless = tuple(index for index in own if index not in needed)
        single = len(own) <= CROWD or bool(state.explanation.laws)
        weakest = sorted(own, key=lambda i: gain[i]) if single else []
        return [*([needless] if needless else []), *((i,) for i in weakest if (i,) != needless)]

    def against_rivals(self, state: SearchState) -> SearchState:
        """The better of an only cause and its rivals, each fitted in its place: the columns of
        those are formed along the motion that has the cause, and promise less than their fits.

        What comes of it knows how far behind each of the others is.
        """
        explanation, search = state.explanation, state.search
        if not explanation.follows or explanation.laws or len(explanation.effects) != 1:
            return state
        nearest: dict[str, int] = {}
        near = max(SETTINGS.near, SETTINGS.near_share * search.evidence(explanation.own))
        for other, behind in search.instead(explanation.own, 0):
            if behind < near and len(nearest) < SETTINGS.rivals:
                nearest.setdefault(search.screen.traces[other].label, other)
        tried = {explanation.effects[0].label: state}
        for label, other in nearest.items():
            there = self._moved(_Move(state, (other,)), state)
            if there is not None and there.explanation.converged and there.explanation.effects:
                tried[label] = there
        best = min(tried.values(), key=self._score)
        lowest = self._score(best)
        behind = {label: self._score(one) - lowest for label, one in tried.items()}
        return replace(best, rivals=behind)

    def _finished(self, state: SearchState) -> SearchState:
        """Screened by causes only, and with what its laws bring beyond them."""
        named = self._named
        beyond = 0.0
        if state.explanation.laws and named is not None:
            beyond = max(self._score(named) - self._score(state), 0.0)
        return replace(state, laws=(), nameless=beyond)


def likeliest(baseline: Explanation, candidates: Sequence[Candidate]) -> Iterator[Explanation]:
    """The set of causes that promises most, fitted, and each of a few that promise most alone."""
    search = search_from(baseline, candidates)
    alone = sorted(search.asked, key=lambda index: -search.screen.weigh((index,)).gain)[
        : SETTINGS.singles
    ]
    for chosen in (search.best(), *((index,) for index in alone)):
        found = fitted(baseline, guesses(baseline, candidates, search.screen, chosen))
        if found is not None:
            yield found


def _starts(baseline: Explanation) -> list[Explanation]:
    """Where the search begins: at a model without causes; where that loses the motion, also at one
    that a white torque leads to the logs; over segments apart with the base as stated, for one that
    was fitted without a strong cause may be no machine's."""
    if baseline.follows:
        return [baseline] if baseline.converged else [baseline.disturbed(), baseline]
    at = replace(baseline.at, theta=baseline.base.as_stated)
    return [
        replace(
            baseline,
            explanation=independent_segments(baseline.problem, at, baseline.problem.exact(at)),
        )
    ]


def _labels(explanation: Explanation) -> frozenset[str]:
    return frozenset(part.label for part in (*explanation.effects, *explanation.laws))


def _few(state: SearchState, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Of a set the causes that bring most, as many kinds as an answer may have: a crowd takes long
    to fit, and stands in for something else."""
    search = state.search
    worth = {i: search.evidence(chosen) - search.evidence(less(chosen, i)) for i in chosen}
    kept: tuple[int, ...] = ()
    for index in sorted(chosen, key=lambda i: -worth[i]):
        if len(_kinds(state, (*kept, index))) <= CROWD:
            kept = (*kept, index)
    return tuple(index for index in chosen if index in kept)


def _kinds(state: SearchState, chosen: Sequence[int]) -> set[str]:
    """Of the causes in a set; a law without a name is of none."""
    parts = [
        *state.explanation.effects,
        *state.explanation.laws,
        *(one.effect for one in state.candidates),
        *state.laws,
    ]
    return {part.name for part in (parts[i] for i in chosen) if isinstance(part, Effect)}


def _strong(search: Search, chosen: tuple[int, ...], new: Sequence[int]) -> tuple[int, ...]:
    """Of new causes those that need not wait until a far stronger one is fitted."""
    whole = search.evidence(chosen)
    worth = {index: whole - search.evidence(less(chosen, index)) for index in new}
    most = max(worth.values())
    return tuple(index for index in new if worth[index] >= SETTINGS.weak * most)


def _laws(state: SearchState, chosen: Sequence[int]) -> list[Law]:
    """Of a set."""
    count, own = len(state.explanation.effects), len(state.explanation.own)
    first = own + len(state.candidates)
    return [
        state.explanation.laws[i - count] if i < own else state.laws[i - first]
        for i in chosen
        if count <= i < own or i >= first
    ]


def _may_be_none(explanation: Explanation, index: int) -> bool:
    """Whether the interval of a cause's amplitudes holds none of it."""
    if index >= len(explanation.effects):
        return False
    effect, free = explanation.effects[index], explanation.free[index]
    return in_sigmas([effect], [free], [explanation.covariances[index]]) < NORMAL


def _possible(explanation: Explanation, effect: Effect) -> bool:
    """Whether the machine can have it in that size."""
    platform = explanation.bodies[0].machine.platform
    try:
        compile_model(with_effects(able(platform, effect), (effect,)))
    except TwinError:
        return False
    return True
