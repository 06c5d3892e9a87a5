"""Which causes and laws of an explanation the others have made needless."""

from twin.diagnose.explanation import Explanation
from twin.diagnose.fitting import CROWD, followed
from twin.diagnose.search import Search, less

SLIGHT = 0.1
"""Share of what the strongest cause gains, below which what columns promise of another one may be
the error of theirs: to fit the logs without a cause that they need takes long."""

INEXACT = 1e-4
"""Share of that which may be no more than the error of a motion with the strongest one in it: its
base's columns are those of a machine that does not answer to it."""


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
    slight = [i for i in gain if gain[i] < SLIGHT * strongest]
    for index in sorted(slight, key=lambda i: gain[i]):
        rest = [effect for place, effect in enumerate(now.effects) if place != index]
        fewer = followed(now, rest, now.laws)
        if fewer is None:
            continue
        lost = fewer.cost - now.cost
        if lost < INEXACT * strongest or not search.pays(search.scored(index, lost)):
            return fewer
    return None
