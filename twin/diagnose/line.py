"""A line of reasoning: an explanation, what is weighed from there, and what it is held against.

A cause is fitted by itself where columns promise several, or as much of others; of an explanation
what the others have made needless is dropped; an only cause is held against rivals that are fitted
in its place, for along the motion that has it their columns promise less than their fits; and what
rings as commands repeat, at whatever frequency, is fitted alone, for what a model leaves then has
lines at the harmonics of the commands.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from twin.diagnose.candidates import Candidate, candidate, looked_among, resonators
from twin.diagnose.explanation import Explanation
from twin.diagnose.fitting import CROWD, fitted, followed, guesses
from twin.diagnose.laws import laws_of, unlikely
from twin.diagnose.remainder import Remainder, remainder
from twin.diagnose.screen import Search, less
from twin.effects import Effect
from twin.identify.prediction_error import WORTHWHILE
from twin.predict.apart import apart as linearised_apart

Say = Callable[[str], None]
LED = 4
"""Causes that are fitted alone, of those that promise most."""
NEARLY = 0.7
"""Share of what a cause gains from where on one that a fit may change is fitted in its place."""
UNMISTAKABLE = 2000.0
"""Gain of a cause that leaves nothing, from where on no other's shape is tried in its place: what
passes for noise is too little for another one to have gained nearly as much."""
MINOR = 0.1
"""Share of what the strongest cause gains, below which what columns promise of another one may be
the error of theirs: to fit the logs without a cause that they need takes long."""
INEXACT = 1e-4
"""Share of that which may be no more than the error of a motion with the strongest one in it: its
base's columns are those of a machine that does not answer to it."""
NEAR, NEAR_SHARE = 12.0, 0.05
"""Evidence by which a rival may be behind to be worth a fit; and its share of the cause's own,
where that is more: columns may err by as much."""
RIVALS = 3
"""Rivals that are fitted, the nearest."""
RINGS = 0.2
"""Share of what others promise that such a thing must promise to be fitted: shapes between those
that are asked, and pivots elsewhere, gain the rest."""


@dataclass(frozen=True)
class Line:
    """Where a line of reasoning ends."""

    now: Explanation
    search: Search
    """Where it stands."""
    asked: tuple[Candidate, ...]
    """What it weighs beside the explanation's own parts."""
    nameless: float = 0.0
    """Evidence that laws without a name brought beyond the catalogue's causes; 0 without any."""
    rivals: Mapping[str, float] = field(default_factory=dict[str, float])
    """By how much causes that were fitted in an only one's place are behind, by label."""

    @cached_property
    def left(self) -> Remainder:
        """What it does not explain."""
        return remainder(self.now)

    @property
    def score(self) -> float:
        """-2 log L, and the price of all that was set to have it so; the lower the better."""
        own = self.now.own
        price = self.search.weighing.weigh(own).gain - self.search.evidence(own)
        if self.now.laws:
            price += len(self.now.laws) * unlikely(laws_of(self.now.bodies))
        price += WORTHWHILE * self.now.noise.processes
        return self.now.cost + price


def search_from(now: Explanation, asked: Sequence[Candidate]) -> Search:
    """Among an explanation's own parts and all that can be asked."""
    weighing = now.weighing(asked)
    return Search(weighing, range(len(weighing.traces)))


def likeliest(plain: Explanation, asked: Sequence[Candidate]) -> Iterator[Explanation]:
    """The set of causes that promises most, fitted, and each of a few that promise most alone."""
    search = search_from(plain, asked)
    alone = sorted(search.asked, key=lambda index: -search.weighing.weigh((index,)).gain)[:LED]
    for chosen in (search.best(), *((index,) for index in alone)):
        found = fitted(plain, guesses(plain, asked, search.weighing, chosen))
        if found is not None:
            yield found


def sole(plain: Explanation, search: Search, asked: tuple[Candidate, ...], say: Say) -> Line | None:
    """A cause that no other is mistaken for, fitted alone where columns promise it others beside.

    What it lacks where its columns were formed, and not what rings or has no name, is then what
    several causes stand in for, and none of that need be asked.
    """
    chosen = search.best()
    if len(chosen) < 2 or not plain.follows:
        return None
    gain = {index: search.weighing.weigh((index,)).gain for index in chosen}
    best = max(chosen, key=lambda index: gain[index])
    if gain[best] < max(UNMISTAKABLE, NEARLY * search.weighing.weigh(chosen).gain):
        return None
    (guess,) = guesses(plain, asked, search.weighing, (best,))
    say(f"fitting {guess.label} alone")
    alone = followed(plain, (guess,))
    if alone is None or remainder(alone).doubtful:
        return None
    say("causes weighed")
    return Line(alone, search_from(alone, asked), asked)


def only(apart: Explanation, asked: Sequence[Candidate], say: Say) -> Line | None:
    """Of segments apart the first of the likeliest causes that leaves nothing by itself.

    From the base as stated: one that was fitted without a strong cause may be no machine's, and
    lead nowhere. What a cause is worth there says only which to try.
    """
    if not remainder(apart).doubtful:
        return None
    near = _as_stated(apart)
    return settling(near, search_from(near, asked), asked, say)


