"""Beam search over sets of causes, noise processes and unnamed laws that explain logs.

A state of the search is a set of causes and unnamed laws, fitted to the logs together with the
base. The linear screen (`Search`) predicts at that fit which other sets are likelier. The search
fits those sets, keeps the best states, and ends when the screen predicts no further gain. The score
of a state is -2 log L plus the price of all its numbers (`SearchState.score`).

The search widens in three stages: the catalogue at its usual shapes; the same candidates together
with noise processes (draughts, an attitude reference that drifts); frequencies that stand out of
the residual, and unnamed laws. At the end, the best state is compared with unnamed laws alone, with
refits without each of its causes, and with refits in which a rival replaces its only cause.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np

from twin.comparison.explanation import HORIZONS, free_run
from twin.diagnosis.candidates import Candidate, resonators, ringing, winding
from twin.diagnosis.explanation import (
    CROWD,
    Explanation,
    astray,
    distance,
    explain,
)
from twin.diagnosis.laws import Law, laws_of, unlikely
from twin.diagnosis.residual_test import (
    ResidualTest,
    lines_of,
    residual_test,
    slow_line_of,
)
from twin.diagnosis.screen import TIED, LinearScreen, Search, without
from twin.diagnosis.starts import fitted, followed
from twin.effects import Effect, VibrationEffect, able, with_effects
from twin.errors import TwinError
from twin.identification.prediction_error import NORMAL, WORTHWHILE
from twin.model import compile_model
from twin.predict.columns import amplitudes, strengths_of, with_strengths
from twin.predict.independent_segments import independent_segments

Say = Callable[[str], None]


@dataclass(frozen=True)
class SearchSettings:
    """All numbers of the search."""

    beam: int = 2
    """States that a step of the search keeps."""
    singles: int = 4
    """Candidates that are fitted one at a time from a state: those with the highest evidence."""
    rounds: int = 6
    """Steps of the beam search, at most."""
    nearly: float = 0.7
    """Share of a set's gain from which on one of its causes is fitted alone first: the others may
    only correct the error of that cause's linear column."""
    weak: float = 0.03
    """Share of the strongest new cause's evidence below which another one is not fitted with it:
    the error of the strongest one's linear column may account for as much."""
    near: float = 12.0
    """Evidence by which a rival may be behind a cause and still be fitted in its place,"""
    near_share: float = 0.05
    """or this share of the cause's own evidence, whichever is larger."""
    rivals: int = 3
    """Rivals that are fitted, at most."""
    shaken: float = 5.0
    """Frequency of a line above which a sensor is asked to vibrate from the start of a search [Hz]:
    slower ones may be of a panel or of a liquid, and come with these."""
    inexact: float = 1e-4
    """Share of the strongest cause's gain that is numerical error: the base's columns neglect how a
    strong cause responds to a change of the base."""


SETTINGS = SearchSettings()


