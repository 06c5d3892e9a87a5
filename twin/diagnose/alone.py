"""One cause fitted by itself, where columns promise several, or as much of others."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation
from twin.diagnose.fitting import fitted, followed, guesses
from twin.diagnose.line import Line, search_from
from twin.diagnose.remainder import remainder
from twin.diagnose.search import Search
from twin.effects import Effect
from twin.predict.whitening.apart import apart as linearised_apart

Say = Callable[[str], None]

LED = 4
"""Causes that are fitted alone, of those that promise most."""
NEARLY = 0.7
"""Share of what a cause gains from where on one that a fit may change is fitted in its place."""
UNMISTAKABLE = 2000.0
"""Gain of a cause that leaves nothing, from where on no other's shape is tried in its place: what
passes for noise is too little for another one to have gained nearly as much."""


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