def settling(now: Explanation, search: Search, asked: Sequence[Candidate], say: Say) -> Line | None:
    """Of the few causes that promise most, the first that leaves nothing when it is fitted alone;
    None where none does."""
    tries: dict[str, Effect] = {}
    for score in search.scores():
        if len(tries) < LED:
            (guess,) = guesses(now, asked, search.weighing, (score.index,))
            tries.setdefault(guess.label, guess)
    for label, guess in tries.items():
        say(f"fitting {label} alone")
        there = followed(now, (guess,))
        if there is not None and not remainder(there).doubtful:
            return Line(there, search_from(there, asked), tuple(asked))
    return None


def _as_stated(apart: Explanation) -> Explanation:
    at = replace(apart.at, theta=apart.base.as_stated)
    return replace(apart, now=linearised_apart(apart.problem, at, apart.problem.exact(at)))


def needed_only(now: Explanation, limit: float) -> Explanation:
    """Without those that gain no more than noise may.

    A column promises it, and a fault of a clock that jumps does not keep it; or what it leads to is
    so far from the motion without it that only a fit of that shows how little it is needed.

    Args:
        now: where the reasoning stands.
        limit: surprise that noise reaches in a false alarm.
    """
    while now.own:
        search = Search(now.weighing(()), now.own, limit)
        fewer = _without_needless(now, search) or _without_one(now, search)
        if fewer is None:
            break
        now = fewer
    return now


def _without_needless(now: Explanation, search: Search) -> Explanation | None:
    """Fitted without all that its columns say it can do without."""
    kept = search.best()
    if len(kept) == len(now.own):
        return None
    count = len(now.effects)
    effects = [effect for index, effect in enumerate(now.effects) if index in kept]
    laws = [law for index, law in enumerate(now.laws) if index + count in kept]
    return followed(now, effects, laws)


def _without_one(now: Explanation, search: Search) -> Explanation | None:
    """Fitted without the weakest cause whose absence a fit makes good, of those that are slight
    beside the strongest; none of a crowd, which stands in for something else anyway."""
    if not 1 < len(now.effects) <= CROWD:
        return None
    gain = {i: search.score(less(now.own, i), i).gain for i in range(len(now.effects))}
    strongest = max(gain.values())
    slight = [i for i in gain if gain[i] < MINOR * strongest]
    for index in sorted(slight, key=lambda i: gain[i]):
        rest = [effect for place, effect in enumerate(now.effects) if place != index]
        fewer = followed(now, rest, now.laws)
        if fewer is None:
            continue
        lost = fewer.cost - now.cost
        if lost < INEXACT * strongest or not search.pays(search.scored(index, lost)):
            return fewer
    return None


def against_rivals(line: Line) -> Line:
    """The better of an only cause and its rivals, knowing how far behind each of the others is."""
    now = line.now
    if len(now.effects) != 1 or now.laws or not now.follows:
        return line
    nearest: dict[str, int] = {}
    near = max(NEAR, NEAR_SHARE * line.search.evidence(now.own))
    for other, behind in line.search.instead(now.own, 0):
        if behind < near and len(nearest) < RIVALS:
            nearest.setdefault(line.search.weighing.traces[other].label, other)
    fitted = {now.effects[0].label: line}
    for label, other in nearest.items():
        there = followed(now, guesses(now, line.asked, line.search.weighing, (other,)))
        if there is not None and there.converged and there.effects:
            fitted[label] = Line(there, search_from(there, ()), line.asked)
    best = min(fitted.values(), key=lambda one: one.score)
    if best is not line:
        best = replace(best, search=search_from(best.now, line.asked))
    behind = {label: one.score - best.score for label, one in fitted.items()}
    return replace(best, rivals=behind)


def resonating(
    plain: Explanation, promised: float, asked: Sequence[Candidate]
) -> tuple[Explanation | None, tuple[Candidate, ...]]:
    """The likeliest such cause, fitted, if it leaves no more than noise; else None.

    Args:
        plain: the model without causes.
        promised: evidence that others have.
        asked: what the logs can be asked for.

    Returns:
        That, and each kind of cause that was fitted, to be asked for in the shape that it has then.
    """
    scan = resonators(asked, plain.bodies)
    search = search_from(plain, scan)
    best: dict[str, int] = {}
    for score in search.scores():
        if search.pays(score) and score.evidence > RINGS * promised:
            best.setdefault(scan[score.index - len(plain.own)].label, score.index)
    found: list[Line] = []
    for index in best.values():
        there = followed(plain, guesses(plain, scan, search.weighing, (index,)))
        if there is not None and not remainder(there).doubtful:
            found.append(Line(there, search_from(there, ()), ()))
    likeliest = min(found, key=lambda line: line.score, default=None)
    platform, looked = plain.base.machine.platform, looked_among(plain.bodies)
    shapes = tuple(
        replace(candidate(effect.absent(), platform), looked=looked)
        for line in found
        for effect in line.now.effects
    )
    return None if likeliest is None else likeliest.now, shapes