@dataclass(frozen=True)
class SearchState:
    """A fitted set of causes and laws, and what is screened there."""

    explanation: Explanation
    candidates: tuple[Candidate, ...] = ()
    """Screened together with the explanation's own causes and laws."""
    laws: tuple[Law, ...] = ()
    """Unnamed laws, screened after the candidates."""
    nameless: float = 0.0
    """Evidence of its unnamed laws against the best set of causes alone; 0 without such laws."""
    others: Mapping[frozenset[str], float] = field(default_factory=dict[frozenset[str], float])
    """Score of each other set that was fitted, relative to this one, by the labels in it."""

    @cached_property
    def search(self) -> Search:
        """The linear screen at this fit, formed when it is first used."""
        return search_from(self.explanation, self.candidates, self.laws)

    @cached_property
    def residual_test(self) -> ResidualTest:
        """Whether the residual is more than noise."""
        return residual_test(self.explanation)

    @cached_property
    def price(self) -> float:
        """Price of the numbers that causes, laws and noise processes set (`screen.price`)."""
        own, price = self.explanation.own, WORTHWHILE * self.explanation.noise.processes
        if not own:
            return price
        alone = search_from(self.explanation, ())
        return price + alone.screen.weigh(own).gain - alone.evidence(own)

    def score(self, inflation: float) -> float:
        """-2 log L plus the price; lower is better.

        Args:
            inflation: by which the correlation of the residual reduces the information of samples.
        """
        return self.explanation.deflated(inflation) + self.price

    @cached_property
    def best(self) -> tuple[int, ...]:
        """The set with the highest evidence in the screen."""
        return self.search.best()

    @cached_property
    def lawful(self) -> bool:
        """Whether an unnamed law has evidence: the residual test may not see it among many
        samples."""
        laws = laws_of(self.explanation.bodies)
        own = tuple(self.explanation.own)
        scores = search_from(self.explanation, (), laws).scores(own)
        return bool(scores) and scores[0].evidence > 0.0

    @cached_property
    def settled(self) -> bool:
        """Whether the residual is noise and the screen predicts no better set.

        Independent segments are tested by their residual alone.
        """
        if self.residual_test.doubtful:
            return False
        if not self.explanation.follows:
            return True
        return set(self.best) == set(self.explanation.own) and not self.lawful


def search_from(
    explanation: Explanation, candidates: Sequence[Candidate], laws: Sequence[Law] = ()
) -> Search:
    """The linear screen of an explanation's own causes and laws, candidates, and further laws."""
    price = unlikely(laws) if laws else 0.0
    parts = [*map(explanation.sized, candidates), *((law.perturbation,) for law in laws)]
    screen = explanation.weigh(
        parts, [*(candidate.trace for candidate in candidates), *(law.trace(price) for law in laws)]
    )
    return Search(screen, range(len(screen.traces)))


@dataclass(frozen=True)
class _Move:
    """A set to be fitted, starting from a state."""

    state: SearchState
    chosen: tuple[int, ...]

    @property
    def gain(self) -> float:
        """Evidence that the screen predicts."""
        search = self.state.search
        return search.evidence(self.chosen) - search.evidence(self.state.explanation.own)

    @property
    def key(self) -> frozenset[object]:
        """Identifies the set, whatever state its fit starts from."""
        state, first = self.state, len(self.state.explanation.own)
        candidates = [
            state.candidates[i - first]
            for i in self.chosen
            if first <= i < first + len(state.candidates)
        ]
        shaped = [candidate.effect for candidate in candidates if candidate.looked]
        labels = [state.search.screen.traces[index].label for index in self.chosen]
        base = (
            b""
            if state.explanation.follows or state.explanation.own
            else state.explanation.at.theta.tobytes()
        )
        return frozenset([*labels, *shaped, _noise_of(state.explanation), base])


