"""Sets of causes, each fitted beside the noise that it leaves: the plain search.

From a set to a better one by adding, exchanging and dropping causes. What a set promises is had
from columns, at several sizes of the torque that the model without it takes for wander: a cause
that explains shrinks it. The few that promise most are fitted, their noise with them, and their
score decides: -2 log L at the likeliest noise, what that costs, and the price of the causes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation
from twin.diagnose.fitting import astray, guesses
from twin.diagnose.line import Line
from twin.diagnose.search import Search, less
from twin.diagnose.turns import starts
from twin.effects import Effect
from twin.errors import TwinError
from twin.predict.whitening.noise_model import NoiseModel

Say = Callable[[str], None]

LEVELS = (1.0, 0.2, 0.0)
"""Sizes of the torque at which sets are weighed, in units of what it is without them."""
STARTS = (1.0, 0.3, 0.1, 0.03)
"""Likewise at which the noise beside a set is sought."""
FITTED = 3
"""Sets that are fitted of those that promise most."""
SINGLE = 4
"""Causes that are tried beside, or in place of one of, a set at each of those sizes."""
NEAR = 30.0
"""Score by which a set may promise to be worse than the best one that is fitted to be fitted too:
so much may its columns err."""
BESIDE = 20.0
"""Evidence that a cause must have beside what wanders: no wander is quite the process that it is
taken for, and by what that misses, causes gain up to half of this where there are none."""
ROUNDS = 6


@dataclass(frozen=True)
class _Promise:
    """A set before it is fitted."""

    score: float
    effects: tuple[Effect, ...]
    noise: NoiseModel

    @property
    def labels(self) -> frozenset[str]:
        return frozenset(effect.label for effect in self.effects)


def best_set(plain: Explanation, asked: tuple[Candidate, ...], say: Say) -> Line:
    """The set of causes with the lowest score; every one of them is worth a fit without it.

    Args:
        plain: the model without causes, its noise the likeliest.
        asked: what may be the matter.
        say: told what is being done.
    """
    say("causes weighed")
    best = _line(plain, asked)
    lines = {frozenset[str](): best}
    for _ in range(ROUNDS):
        found: list[Line] = []
        for promise in _promising(best, set(lines)):
            least = min((_score(line) for line in found), default=_score(best))
            if promise.score > least + NEAR:
                break
            if (line := _fitted(best, promise, say)) is not None:
                lines[_labels(line)] = line
                found.append(line)
        better = min(found, key=_score, default=best)
        if not _is_better(better, best):
            break
        best = _line(better.now, asked, best.search.limit)
    return _needed(best, lines, say)


def _is_better(line: Line, than: Line) -> bool:
    """Whether a set has the lower score, and what it has more of is beyond chance."""
    more = _labels(line) - _labels(than)
    if not _score(line) < _score(than) or len(line.now.effects) <= len(than.now.effects):
        return _score(line) < _score(than)
    return all(_pays(line, label, than) for label in more)


def _line(now: Explanation, asked: tuple[Candidate, ...], limit: float | None = None) -> Line:
    weighing = now.weighing(asked)
    return Line(now, Search(weighing, range(len(weighing.traces)), limit), asked)


def _score(line: Line) -> float:
    """Of a fit beside its own noise; the lower the better."""
    return line.now.marginal + line.price


def _labels(line: Line) -> frozenset[str]:
    return frozenset(effect.label for effect in line.now.effects)


def _promising(line: Line, known: set[frozenset[str]]) -> list[_Promise]:
    """Sets near one that stands, those that promise most first."""
    now, best = line.now, dict[frozenset[str], _Promise]()
    for noise in _levels(now.noise):
        there = now if noise == now.noise else now.beside(noise)
        weighing = line.search.weighing if there is now else there.weighing(line.asked)
        search = Search(weighing, range(len(weighing.traces)), line.search.limit)
        none = there.marginal + weighing.weigh(now.own).gain
        for chosen in _near(search, now.own):
            effects = tuple(guesses(now, line.asked, weighing, chosen))
            one = _Promise(none - search.evidence(chosen), effects, noise)
            if one.labels not in known and one.score < _score(line):
                before = best.get(one.labels)
                best[one.labels] = one if before is None or one.score < before.score else before
    return sorted(best.values(), key=lambda one: one.score)[:FITTED]


def _levels(noise: NoiseModel) -> Iterator[NoiseModel]:
    """At which a set is weighed: as it is, with less of the torque, with nothing that wanders."""
    yield noise
    if noise.pushes:
        yield from (_with_torque(noise, level) for level in LEVELS[1:])
    if noise.errors or noise.walks:
        yield NoiseModel(scales=noise.scales)


def _with_torque(noise: NoiseModel, level: float) -> NoiseModel:
    return replace(noise, torque=replace(noise.torque, rms=level * noise.torque.rms))


def _near(search: Search, own: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Sets with one cause more, or with another in one's place, the best few of each."""
    for rest in (own, *(less(own, index) for index in own)):
        seen: set[str] = set()
        for score in search.scores(rest):
            label = search.weighing.traces[score.index].label
            if len(seen) < SINGLE and label not in seen and search.pays(score):
                seen.add(label)
                yield (*rest, score.index)


