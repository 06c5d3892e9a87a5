"""Whether one thing that rings, at whatever frequency, explains logs by itself.

Where commands repeat, what rings is pushed at their harmonics and answers with those that are near
its own frequency. So what a model leaves has lines, but where the harmonics are; and pushes at one
of these, or a liquid asked for there, gain enough to pass for the cause.
"""

from collections.abc import Sequence
from dataclasses import replace

from twin.diagnose.candidates import Candidate, candidate, looked_among, resonators
from twin.diagnose.explanation import Explanation
from twin.diagnose.fitting import followed, guesses
from twin.diagnose.line import Line, search_from
from twin.diagnose.remainder import remainder

LEAST = 0.2
"""Share of what others promise that such a thing must promise to be fitted: shapes between those
that are asked, and pivots elsewhere, gain the rest."""


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
        if search.pays(score) and score.evidence > LEAST * promised:
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
