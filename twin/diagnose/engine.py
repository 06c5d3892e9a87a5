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
from twin.diagnose.remainder import Remainder, lines_of, remainder, slow_line_of
from twin.diagnose.screen import TIED, Search, less
from twin.effects import Effect, able, with_effects
from twin.errors import TwinError
from twin.identify.prediction_error import NORMAL, WORTHWHILE
from twin.model import compile_model
from twin.predict.apart import apart

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
class Line:
    """A state of the search: an explanation, and the screen where it stands."""

    now: Explanation
    asked: tuple[Candidate, ...] = ()
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
        return search_from(self.now, self.asked, self.laws)

    @cached_property
    def left(self) -> Remainder:
        """What it does not explain."""
        return remainder(self.now)

    @cached_property
    def price(self) -> float:
        """Of all that was set to have it so."""
        own, price = self.now.own, WORTHWHILE * self.now.noise.processes
        if not own:
            return price
        alone = search_from(self.now, ())
        return price + alone.weighing.weigh(own).gain - alone.evidence(own)

    def score(self, inflation: float) -> float:
        """-2 log L, where samples say so many times less than white noise does, and the price; the
        lower the better."""
        return self.now.deflated(inflation) + self.price

    @cached_property
    def best(self) -> tuple[int, ...]:
        """The set with the most evidence by the screen."""
        return self.search.best()

    @cached_property
    def lawful(self) -> bool:
        """Whether a law without a name would pay, which the sum of all residuals may not show."""
        laws = laws_of(self.now.bodies)
        own = tuple(self.now.own)
        scores = search_from(self.now, (), laws).scores(own)
        return bool(scores) and scores[0].evidence > 0.0

    @cached_property
    def settled(self) -> bool:
        """Whether it leaves no more than noise, and the screen has nothing better.

        What segments apart are screened by beside a cause is what the motion as a whole shows.
        """
        if self.left.doubtful:
            return False
        if not self.now.follows:
            return True
        return set(self.best) == set(self.now.own) and not self.lawful


def search_from(now: Explanation, asked: Sequence[Candidate], laws: Sequence[Law] = ()) -> Search:
    """Among an explanation's own parts and all that can be asked."""
    price = unlikely(laws) if laws else 0.0
    parts = [*map(now.sized, asked), *((law.perturbation,) for law in laws)]
    weighing = now.weigh(
        parts, [*(one.trace for one in asked), *(law.trace(price) for law in laws)]
    )
    return Search(weighing, range(len(weighing.traces)))


@dataclass(frozen=True)
class _Move:
    """A set to be fitted from where a state stands."""

    line: Line
    chosen: tuple[int, ...]

    @property
    def gain(self) -> float:
        """Evidence that the screen promises."""
        search = self.line.search
        return search.evidence(self.chosen) - search.evidence(self.line.now.own)

    @property
    def key(self) -> frozenset[object]:
        """Equal for sets that are the same but for where their fits begin."""
        line, first = self.line, len(self.line.now.own)
        asked = [line.asked[i - first] for i in self.chosen if first <= i < first + len(line.asked)]
        shaped = [(one.label, one.effect.values.tobytes()) for one in asked if one.looked]
        labels = [line.search.weighing.traces[index].label for index in self.chosen]
        base = b"" if line.now.follows or line.now.own else line.now.at.theta.tobytes()
        return frozenset([*labels, *shaped, line.now.noise.wanders, base])


