"""From one explanation to a better one: what to add, what to drop, until nothing pays.

No real log leaves white noise: without room for what wanders, a search gives it the names of causes
and calls the whole unexplained. So noise processes are fitted beside base and causes, in each fit
anew, and a cause has to beat what a wander makes of the same logs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from twin.diagnose.candidates import Candidate, resonators, ringing
from twin.diagnose.explanation import Explanation, explain
from twin.diagnose.fitting import CROWD, astray, fitted, followed, guesses
from twin.diagnose.laws import RARE, laws_of, unlikely
from twin.diagnose.line import (
    LED,
    NEARLY,
    UNMISTAKABLE,
    Line,
    needed_only,
    resonating,
    search_from,
    settling,
    sole,
)
from twin.diagnose.remainder import lines_of, remainder, slow_line_of
from twin.diagnose.screen import TIED, Search, less
from twin.effects import BodyEffect, Effect, able, with_effects
from twin.errors import TwinError
from twin.model import compile_model
from twin.predict.columns import of_drive
from twin.predict.kalman import EXACT, Noise

Say = Callable[[str], None]
ROUNDS = 6
"""Searches, each where the fit of the one before stands."""
DRAUGHT = 3e-4
"""Torque of the draughts of a room on a platform [N m], rms: 1 mN at 0.3 m."""
STRAYING = {
    "attitude": 0.01,
    "joint_angle": 0.01,
    "inclinometer": 0.01,
    "gyro": 1e-3,
    "joint_rate": 1e-3,
    "accelerometer": 0.05,
    "magnetometer": 1e-6,
}
"""Errors that sensors have however well they are calibrated, rms (SI): a vertical reference of half
a degree, a gyro bias of 200 deg/h, an accelerometer bias of 5 mg."""
WEAK = 0.03
"""Share of another's evidence that may be no more than the error of its linearised column."""
WANDERS = 200.0
"""-2 log L that noise processes gain, from where on they are no weak cause's that was missed."""
ROUGH = 1.5
"""Chi-square a sample beyond which no cause has made the motion follow the model. The logs are then
predicted in segments apart, and what they say counts for less."""
SHADOW = RARE + TIED
"""What a cause beside such laws must bring, or it is taken for a part of them: what has no name may
well have several terms, and is nameless once."""


def beside_wander(plain: Explanation, asked: Sequence[Candidate], say: Say) -> Line | None:
    """The causes of logs whose noise wanders; None where it does not beside the causes,
    or where more than that is left.

    Args:
        plain: the model without causes, of a motion that follows it.
        asked: all that can be asked for.
        say: told what is being done.
    """
    if not plain.follows:
        return None
    say("noise that wanders")
    now = plain.wandering()
    if not now.noise.any:
        return None
    first = line = Line(now, search_from(now, asked), tuple(asked))
    seen = {frozenset[str]()}
    for _ in range(ROUNDS):
        chosen = line.search.best()
        chosen = _first(line, chosen)
        labels = frozenset(line.search.weighing.traces[index].label for index in chosen)
        if labels in seen:
            break
        seen.add(labels)
        say("fitting " + ", ".join(sorted(labels)))
        tried = followed(line.now, guesses(line.now, asked, line.search.weighing, chosen))
        if tried is None:
            break
        there = Line(tried, search_from(tried, asked), tuple(asked))
        if there.score > line.score:
            break
        line = there
    line = _reduced(line, first, say)
    return line if line.now.noise.any and not line.left.doubtful else None


