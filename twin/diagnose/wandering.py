"""Causes beside noise that wanders: draughts, an attitude reference that strays, a drifting gyro.

No real log leaves white noise: without room for what wanders, a search gives it the names of causes
and calls the whole unexplained. Here the noise processes are fitted beside base and causes, in each
fit anew, so that a cause has to beat what a wander makes of the same logs.
"""

from collections.abc import Callable, Sequence

import numpy as np

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation
from twin.diagnose.fitting import followed, guesses
from twin.diagnose.line import Line, search_from
from twin.diagnose.search import less
from twin.predict.whitening.noise import EXACT, Noise

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
    line = _needed(line, first, say)
    return line if line.now.noise.any and not line.left.doubtful else None


def _first(line: Line, chosen: tuple[int, ...]) -> tuple[int, ...]:
    """Of new causes the strongest only: the noise without it is another one."""
    new = [index for index in chosen if index >= len(line.now.own)]
    if len(new) < 2:
        return chosen
    worth = {i: line.search.evidence(chosen) - line.search.evidence(less(chosen, i)) for i in new}
    most = max(new, key=lambda index: worth[index])
    return tuple(index for index in chosen if index < len(line.now.own) or index == most)


def _needed(line: Line, first: Line, say: Say) -> Line:
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