class Engine:
    """The search for the set of causes that explains logs."""

    def __init__(self, candidates: Sequence[Candidate], say: Say) -> None:
        """Set up a search.

        Args:
            candidates: every cause that these logs may show, at its usual shape.
            say: receives the name of each step.
        """
        self.candidates = tuple(candidate for candidate in candidates if not candidate.effect.winds)
        self.shaken: tuple[Candidate, ...] = ()
        """Vibrations of sensors at the fast lines of the baseline's residual: candidates from the
        start, since other faults of that sensor would reproduce part of a line."""
        self.winding = tuple(candidate for candidate in candidates if candidate.effect.winds)
        """Candidates without a usual number of waves a turn: screened in the last stage only."""
        self.say = say
        self._barred: set[str] = set()
        self._seen: set[frozenset[object]] = set()
        self._named: SearchState | None = None
        self._baseline: Explanation | None = None
        self._inflation = np.inf
        self._laws_asked = False
        self._likeliest: dict[tuple[frozenset[str], tuple[bool, bool]], SearchState] = {}
        self._failed: set[frozenset[str]] = set()
        """Sets whose fits diverge from the logs, or that the machine cannot have in that size."""

    def explained(self, baseline: Explanation) -> SearchState:
        """Search from the baseline model; the best state."""
        self._begin(baseline)
        self.say("causes weighed")
        states = [self._state_of(explanation) for explanation in _starts(baseline)]
        beam = self._grown(states) if baseline.follows else self._single_causes(states[0])
        if not beam[0].settled:
            more = (
                self._with_noise_processes(baseline)
                if baseline.follows
                else self._grown([self._state_of(baseline)])
            )
            beam = self._best([*beam, *more])
        # a noise process can absorb an unnamed law, or what rings
        if not beam[0].settled or beam[0].explanation.noise.any:
            beam = self._widened(baseline, beam)
        return self._finished(self._verified(beam[0]))

    def onward(self, baseline: Explanation, segments: SearchState) -> SearchState | None:
        """Search on from the causes of independent segments, along one continuous motion, with
        noise processes where that leaves more than noise; None where no such fit converges."""
        if not segments.explanation.effects:
            return None
        try:
            explanation = explain(
                baseline.bodies,
                baseline.base,
                segments.explanation.effects,
                segments.explanation.at,
            )
        except TwinError:
            return None
        if not explanation.converged:
            return None
        self._begin(baseline)
        states = self._grown([self._state_of(explanation, segments.candidates)])
        if not states[0].settled:
            noisy = states[0].explanation.wandering()
            states = self._best([*states, *self._grown([self._state_of(noisy)])])
        return self._finished(self._verified(states[0]))

    def _begin(self, baseline: Explanation) -> None:
        self._seen.clear()
        self._likeliest.clear()
        self._failed.clear()
        self._named, self._baseline, self._inflation = None, baseline, np.inf
        self._laws_asked = False
        shaken = [item for item in self.candidates if isinstance(item.effect, VibrationEffect)]
        lines = [hertz for hertz in lines_of(baseline) if hertz > SETTINGS.shaken] if shaken else []
        self.shaken = ringing(shaken, lines, baseline.bodies)

    def _single_causes(self, state: SearchState) -> list[SearchState]:
        """Of independent segments: the best candidates fitted one at a time, until one leaves noise
        only."""
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
        """The best states with noise processes; none where the logs have no such noise.

        The search starts from the baseline. Where that ends without a cause, it starts from the
        best single one too: what wanders may take a cause's place where both were not fitted
        together.
        """
        self.say("noise processes")
        noisy = baseline.wandering()
        if not noisy.noise.any:
            return []
        states = self._grown([self._state_of(noisy)])
        single = [
            item.explanation
            for item in self._likeliest.values()
            if len(item.explanation.own) == 1 and item.explanation.converged
        ]
        if single and not states[0].explanation.own:
            best = min(single, key=lambda item: item.cost).wandering()
            states += self._grown([self._state_of(best)])
        return [state for state in states if state.explanation.noise.any]

    def _widened(self, baseline: Explanation, beam: list[SearchState]) -> list[SearchState]:
        """Search on with frequencies that stand out of the residual, with resonances at any
        frequency, with waves around a turn, and with unnamed laws."""
        self.say("frequencies and laws without a name")
        starts = (
            [beam[0]] if beam[0].explanation is baseline else [beam[0], self._state_of(baseline)]
        )
        anywhere = self._ringing_anywhere(baseline)
        wide: list[SearchState] = []
        for state in starts:
            lines = ringing(self.candidates, _lines_of(state), baseline.bodies)
            candidates = (
                *self.candidates,
                *self.shaken,
                *lines,
                *anywhere,
                *self._winding(state.explanation),
            )
            laws = tuple(laws_of(baseline.bodies)) if state.explanation.follows else ()
            wide.append(self._state_of(state.explanation, candidates, laws))
        return self._grown([*wide, *self._stepped(wide)])

    def _ringing_anywhere(self, baseline: Explanation) -> tuple[Candidate, ...]:
        """Each resonant cause at the frequency of the highest evidence beside the baseline:
        periodic commands excite a resonance at their harmonics, not at its own frequency."""
        if not baseline.follows or not baseline.converged:
            return ()
        scan = resonators(self.candidates, baseline.bodies)
        search, best = search_from(baseline, scan), dict[str, Candidate]()
        for score in search.scores():
            if search.pays(score):
                best.setdefault(scan[score.index].label, scan[score.index])
        return tuple(best.values())

    def _winding(self, explanation: Explanation) -> tuple[Candidate, ...]:
        """What makes waves around the turn of a hinge, at the numbers of waves of the highest
        evidence."""
        # an independent segment sees less than one of a few waves, which then replace a torque
        scan = winding(self.winding, explanation.bodies) if explanation.follows else ()
        if not scan:
            return ()
        search, first = search_from(explanation, scan), len(explanation.own)
        scores = (score for score in search.scores(explanation.own) if search.pays(score))
        return tuple(scan[score.index - first] for score in islice(scores, SETTINGS.singles))

    def _grown(self, beam: Sequence[SearchState]) -> list[SearchState]:
        """Beam search from states, until the best one settles or the screen predicts no gain."""
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
        """Fit the sets that the screen prefers to the best state, until one settles."""
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
        """Sets to fit from a state: those that the screen builds, then its own with one cause or
        law exchanged, where the screen prefers that."""
        yield from self._built(state)
        own = state.explanation.own
        for index in own if len(own) > 1 else ():
            for other, behind in state.search.instead(own, index)[:1]:
                if behind < 0.0:
                    yield _Move(state, (*without(own, index), other))

    def _built(self, state: SearchState) -> Iterator[_Move]:
        """Single causes with nearly the gain of the best set, the best set, and its strongest cause
        alone."""
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
            new, key=lambda i: search.evidence(chosen) - search.evidence(without(chosen, i))
        )
        for index in dict.fromkeys([strongest, *(singles if not own else ())]):
            yield _Move(state, (*kept, index))

    def _singles(self, state: SearchState, kept: tuple[int, ...]) -> list[int]:
        """Candidates of the highest evidence beside those kept, one for each label."""
        result: dict[str, int] = {}
        for score in state.search.scores(kept):
            if len(result) == SETTINGS.singles:
                break
            if state.search.pays(score):
                result.setdefault(state.search.screen.traces[score.index].label, score.index)
        return list(result.values())

    def _moved(self, move: _Move, best: SearchState) -> SearchState | None:
        """Fit a set; None where the machine cannot have it, or where the fit diverges from the
        logs."""
        state, explanation = move.state, move.state.explanation
        effects = guesses(explanation, state.candidates, state.search.screen, move.chosen)
        laws = _laws(state, move.chosen)
        names = sorted([*(item.label for item in effects), *(law.label for law in laws)])
        self.say("fitting " + ", ".join(names))
        lead = best.explanation if best.explanation.noise.white > 0.0 else explanation
        there = fitted(lead, effects, laws)
        if there is not None and there.laws:
            # the columns of the laws were formed along a motion without them
            there = followed(there, there.effects, there.laws) or there
        meant = effects if there is None else there.effects
        known = {effect.label for effect in explanation.effects}
        barred = {e.label for e in meant if e.label not in known and not _possible(explanation, e)}
        if there is None or barred or (lead is explanation and astray(explanation, there)):
            self._barred |= barred
            self._failed.add(frozenset(names))
            return None
        return self._state_of(there, state.candidates, state.laws)

    def _state_of(
        self,
        explanation: Explanation,
        candidates: Sequence[Candidate] = (),
        laws: Sequence[Law] = (),
    ) -> SearchState:
        candidates = tuple(
            candidate
            for candidate in candidates or (*self.candidates, *self.shaken)
            if candidate.label not in self._barred
        )
        state = SearchState(explanation, candidates, tuple(laws))
        self._inflation = min(self._inflation, explanation.account.inflation)
        if not explanation.laws and (
            self._named is None or self._score(state) < self._score(self._named)
        ):
            self._named = state
        key = _labels(explanation), _noise_of(explanation)
        self._likeliest[key] = min(self._likeliest.get(key, state), state, key=self._score)
        return state

    def _best(self, states: Iterable[SearchState]) -> list[SearchState]:
        """The states that the beam keeps."""
        return sorted(states, key=self._score)[: SETTINGS.beam]

    def _score(self, state: SearchState) -> float:
        """Score with the inflation of the best fit so far: the residual of a poor fit is correlated
        for longest. A state with a white torque is only a start, and scores last."""
        return np.inf if state.explanation.noise.white > 0.0 else state.score(self._inflation)

    def _promised(self, move: _Move) -> float:
        """The score that the screen predicts."""
        own = move.state.explanation.account.inflation
        return move.state.score(self._inflation) - move.gain * own / self._inflation

    def _verified(self, state: SearchState) -> SearchState:
        """Compare a state with unnamed laws alone, with refits without each cause, and with rivals
        of its only cause; the best of these."""
        while True:
            fewer = self._nameless(state) or self._laws_alone(state) or self.without_one(state)
            if fewer is None:
                fewer = self.against_rivals(state)
                if fewer.explanation is state.explanation:
                    return fewer
            state = self._grown([fewer])[0]

    def _nameless(self, state: SearchState) -> SearchState | None:
        """Unnamed laws alone; None where causes beside them have evidence.

        A cause can replace terms of an unnamed law. Beside such a law its prior is that of another
        law.
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

    def _laws_alone(self, state: SearchState) -> SearchState | None:
        """Unnamed laws in place of several causes; None where these are likelier.

        A cause that the catalogue lacks may be reproduced by several of it, each of which the logs
        then seem to show; one law costs less than they do.
        """
        explanation, baseline = state.explanation, self._baseline
        if self._laws_asked or explanation.laws or len(explanation.effects) < 2:
            return None
        if baseline is None or not baseline.follows or not baseline.converged:
            return None
        self._laws_asked = True
        bare = self._state_of(baseline, state.candidates, laws_of(baseline.bodies))
        first = len(bare.candidates)
        laws = range(first, first + len(bare.laws))
        chosen = Search(bare.search.screen, laws, bare.search.limit).best()
        there = self._moved(_Move(bare, chosen), state) if chosen else None
        if there is None or not self._score(there) < self._score(state):
            return None
        return there

    def without_one(self, state: SearchState) -> SearchState | None:
        """A refit without causes that it shows to be unnecessary, the weakest first; None where all
        are necessary."""
        explanation, search = state.explanation, state.search
        gain = {i: search.score(without(explanation.own, i), i).gain for i in explanation.own}
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
            # a cause that was added and dropped again may have moved the fit to another minimum
            there = min(self._of_labels(_labels(fewer)), key=self._score)
            rest = [gain[i] for i in explanation.own if i not in out]
            # the neglected response is that of the base, where any of it is fitted
            inexact = SETTINGS.inexact if len(explanation.at.theta) else 0.0
            spare = inexact * max(rest, default=0.0)
            cost = there.explanation.deflated(self._inflation) - explanation.deflated(
                self._inflation
            )
            lost = search.scored(out[0], cost, search.surplus(explanation.own, out[0]))
            chance = len(out) == 1 and not search.pays(lost) and not there.residual_test.doubtful
            if _no_worse(there.explanation, explanation):
                return there
            # of two sets that tie the smaller one; no cause whose interval contains 0
            if len(out) > 1 or all(_may_be_none(explanation, index) for index in out):
                spare += TIED
            if self._score(there) < self._score(state) + spare or chance:
                return there
        return None

    def _groups(self, state: SearchState, gain: Mapping[int, float]) -> list[tuple[int, ...]]:
        """Groups of causes and laws to refit without: all that the screen drops together, then each
        one, that of the least gain first; not each of a large set, whose fits take long."""
        search, own = state.search, state.explanation.own
        needed = Search(search.screen, own, search.limit).best()
        needless = tuple(index for index in own if index not in needed)
        single = len(own) <= CROWD or bool(state.explanation.laws)
        weakest = sorted(own, key=lambda i: gain[i]) if single else []
        return [*([needless] if needless else []), *((i,) for i in weakest if (i,) != needless)]

    def against_rivals(self, state: SearchState) -> SearchState:
        """The best of a set and of the sets with a rival in the place of a cause, each fitted: a
        rival's column along the motion with the cause predicts less than its fit gains. Of several
        causes, only rivals that the screen prefers are fitted."""
        explanation, search = state.explanation, state.search
        if not explanation.follows or explanation.laws or not explanation.effects:
            return state
        near = 0.0
        if len(explanation.effects) == 1:
            near = max(SETTINGS.near, SETTINGS.near_share * search.evidence(explanation.own))
        nearest: dict[tuple[int, str], tuple[int, ...]] = {}
        for index in explanation.own:
            for other, behind in search.instead(explanation.own, index):
                if behind < near and len(nearest) < SETTINGS.rivals:
                    rival = index, search.screen.traces[other].label
                    nearest.setdefault(rival, (*without(explanation.own, index), other))
        tried = [state]
        for chosen in nearest.values():
            there = self._moved(_Move(state, chosen), state)
            if there is not None and there.explanation.converged and there.explanation.effects:
                tried.append(there)
        return min(tried, key=self._score)

    def _finished(self, state: SearchState) -> SearchState:
        """The final state: screened by causes only, with the evidence of its unnamed laws and the
        scores of the other sets."""
        named = self._named
        beyond = 0.0
        if state.explanation.laws and named is not None:
            beyond = max(self._score(named) - self._score(state), 0.0)
        return replace(state, laws=(), nameless=beyond, others=self.others(state))

    def _of_labels(self, labels: frozenset[str]) -> list[SearchState]:
        """The likeliest fits of a set, one for each kind of noise."""
        return [item for (known, _), item in self._likeliest.items() if known == labels]

    def others(self, state: SearchState) -> dict[frozenset[str], float]:
        """Scores of other sets relative to a state: of its subsets under any noise processes, of
        the rest under those of the state; infinite where every fit fails."""
        own, lowest = _labels(state.explanation), self._score(state)
        result = {labels: np.inf for labels in self._failed if not labels < own}
        for (labels, noise), item in self._likeliest.items():
            alike = labels < own or noise == _noise_of(state.explanation)
            behind = self._score(item) - lowest
            # a fit that has not converged may still gain
            if alike and np.isfinite(behind) and (item.explanation.converged or behind > 0.0):
                result[labels] = min(result.get(labels, np.inf), behind)
        return result


def likeliest(baseline: Explanation, candidates: Sequence[Candidate]) -> Iterator[Explanation]:
    """The set of the highest evidence, fitted, then the best candidates one at a time."""
    search = search_from(baseline, candidates)
    alone = sorted(search.asked, key=lambda index: -search.screen.weigh((index,)).gain)[
        : SETTINGS.singles
    ]
    for chosen in (search.best(), *((index,) for index in alone)):
        result = fitted(baseline, guesses(baseline, candidates, search.screen, chosen))
        if result is not None:
            yield result


def _starts(baseline: Explanation) -> list[Explanation]:
    """Starts of the search: the baseline; where its fit does not converge, also one with a white
    torque. Independent segments start from the base as stated: a base fitted without a strong cause
    may be far from any machine's."""
    if baseline.follows:
        return [baseline] if baseline.converged else [baseline.disturbed(), baseline]
    at = replace(baseline.at, theta=baseline.base.as_stated)
    return [
        replace(
            baseline,
            prediction=independent_segments(baseline.problem, at, baseline.problem.exact(at)),
        )
    ]