class Engine:
    """The search for what explains logs."""

    def __init__(self, asked: Sequence[Candidate], say: Say) -> None:
        """Among candidates.

        Args:
            asked: all that the logs can be asked for, at their usual shapes.
            say: takes a sentence of what is being done.
        """
        self.asked = tuple(one for one in asked if not one.effect.winds)
        self.winding = tuple(one for one in asked if one.effect.winds)
        """Of which no number of waves is usual: asked for where something is left."""
        self.say = say
        self._barred: set[str] = set()
        self._seen: set[frozenset[object]] = set()
        self._named: Line | None = None
        self._plain: Explanation | None = None
        self._inflation = np.inf
        self._likeliest: dict[frozenset[str], Line] = {}

    def explained(self, plain: Explanation) -> Line:
        """From a model without causes to one that no other set of causes betters."""
        self._begin(plain)
        self.say("causes weighed")
        lines = [self._line(now) for now in _starts(plain)]
        beam = self._grown(lines) if plain.follows else self._single_causes(lines[0])
        if not beam[0].settled:
            more = (
                self._with_noise_processes(plain)
                if plain.follows
                else self._grown([self._line(plain)])
            )
            beam = self._best([*beam, *more])
        # what wanders passes for a law without a name, and for what rings
        if not beam[0].settled or beam[0].now.noise.any:
            beam = self._widened(plain, beam)
        return self._finished(self._verified(beam[0]))

    def onward(self, plain: Explanation, segments: Line) -> Line | None:
        """On from the causes that segments predicted apart have, along a motion that follows the
        model; None where that does not settle."""
        if not segments.now.effects:
            return None
        try:
            there = explain(plain.bodies, plain.base, segments.now.effects, segments.now.at)
        except TwinError:
            return None
        if not there.converged:
            return None
        self._begin(plain)
        line = self._line(there, segments.asked)
        return self._finished(self._verified(self._grown([line])[0]))

    def _begin(self, plain: Explanation) -> None:
        self._seen.clear()
        self._likeliest.clear()
        self._named, self._plain, self._inflation = None, plain, np.inf

    def _single_causes(self, line: Line) -> list[Line]:
        """Over segments apart: each of the few causes that promise most, fitted singly, up to one
        that leaves no more than noise. What it is worth there says only which to try."""
        states, tried = list[Line](), dict[str, int]()
        for score in line.search.scores():
            if len(tried) < SETTINGS.singles:
                tried.setdefault(line.search.weighing.traces[score.index].label, score.index)
        for index in tried.values():
            there = self._moved(_Move(line, (index,)), line)
            if there is not None:
                states.append(there)
                if there.settled:
                    break
        return self._best(states) or [line]

    def _with_noise_processes(self, plain: Explanation) -> list[Line]:
        """The best states whose noise wanders; none where it does not."""
        self.say("noise processes")
        noisy = plain.wandering()
        if not noisy.noise.any:
            return []
        return [line for line in self._grown([self._line(noisy)]) if line.now.noise.any]

    def _widened(self, plain: Explanation, beam: list[Line]) -> list[Line]:
        """On, asked also for frequencies that stand out, for what may ring anywhere, and for laws
        without a name."""
        self.say("frequencies and laws without a name")
        starts = [beam[0]] if beam[0].now is plain else [beam[0], self._line(plain)]
        anywhere = self._ringing_anywhere(plain)
        wide: list[Line] = []
        for line in starts:
            hertz = lines_of(line.now) or slow_line_of(line.now)
            lines = ringing(self.asked, hertz, plain.bodies)
            asked = (*self.asked, *lines, *anywhere, *self._winding(line.now))
            laws = tuple(laws_of(plain.bodies)) if line.now.follows else ()
            wide.append(self._line(line.now, asked, laws))
        return self._grown([*wide, *self._stepped(wide)])

    def _ringing_anywhere(self, plain: Explanation) -> tuple[Candidate, ...]:
        """Of each cause that rings, where beside nothing else it promises most: where commands
        repeat, it leaves lines at their harmonics, not at its own frequency."""
        if not plain.follows or not plain.converged:
            return ()
        scan = resonators(self.asked, plain.bodies)
        search, best = search_from(plain, scan), dict[str, Candidate]()
        for score in search.scores():
            if search.pays(score):
                best.setdefault(scan[score.index].label, scan[score.index])
        return tuple(best.values())

    def _winding(self, now: Explanation) -> tuple[Candidate, ...]:
        """Of what makes waves around the turn of a hinge, the numbers of them that promise most."""
        # a few waves that a segment apart sees no whole one of stand in for a torque
        scan = winding(self.winding, now.bodies) if now.follows else ()
        if not scan:
            return ()
        search, first = search_from(now, scan), len(now.own)
        scores = (score for score in search.scores(now.own) if search.pays(score))
        return tuple(scan[score.index - first] for score in islice(scores, SETTINGS.singles))

    def _grown(self, beam: Sequence[Line]) -> list[Line]:
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

    def _stepped(self, states: Sequence[Line]) -> Iterator[Line]:
        """The sets that promise more than the best state has, fitted; up to one that settles."""
        best = min(map(self._score, states))
        for line in states:
            for move in self._moves(line):
                crowd = len(_kinds(line, move.chosen)) > CROWD
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

    def _moves(self, line: Line) -> Iterator[_Move]:
        """Those worth a fit from where a state stands: single causes that gain nearly as much as a
        whole set, the set, and what is strongest in it."""
        search, own = line.search, set(line.now.own)
        chosen = _few(line, line.best)
        kept = tuple(index for index in chosen if index in own)
        new = [index for index in chosen if index not in own]
        if len(new) <= 1:
            if set(chosen) != own:
                yield _Move(line, chosen)
            if line.left.doubtful:
                yield from (_Move(line, (*kept, index)) for index in self._singles(line, kept))
            return
        gain = search.weighing.weigh
        threshold = SETTINGS.nearly * (gain(chosen).gain - gain(kept).gain)
        singles = self._singles(line, kept)
        first = [i for i in singles if gain((*kept, i)).gain - gain(kept).gain >= threshold]
        yield from (_Move(line, (*kept, index)) for index in first)
        yield _Move(line, (*kept, *_strong(search, chosen, new)))
        strongest = max(
            new, key=lambda i: search.evidence(chosen) - search.evidence(less(chosen, i))
        )
        for index in dict.fromkeys([strongest, *(singles if not own else ())]):
            yield _Move(line, (*kept, index))

    def _singles(self, line: Line, kept: tuple[int, ...]) -> list[int]:
        """Causes that promise most beside those that are kept, one of each label."""
        found: dict[str, int] = {}
        for score in line.search.scores(kept):
            if len(found) == SETTINGS.singles:
                break
            if line.search.pays(score):
                found.setdefault(line.search.weighing.traces[score.index].label, score.index)
        return list(found.values())

    def _moved(self, move: _Move, best: Line) -> Line | None:
        """Fitted; None where no machine can have it, or where the fit loses the motion."""
        line, now = move.line, move.line.now
        effects = guesses(now, line.asked, line.search.weighing, move.chosen)
        laws = _laws(line, move.chosen)
        names = sorted([*(one.label for one in effects), *(law.label for law in laws)])
        self.say("fitting " + ", ".join(names))
        lead = best.now if best.now.noise.white > 0.0 else now
        there = fitted(lead, effects, laws)
        if there is not None and there.laws:
            # their columns were formed along a motion that lacked them
            there = followed(there, there.effects, there.laws) or there
        meant = effects if there is None else there.effects
        known = {effect.label for effect in now.effects}
        barred = {e.label for e in meant if e.label not in known and not _possible(now, e)}
        if there is None or barred:
            self._barred |= barred
            return None
        if lead is now and astray(now, there):
            return None
        return self._line(there, line.asked, line.laws)

    def _line(
        self, now: Explanation, asked: Sequence[Candidate] = (), laws: Sequence[Law] = ()
    ) -> Line:
        asked = tuple(one for one in asked or self.asked if one.label not in self._barred)
        line = Line(now, asked, tuple(laws))
        self._inflation = min(self._inflation, now.account.inflation)
        if not now.laws and (self._named is None or self._score(line) < self._score(self._named)):
            self._named = line
        known = self._likeliest.setdefault(_labels(now), line)
        self._likeliest[_labels(now)] = min(known, line, key=self._score)
        return line

    def _best(self, lines: Iterable[Line]) -> list[Line]:
        """Those that go on."""
        return sorted(lines, key=self._score)[: SETTINGS.beam]

    def _score(self, line: Line) -> float:
        """All by one inflation, that of the best: what a poor fit leaves has the longest memory. A
        white torque only leads a motion to the logs, and scores last."""
        return np.inf if line.now.noise.white > 0.0 else line.score(self._inflation)

    def _promised(self, move: _Move) -> float:
        """The score that the screen promises."""
        own = move.line.now.account.inflation
        return move.line.score(self._inflation) - move.gain * own / self._inflation

    def _verified(self, line: Line) -> Line:
        """Against laws without a name in place of causes beside such laws, refits without each of
        its causes, and rivals in its only one's place."""
        while True:
            fewer = self._nameless(line) or self.without_one(line)
            if fewer is None:
                best = self.against_rivals(line)
                if best.now is line.now:
                    return best
                fewer = replace(best, rivals={})
            line = self._grown([fewer])[0]

    def _nameless(self, line: Line) -> Line | None:
        """Laws without a name alone; None where causes beside them bring more.

        A cause may stand in for the terms of a law: beside one it is no likelier beforehand than
        another law.
        """
        if not line.now.laws or not line.now.effects:
            return None
        first = len(line.now.own) + len(line.asked)
        laws = [*line.now.own[len(line.now.effects) :], *range(first, first + len(line.laws))]
        chosen = Search(line.search.weighing, laws, line.search.limit).best()
        there = self._moved(_Move(line, chosen), line) if chosen else None
        spare = TIED + unlikely(line.laws) * len(line.now.effects)
        if there is None or self._score(there) > self._score(line) + spare:
            return None
        return there

    def without_one(self, line: Line) -> Line | None:
        """Without what a refit shows to be needless, the weakest first; None if all is needed."""
        now, search = line.now, line.search
        gain = {i: search.score(less(now.own, i), i).gain for i in now.own}
        for out in self._groups(line, gain):
            effects = [effect for i, effect in enumerate(now.effects) if i not in out]
            laws = [law for i, law in enumerate(now.laws, len(now.effects)) if i not in out]
            labels = ", ".join(search.weighing.traces[index].label for index in out)
            self.say(f"fitting without {labels}")
            bare = None if effects or laws or now.noise.any else self._plain
            fewer = bare or followed(now, effects, laws)
            if fewer is None:
                continue
            there = self._line(fewer, line.asked, line.laws)
            # what was added and is dropped again may have led the fit away
            there = min(there, self._likeliest[_labels(fewer)], key=self._score)
            left = [gain[i] for i in now.own if i not in out]
            spare = SETTINGS.inexact * max(left, default=0.0)
            cost = there.now.deflated(self._inflation) - now.deflated(self._inflation)
            lost = search.scored(out[0], cost)
            chance = len(out) == 1 and not search.pays(lost) and not there.left.doubtful
            # of two sets that tie the smaller one, and none of what may be none
            if len(out) > 1 or all(_may_be_none(now, index) for index in out):
                spare += TIED
            if self._score(there) < self._score(line) + spare or chance:
                return there
        return None

    def _groups(self, line: Line, gain: Mapping[int, float]) -> list[tuple[int, ...]]:
        """What a state is held against refits without: all that its columns show to be needless,
        then each cause and law, that of the least gain first; none of a crowd, whose every fit is
        long."""
        search, own = line.search, line.now.own
        needed = Search(search.weighing, own, search.limit).best()
        needless = tuple(index for index in own if index not in needed)
        single = len(own) <= CROWD or bool(line.now.laws)
        weakest = sorted(own, key=lambda i: gain[i]) if single else []
        return [*([needless] if needless else []), *((i,) for i in weakest if (i,) != needless)]

    def against_rivals(self, line: Line) -> Line:
        """The better of an only cause and its rivals, each fitted in its place: the columns of
        those are formed along the motion that has the cause, and promise less than their fits.

        What comes of it knows how far behind each of the others is.
        """
        now, search = line.now, line.search
        if not now.follows or now.laws or len(now.effects) != 1:
            return line
        nearest: dict[str, int] = {}
        near = max(SETTINGS.near, SETTINGS.near_share * search.evidence(now.own))
        for other, behind in search.instead(now.own, 0):
            if behind < near and len(nearest) < SETTINGS.rivals:
                nearest.setdefault(search.weighing.traces[other].label, other)
        tried = {now.effects[0].label: line}
        for label, other in nearest.items():
            there = self._moved(_Move(line, (other,)), line)
            if there is not None and there.now.converged and there.now.effects:
                tried[label] = there
        best = min(tried.values(), key=self._score)
        lowest = self._score(best)
        behind = {label: self._score(one) - lowest for label, one in tried.items()}
        return replace(best, rivals=behind)

    def _finished(self, line: Line) -> Line:
        """Screened by causes only, and with what its laws bring beyond them."""
        named = self._named
        beyond = 0.0
        if line.now.laws and named is not None:
            beyond = max(self._score(named) - self._score(line), 0.0)
        return replace(line, laws=(), nameless=beyond)


