"""An only cause held against those that might stand in its place, each fitted.

Where a cause stands, the columns of the others are formed along a motion that has it. A rival's own
fit goes along another motion, and changes its shape too: it is better than its columns promise, and
may be the better explanation.
"""

from dataclasses import replace

from twin.diagnose.fitting import followed, guesses
from twin.diagnose.line import Line, search_from

NEAR, NEAR_SHARE = 12.0, 0.05
"""Evidence by which a rival may be behind to be worth a fit; and its share of the cause's own,
where that is more: columns may err by as much."""
MOST = 3
"""Rivals that are fitted, the nearest."""


def against_rivals(line: Line) -> Line:
    """The better of an only cause and its rivals, knowing how far behind each of the others is."""
    now = line.now
    if len(now.effects) != 1 or now.laws or not now.follows:
        return line
    nearest: dict[str, int] = {}
    near = max(NEAR, NEAR_SHARE * line.search.evidence(now.own))
    for other, behind in line.search.instead(now.own, 0):
        if behind < near and len(nearest) < MOST:
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