def _first(line: Line, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Of new causes the strongest only: the noise without it is another one."""
    new = [index for index in chosen if index >= len(line.now.own)]
    if len(new) < 2:
        return chosen
    worth = {i: line.search.evidence(chosen) - line.search.evidence(less(chosen, i)) for i in new}
    most = max(new, key=lambda index: worth[index])
    return tuple(index for index in chosen if index < len(line.now.own) or index == most)


def _reduced(line: Line, first: Line, say: Say) -> Line:
    """Without the causes that a fit without them makes good; `first` is that without any."""
    while line.now.effects:
        tries = [first] if len(line.now.effects) == 1 else _with_one_less(line, say)
        best = min(tries, key=lambda one: one.score, default=None)
        if best is None or best.score > line.score:
            break
        line = best
    return line


def _with_one_less(line: Line, say: Say) -> list[Line]:
    """Fitted without each of the causes in turn, where that keeps the motion."""
    found: list[Line] = []
    for effect in line.now.effects:
        say(f"fitting without {effect.label}")
        fewer = followed(line.now, [other for other in line.now.effects if other is not effect])
        if fewer is not None:
            found.append(Line(fewer, search_from(fewer, line.asked), line.asked))
    return found


def ordinary(noise: Noise) -> bool:
    """Whether all that wanders is inside what rooms and sensors of such laboratories have."""
    torque = 0.0 if noise.torque is None else noise.torque.rms
    return torque <= DRAUGHT and all(
        one.rms <= STRAYING.get(stream, np.inf) for stream, one in noise.errors
    )


def gained_by(now: Explanation) -> float:
    """-2 log L that the noise processes of an explanation gain beside its causes."""
    return now.problem.whiten(now.at, now.now.exact, EXACT).cost - now.cost


def carried(plain: Explanation, now: Explanation) -> float:
    """Share of the excess of the squared residual of a model without causes that its causes take;
    what wanders takes the rest. NaN where segments are predicted apart."""
    if not (plain.follows and now.follows):
        return np.nan
    with_causes = now.problem.whiten(now.at, now.now.exact, EXACT)
    left = with_causes.residual + with_causes.columns @ with_causes.step()
    excess = plain.now.residual @ plain.now.residual - plain.samples
    return float(np.clip(1.0 - (left @ left - now.samples) / max(excess, 1.0), 0.0, 1.0))


def reason(plain: Explanation, asked: Sequence[Candidate], say: Say) -> Line:
    """From a model without causes to one that needs no more of them, and none of them less."""
    every = tuple(asked)
    say("causes weighed")
    search = search_from(plain, every)
    lost = plain.follows and not plain.converged
    line = (_led if lost else sole)(plain, search, every, say)
    rung, sought, wandering, begun = None, False, None, None
    if not lost and (line is None or line.left.doubtful):
        # a crowd takes long to fit, and stands in for something else
        begun = _searched(plain, search, every, say) if len(search.best()) <= CROWD else None
        if begun is None or begun.left.doubtful:
            wandering = beside_wander(plain, every, say)
        if wandering is not None and begun is None and not wandering.now.effects:
            # it passes for any cause that moves slowly, and a crowd for one whose columns bend
            line = settling(plain, search, every, say)
        if wandering is not None and _is_wander(wandering):
            rivals = [one for one in (begun, line) if one is not None]
            if all(wandering.score <= one.score for one in rivals):
                return wandering
    if line is None or line.left.doubtful:
        # what rings or blows at another frequency than usual looks like many causes
        several = len(search.best()) > 1
        lines = (*lines_of(plain), *slow_line_of(plain)) if several else ()
        if lines:
            every, begun = (*every, *ringing(asked, lines, plain.bodies)), None
            wider = search_from(plain, every)
            # the strongest at first may be the one whose set is the worse
            better = wider.evidence(wider.best()) > search.evidence(search.best())
            search = wider if better else search
        promised = search.evidence(search.best())
        if several and not lost:
            rung, sought = _rung(plain, promised, asked, every, say), True
        enough = rung is not None and rung.score < plain.cost - promised + SHADOW
        simplest = rung if enough else _lawful(plain, search, every, say)
        simplest = simplest or _simplest(plain, search, every, say, begun)
        line = min(line or simplest, simplest, key=lambda one: one.score)
    # beside a law without a name what rings may be a term that it lacks
    lines = () if line.now.laws else lines_of(line.now) or slow_line_of(line.now)
    if lines:
        say("what rings")
        every = (*every, *ringing(asked, lines, plain.bodies))
        line = _simplest(line.now, search_from(line.now, every), every, say)
    if not sought and not lost and _may_ring(line):
        rung = _rung(plain, plain.cost - line.score, asked, every, say)
    if rung is not None:
        fewer = max(len(line.now.own) - len(rung.now.own), 0)
        line = rung if rung.score < line.score + TIED * fewer else line
    say("what is left")
    # of a sensor's error that stands in for another one, what is left may look like noise
    if line.now.follows and (line.now.effects or line.left.doubtful):
        say("laws without a name")
        line = _with_laws(line)
        lawful = bool(line.now.effects and line.now.laws)
        if lawful or len(line.now.effects) > 1:
            # causes that stand in for a law may have hidden it
            lead = -SHADOW if lawful else TIED
            line = _with_laws(Line(plain, search, every), than=line, lead=lead)
    line = _needed(line, say)
    return line if wandering is None else min(line, wandering, key=lambda one: one.score)


def _is_wander(line: Line) -> bool:
    """Whether what wanders does so beyond doubt, and is neither a law without a name nor something
    that rings."""
    if gained_by(line.now) < WANDERS:
        return False
    laws = laws_of(line.now.bodies)
    lines = lines_of(line.now)
    price = unlikely(laws)
    shapes = resonators(line.asked, line.now.bodies)
    if lines:
        shapes = (*shapes, *ringing(line.asked, lines, line.now.bodies))
    parts = [one.perturbations for one in shapes] + [(law.perturbation,) for law in laws]
    traces = [one.trace for one in shapes] + [law.trace(price) for law in laws]
    weighing = line.now.weigh(parts, traces)
    search = Search(weighing, range(len(weighing.traces)))
    return not any(search.pays(score) for score in search.scores(line.now.own))


def _rung(
    plain: Explanation,
    promised: float,
    asked: Sequence[Candidate],
    every: tuple[Candidate, ...],
    say: Say,
) -> Line | None:
    """Searched from one thing that rings and leaves nothing, if it may be worth what is promised
    otherwise."""
    say("what rings by itself")
    alone, shapes = resonating(plain, promised, asked)
    if alone is None:
        return None
    every = (*every, *shapes)
    return _searched(alone, search_from(alone, every), every, say)


def _may_ring(line: Line) -> bool:
    """Whether what was found may stand in for one thing that rings at a frequency of its own."""
    pushed = any(
        effect.rings and not (isinstance(effect, BodyEffect) and effect.hangs_on)
        for effect in line.now.effects
    )
    several = len(line.now.own) > 1 or bool(line.now.laws)
    return pushed or several or line.left.doubtful


def onward(plain: Explanation, apart: Line, say: Say) -> Line | None:
    """On from causes that segments apart have shown, where the motion follows the model with them
    and with the base that they leave; else None.

    Args:
        plain: the model without causes, whose motion has no segments apart.
        apart: where a line of reasoning over segments ended.
        say: told what is being done.
    """
    now = apart.now
    if not now.effects:
        return None
    try:
        there = explain(plain.bodies, plain.base, now.effects, now.at)
    except TwinError:
        return None
    if not there.converged or remainder(there).chi2 > ROUGH:
        return None
    first = Line(there, search_from(there, apart.asked), apart.asked)
    found = _needed(_searched(there, first.search, apart.asked, say), say)
    # what was added and dropped again may have led the fit away
    same = {one.label for one in found.now.effects} == {one.label for one in there.effects}
    return min(first, found, key=lambda one: one.score) if same else found


def _needed(line: Line, say: Say) -> Line:
    """Without what it can do without, and searched on from there."""
    needed = needed_only(line.now, line.search.limit)
    if needed is line.now:
        return line
    search = search_from(needed, line.asked)
    nameless = line.nameless if needed.laws else 0.0
    fewer = Line(needed, search, line.asked, nameless)
    if needed.laws or not needed.follows or set(search.best()) == set(needed.own):
        return fewer
    # one of those that were dropped, or another, may explain more than what is left
    found = _searched(needed, search, line.asked, say)
    if needed_only(found.now, found.search.limit) is not found.now:
        return fewer
    return min(fewer, found, key=lambda one: one.score)


def _led(plain: Explanation, search: Search, asked: tuple[Candidate, ...], say: Say) -> Line | None:
    """Searched from the likeliest single cause, where a model without any loses the motion.

    Columns along another motion say little; and what leads it to the logs, a disturbance, hides
    much of the causes. So those that promise most by either are fitted, each alone, up to one
    that leaves nothing: what stands in for it is its rival afterwards.
    """
    lead = plain.disturbed()
    near = search_from(lead, asked)
    tries: dict[str, Effect] = {}
    for now, one in ((lead, near), (plain, search)):
        for score in one.scores()[:LED]:
            (guess,) = guesses(now, asked, one.weighing, (score.index,))
            tries.setdefault(guess.label, guess)
    best, settled = plain, False
    for label, guess in tries.items():
        say(f"fitting {label} alone")
        there = fitted(lead, (guess,))
        # NaN is no better
        if there is None or not there.cost < best.cost:
            continue
        best, settled = there, not remainder(there).doubtful
        if settled:
            break
    if best is plain:
        return None
    line = Line(best, search_from(best, asked), asked)
    return line if settled else _searched(best, line.search, asked, say)


def _lawful(
    plain: Explanation, search: Search, asked: tuple[Candidate, ...], say: Say
) -> Line | None:
    """A few laws without a name, where they promise more than several causes do and then leave
    nothing, neither to chance nor to a cause: fitting causes that only stand in for a law takes
    long, and each that it finds is false."""
    if len(search.best()) < 2 or not plain.follows:
        return None
    say("laws without a name")
    causes, promised = Line(plain, search, asked), search.evidence(search.best())
    found = _with_laws(causes, lead=TIED + promised, promised=promised)
    if found is causes or found.left.doubtful:
        return None
    beside = found.search.evidence(found.search.best()) - found.search.evidence(found.now.own)
    return found if beside < SHADOW else None


def _simplest(
    now: Explanation,
    search: Search,
    asked: tuple[Candidate, ...],
    say: Say,
    begun: Line | None = None,
) -> Line:
    """Searched, also from each new cause alone that a fit may change beyond its strength: what it
    lacks where its columns were formed looks like a second cause, or lets another one seem the
    better. `begun` is that search, where it was made already."""
    line = begun or _searched(now, search, asked, say)
    if not 1 <= len(line.now.effects) <= CROWD or not now.follows:
        return line
    chosen, single = search.best(), len(line.now.effects) == 1
    gained = search.weighing.weigh(chosen).gain
    if single and gained > UNMISTAKABLE and not line.left.doubtful:
        return line
    for index in _near(search, chosen) if single else chosen:
        first = len(now.own)
        if index < first or not _bends(asked[index - first]):
            continue
        (guess,) = guesses(now, asked, search.weighing, (index,))
        say(f"fitting {guess.label} alone")
        alone = followed(now, (guess,))
        if alone is None:
            continue
        if single and Line(alone, search_from(alone, ()), asked).score > line.score:
            continue
        found = _searched(alone, search_from(alone, asked), asked, say)
        line = min(line, found, key=lambda one: one.score)
    return line


def _near(search: Search, chosen: tuple[int, ...]) -> list[int]:
    """Of each other cause the shape that gains most, if that is about as much as a set does."""
    if not chosen:
        return []
    gain = {i: search.weighing.weigh((i,)).gain for i in search.asked}
    least = NEARLY * search.weighing.weigh(chosen).gain
    of_label: dict[str, int] = {}
    for index in sorted(gain, key=lambda i: -gain[i]):
        of_label.setdefault(search.weighing.traces[index].label, index)
    return [i for i in of_label.values() if i not in chosen and gain[i] >= least]


def _bends(one: Candidate) -> bool:
    """Whether what it does is not proportional to its strengths."""
    return one.trace.shapes > 0 or of_drive(one.effect)


def _searched(now: Explanation, search: Search, asked: tuple[Candidate, ...], say: Say) -> Line:
    """The best of those that searches and fits in turn come by, until the causes stay or return."""
    best = Line(now, search, asked)
    seen = [frozenset(effect.label for effect in now.effects)]
    for _ in range(ROUNDS):
        chosen = _strong(search, search.best(), len(now.own))
        labels = frozenset(search.weighing.traces[index].label for index in chosen)
        if labels in seen:
            break
        seen.append(labels)
        guessed = guesses(now, asked, search.weighing, chosen)
        say("fitting " + ", ".join(sorted(labels)))
        tried = fitted(now, guessed)
        meant = guessed if tried is None else tried.effects
        if tried is None or not all(_possible_alone(now, effect) for effect in meant):
            asked = _possible(now, asked, meant)
        elif astray(now, tried):
            break
        else:
            now = tried
        say("causes weighed")
        search = search_from(now, asked)
        line = Line(now, search, asked)
        best = line if not now.follows or line.score < best.score else best
    return best


def _strong(search: Search, chosen: tuple[int, ...], own: int) -> tuple[int, ...]:
    """Without new causes that can wait until a far stronger new one has been fitted.

    Args:
        search: where the reasoning stands.
        chosen: the best set.
        own: how many causes are fitted already; they come first.
    """
    whole = search.evidence(chosen)
    worth = {
        index: whole - search.evidence(tuple(other for other in chosen if other != index))
        for index in chosen
        if index >= own
    }
    most = max(worth.values(), default=0.0)
    return tuple(i for i in chosen if i < own or worth[i] >= WEAK * most)


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


def _with_laws(
    line: Line, than: Line | None = None, lead: float = TIED, promised: float = 0.0
) -> Line:
    """With laws without a name, where they explain more than causes: in place of some or beside.

    Args:
        line: what they are weighed beside.
        than: what they must be better than, if not that.
        lead: by how much they must promise to be better; below zero, how much worse they may be.
        promised: evidence that causes promise beyond what explains that.
    """
    now, laws = line.now, laws_of(line.now.bodies)
    than = than or line
    price = unlikely(laws)
    weighing = now.weigh([(law.perturbation,) for law in laws], [law.trace(price) for law in laws])
    search = Search(weighing, range(len(weighing.traces)))
    best = search.best()
    found = [laws[index - len(now.own)] for index in best if index >= len(now.own)]
    more = search.evidence(best) - search.evidence(now.own)
    if not found or line.score - more > than.score - lead:
        return than
    kept = [effect for index, effect in enumerate(now.effects) if index in best]
    there = followed(now, kept, found)
    if there is None:
        return than
    # their columns were formed along a motion that lacked them
    there = followed(there, there.effects, there.laws) or there
    lawful = Line(there, search_from(there, line.asked), line.asked)
    beyond = than.score + than.nameless - promised - lawful.score
    lawful = _named(replace(lawful, nameless=max(beyond, 0.0)))
    return lawful if lawful.score < than.score - min(lead, 0.0) else than


def _named(lawful: Line) -> Line:
    """Causes in place of all laws, where along the motion that those lead to a few do the same.

    Without the laws the motion may be too far away for a cause's columns to show what it does.
    """
    now, weighing = lawful.now, lawful.search.weighing
    laws = range(len(now.effects), len(now.own))
    search = Search(weighing, [i for i in lawful.search.asked if i not in laws])
    best = search.best()
    behind = search.evidence(now.own) - len(laws) * unlikely(laws_of(now.bodies))
    few = 0 < len(best) <= min(len(now.own), CROWD)
    if not few or search.evidence(best) < behind:
        return lawful
    there = followed(now, guesses(now, lawful.asked, weighing, best))
    if there is None:
        return lawful
    named = Line(there, search_from(there, lawful.asked), lawful.asked)
    return min(named, lawful, key=lambda line: line.score)
