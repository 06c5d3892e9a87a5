"""From one explanation to a better one: what to add, what to drop, until nothing pays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.diagnose.candidates import Candidate, candidates_of
from twin.diagnose.explanation import Explanation
from twin.diagnose.laws import laws_of
from twin.diagnose.lines import lines_of
from twin.diagnose.remainder import Remainder, remainder
from twin.diagnose.search import TIED, Search
from twin.diagnose.weighing import Weighing
from twin.effects import Effect, able, with_effects
from twin.errors import TwinError
from twin.model import compile_model
from twin.predict.effect_columns import amplitudes, strengths_of, with_strengths

Say = Callable[[str], None]

ROUNDS = 4
"""Searches, each where the fit of the one before stands."""
DOUBTFUL = 0.01
"""Chance below which laws without a name are tried; and always where one cause did not do."""
NAMELESS = 6.0
"""-2 log of how probable a law without a name is beforehand, beside all those of the catalogue."""


@dataclass(frozen=True)
class Line:
    """Where a line of reasoning ends."""

    now: Explanation
    search: Search
    """Where it stands."""
    asked: tuple[Candidate, ...]
    """What it weighs beside the explanation's own parts."""
    left: Remainder
    nameless: float
    """Evidence that laws without a name brought beyond the catalogue's causes; 0 without any."""


def reason(plain: Explanation, asked: Sequence[Candidate], say: Say) -> Line:
    """From a model without causes to one that needs no more of them, and none of them less."""
    now, search, asked = searched(plain, asked, say)
    lines = lines_of(now) or lines_of(plain) if now.effects else lines_of(now)
    if lines:
        say("what rings")
        more = candidates_of(plain.bodies, lines).asked
        now, search, asked = searched(plain, more, say)
    say("what is left")
    left, evidence, before = remainder(now), 0.0, now
    # where nothing makes the motion follow a model, a law more would only bend to what is left
    if now.follows and (len(now.effects) > 1 or left.chance < DOUBTFUL):
        say("laws without a name")
        now, evidence = with_nameless(now)
    now = needed_only(now)
    if now is not before:
        left, search = remainder(now), search_from(now, asked)
    return Line(now, search, tuple(asked), left, evidence if now.laws else 0.0)


def searched(
    plain: Explanation, asked: Sequence[Candidate], say: Say
) -> tuple[Explanation, Search, Sequence[Candidate]]:
    """After searches and fits in turn, until the causes stay, or come back; what could be asked."""
    now = plain
    say("causes weighed")
    search = search_from(now, asked)
    seen = [frozenset[str]()]
    for _ in range(ROUNDS):
        chosen = search.best()
        labels = frozenset(search.weighing.traces[index].label for index in chosen)
        if labels in seen:
            break
        seen.append(labels)
        say("fitting " + ", ".join(sorted(labels)))
        guesses = _guesses(now, asked, search.weighing, chosen)
        try:
            now = now.instead(guesses)
        except TwinError:
            asked = _possible(now, asked, guesses)
        say("causes weighed")
        search = search_from(now, asked)
    return now, search, asked


def _possible(
    now: Explanation, asked: Sequence[Candidate], guesses: Sequence[Effect]
) -> tuple[Candidate, ...]:
    """Without those that no machine can have in the size that the logs ask for."""
    known = {effect.label for effect in now.effects}
    new = [effect for effect in guesses if effect.label not in known]
    barred = {effect.label for effect in new if not _possible_alone(now, effect)}
    barred = barred or {effect.label for effect in new}
    return tuple(one for one in asked if one.label not in barred)


def _possible_alone(now: Explanation, effect: Effect) -> bool:
    platform = now.bodies[0].machine.platform
    try:
        compile_model(with_effects(able(platform, effect), (effect,)))
    except TwinError:
        return False
    return True


def search_from(now: Explanation, asked: Sequence[Candidate]) -> Search:
    """Among an explanation's own parts and all that can be asked."""
    weighing = now.weighing(asked)
    return Search(weighing, range(len(weighing.traces)))


def _guesses(
    now: Explanation, asked: Sequence[Candidate], weighing: Weighing, chosen: tuple[int, ...]
) -> list[Effect]:
    """The chosen effects, new ones with their linearised strengths."""
    found: list[Effect] = []
    for index, own in zip(chosen, weighing.weigh(chosen).strengths, strict=True):
        if index < len(now.effects):
            found.append(now.effects[index])
            continue
        effect = asked[index - len(now.effects)].effect
        strengths = strengths_of(effect)
        strengths[amplitudes(effect)] = own
        found.append(with_strengths(effect, strengths))
    return found


def with_nameless(now: Explanation) -> tuple[Explanation, float]:
    """With laws without a name, where they explain more than causes: in place of some or beside.

    Returns:
        The explanation, and the evidence that the laws bring; as it was and 0 where they do not.
    """
    laws = laws_of(now.bodies)
    unlikely = NAMELESS + 2.0 * float(np.log(len(laws)))
    weighing = now.weigh(
        [(law.perturbation,) for law in laws], [law.trace(unlikely) for law in laws]
    )
    search = Search(weighing, range(len(weighing.traces)))
    chosen, own = search.best(), now.own
    found = [laws[index - len(own)] for index in chosen if index >= len(own)]
    more = search.evidence(chosen) - search.evidence(own)
    if not found or more < TIED:
        return now, 0.0
    kept = [effect for index, effect in enumerate(now.effects) if index in chosen]
    return now.instead(kept, found), more


def needed_only(now: Explanation) -> Explanation:
    """Without causes and laws that the others have made needless."""
    while now.own:
        weighing = now.weighing(())
        kept = Search(weighing, now.own).best()
        if len(kept) == len(now.own):
            break
        count = len(now.effects)
        effects = [effect for index, effect in enumerate(now.effects) if index in kept]
        laws = [law for index, law in enumerate(now.laws) if index + count in kept]
        now = now.instead(effects, laws)
    return now