def likeliest(plain: Explanation, asked: Sequence[Candidate]) -> Iterator[Explanation]:
    """The set of causes that promises most, fitted, and each of a few that promise most alone."""
    search = search_from(plain, asked)
    alone = sorted(search.asked, key=lambda index: -search.weighing.weigh((index,)).gain)[
        : SETTINGS.singles
    ]
    for chosen in (search.best(), *((index,) for index in alone)):
        found = fitted(plain, guesses(plain, asked, search.weighing, chosen))
        if found is not None:
            yield found


def _starts(plain: Explanation) -> list[Explanation]:
    """Where the search begins: at a model without causes; where that loses the motion, also at one
    that a white torque leads to the logs; over segments apart with the base as stated, for one that
    was fitted without a strong cause may be no machine's."""
    if plain.follows:
        return [plain] if plain.converged else [plain.disturbed(), plain]
    at = replace(plain.at, theta=plain.base.as_stated)
    return [replace(plain, now=apart(plain.problem, at, plain.problem.exact(at)))]


def _labels(now: Explanation) -> frozenset[str]:
    return frozenset(part.label for part in (*now.effects, *now.laws))


def _few(line: Line, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Of a set the causes that bring most, as many kinds as an answer may have: a crowd takes long
    to fit, and stands in for something else."""
    search = line.search
    worth = {i: search.evidence(chosen) - search.evidence(less(chosen, i)) for i in chosen}
    kept: tuple[int, ...] = ()
    for index in sorted(chosen, key=lambda i: -worth[i]):
        if len(_kinds(line, (*kept, index))) <= CROWD:
            kept = (*kept, index)
    return tuple(index for index in chosen if index in kept)


def _kinds(line: Line, chosen: Sequence[int]) -> set[str]:
    """Of the causes in a set; a law without a name is of none."""
    parts = [*line.now.effects, *line.now.laws, *(one.effect for one in line.asked), *line.laws]
    return {part.name for part in (parts[i] for i in chosen) if isinstance(part, Effect)}


def _strong(search: Search, chosen: tuple[int, ...], new: Sequence[int]) -> tuple[int, ...]:
    """Of new causes those that need not wait until a far stronger one is fitted."""
    whole = search.evidence(chosen)
    worth = {index: whole - search.evidence(less(chosen, index)) for index in new}
    most = max(worth.values())
    return tuple(index for index in new if worth[index] >= SETTINGS.weak * most)


def _laws(line: Line, chosen: Sequence[int]) -> list[Law]:
    """Of a set."""
    count, own = len(line.now.effects), len(line.now.own)
    first = own + len(line.asked)
    return [
        line.now.laws[i - count] if i < own else line.laws[i - first]
        for i in chosen
        if count <= i < own or i >= first
    ]


def _may_be_none(now: Explanation, index: int) -> bool:
    """Whether the interval of a cause's amplitudes holds none of it."""
    if index >= len(now.effects):
        return False
    effect, free = now.effects[index], now.free[index]
    return in_sigmas([effect], [free], [now.covariances[index]]) < NORMAL


def _possible(now: Explanation, effect: Effect) -> bool:
    """Whether the machine can have it in that size."""
    platform = now.bodies[0].machine.platform
    try:
        compile_model(with_effects(able(platform, effect), (effect,)))
    except TwinError:
        return False
    return True