def _lines_of(state: SearchState) -> tuple[float, ...]:
    """Frequencies that stand out of a residual [Hz]; of independent segments, those of which a
    segment holds a period: what is slower goes into the state at its start."""
    if state.explanation.follows:
        return state.residual_test.lines or slow_line_of(state.explanation)
    longest = max(body.grid.length for body in state.explanation.bodies)
    return tuple(hertz for hertz in state.residual_test.lines if hertz * longest > 1.0)


def _labels(explanation: Explanation) -> frozenset[str]:
    return frozenset(part.label for part in (*explanation.effects, *explanation.laws))


def _noise_of(explanation: Explanation) -> tuple[bool, bool]:
    """Whether anything wanders, and whether a sensor is noisier than stated."""
    return explanation.noise.wanders, bool(explanation.noise.scales)


def _few(state: SearchState, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """The causes of a set with the highest evidence, of at most `CROWD` kinds: larger sets take
    long to fit, and replace a cause that the catalogue lacks."""
    search = state.search
    worth = {i: search.evidence(chosen) - search.evidence(without(chosen, i)) for i in chosen}
    kept: tuple[int, ...] = ()
    for index in sorted(chosen, key=lambda i: -worth[i]):
        if len(_kinds(state, (*kept, index))) <= CROWD:
            kept = (*kept, index)
    return tuple(index for index in chosen if index in kept)


def _kinds(state: SearchState, chosen: Sequence[int]) -> set[str]:
    """Kinds of causes in a set; unnamed laws do not count."""
    parts = [
        *state.explanation.effects,
        *state.explanation.laws,
        *(candidate.effect for candidate in state.candidates),
        *state.laws,
    ]
    return {part.name for part in (parts[i] for i in chosen) if isinstance(part, Effect)}


def _strong(search: Search, chosen: tuple[int, ...], new: Sequence[int]) -> tuple[int, ...]:
    """New causes whose evidence is not small beside that of the strongest one."""
    whole = search.evidence(chosen)
    worth = {index: whole - search.evidence(without(chosen, index)) for index in new}
    most = max(worth.values())
    return tuple(index for index in new if worth[index] >= SETTINGS.weak * most)


def _laws(state: SearchState, chosen: Sequence[int]) -> list[Law]:
    """Unnamed laws in a set."""
    count, own = len(state.explanation.effects), len(state.explanation.own)
    first = own + len(state.candidates)
    return [
        state.explanation.laws[i - count] if i < own else state.laws[i - first]
        for i in chosen
        if count <= i < own or i >= first
    ]


def _no_worse(fewer: Explanation, explanation: Explanation) -> bool:
    """Whether independent segments without some causes run on as well as with them: segments that
    start anew forgive a cause that leads the motion astray."""
    if explanation.follows or fewer.follows:
        return False
    run = free_run(HORIZONS[0], fewer.account, explanation.account)
    return run is not None and run.errors[0] <= run.errors[1]


def _may_be_none(explanation: Explanation, index: int) -> bool:
    """Whether the interval of a cause's amplitudes contains 0."""
    if index >= len(explanation.effects):
        return False
    effect, free = explanation.effects[index], explanation.free[index]
    own, spread = amplitudes(effect)[free], explanation.covariances[index]
    values = effect.values[free][own]
    return not own.any() or distance(values, spread[np.ix_(own, own)]) < NORMAL


def _possible(explanation: Explanation, effect: Effect) -> bool:
    """Whether the machine can have the effect in that size."""
    platform = explanation.bodies[0].machine.platform
    try:
        compile_model(with_effects(able(platform, effect), (effect,)))
    except TwinError:
        return False
    return True


def guesses(
    explanation: Explanation,
    candidates: Sequence[Candidate],
    screen: LinearScreen,
    chosen: tuple[int, ...],
) -> list[Effect]:
    """The chosen effects, new ones at their linear estimates; without laws."""
    effects: list[Effect] = []
    for index, strength in zip(chosen, screen.weigh(chosen).strengths, strict=True):
        if index < len(explanation.effects):
            effects.append(explanation.effects[index])
        elif len(explanation.own) <= index < len(explanation.own) + len(candidates):
            effect = candidates[index - len(explanation.own)].effect
            strengths = strengths_of(effect)
            strengths[amplitudes(effect)] = strength
            effects.append(with_strengths(effect, strengths))
    return effects