def _fitted(best: Line, promise: _Promise, say: Say) -> Line | None:
    """Fitted beside its noise; None where it loses the motion, or no machine can have it."""
    now, found = best.now, None
    say("fitting " + (", ".join(sorted(promise.labels)) or "none"))
    for start in starts(promise.effects, now.effects, now.bodies[0].machine.platform):
        try:
            one = now.instead(start, (), promise.noise)
        except TwinError:
            continue
        found = one if found is None or one.marginal < found.marginal else found
    if found is None or astray(now, found):
        return None
    # its price needs no more than what it has itself
    own = found.settled(look=True, among=[_with_torque(now.noise, level) for level in STARTS])
    line = replace(_line(own, (), best.search.limit), asked=best.asked)
    return line


def _needed(best: Line, lines: dict[frozenset[str], Line], say: Say) -> Line:
    """Without those causes that a fit can do without, noise in their place; knowing what each of
    the others is worth, and how far behind others are that were fitted in an only one's place."""
    while True:
        fewer = {effect.label: _less(best, effect.label, lines, say) for effect in best.now.effects}
        known = {label: line for label, line in fewer.items() if line is not None}
        needless = [line for label, line in known.items() if not _pays(best, label, line)]
        if not needless:
            break
        best = min(needless, key=_score)
    worth = {label: _score(line) - _score(best) for label, line in known.items()}
    alone = {label: line for (label, *more), line in _named(lines) if not more}
    single = len(best.now.effects) == 1
    rivals = {label: _score(line) - _score(best) for label, line in alone.items()} if single else {}
    whole = best if len(best.search.asked) > len(best.now.own) else None
    whole = whole or _line(best.now, best.asked, best.search.limit)
    return replace(whole, rivals=rivals, worth=worth)


def _named(lines: dict[frozenset[str], Line]) -> list[tuple[list[str], Line]]:
    return [(sorted(labels), line) for labels, line in lines.items() if labels]


def _less(best: Line, label: str, lines: dict[frozenset[str], Line], say: Say) -> Line | None:
    rest = tuple(effect for effect in best.now.effects if effect.label != label)
    labels = frozenset(effect.label for effect in rest)
    if labels not in lines:
        fewer = _fitted(best, _Promise(0.0, rest, best.now.noise), say)
        if fewer is None:
            return None
        lines[labels] = fewer
    return lines[labels]


def _pays(best: Line, label: str, fewer: Line) -> bool:
    """Whether a cause is worth its price against a fit without it."""
    (index,) = (i for i, effect in enumerate(best.now.effects) if effect.label == label)
    score = best.search.scored(index, fewer.now.marginal - best.now.marginal)
    least = BESIDE if best.now.noise.wanders else 0.0
    return best.search.pays(score) and score.evidence > least
