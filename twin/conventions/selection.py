"""Which of many readings of a log to tell: the likeliest, and those that fit as well."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from twin.conventions.correction import Correction
from twin.conventions.finding import CLEAR, TIED


class Reading(Protocol):
    """A log put right in one way."""

    @property
    def corrections(self) -> tuple[Correction, ...]:
        """Nothing in it: the log as read."""
        ...


R = TypeVar("R", bound=Reading)


def choose(ranked: Sequence[R], weigh: Callable[[R, R], float]) -> tuple[list[R], float]:
    """The best reading and its equals, where it clearly beats the log as read.

    Args:
        ranked: the likeliest first, the log as read among them.
        weigh: evidence for the one over the other [nats], their costs taken off.

    Returns:
        The best and what fits as well, none for a log that was read rightly; and the evidence
        against the log as read [nats].
    """
    as_read = [one for one in ranked if not one.corrections]
    best = ranked[0]
    for rival in ranked[1:]:
        best = rival if weigh(rival, best) > 0.0 else best
    equals = [best, *(h for h in ranked if h is not best and weigh(best, h) < TIED)]
    # of those that the data cannot tell apart, one that says less than another says enough
    simplest = [h for h in equals if not any(_signature(other) < _signature(h) for other in equals)]
    best = simplest[0]
    certainty = min(weigh(best, one) for one in as_read)
    return (simplest, certainty) if best.corrections and certainty >= CLEAR else ([], certainty)


def words_of(reading: Reading) -> str:
    """What is wrong; empty for the log as read."""
    return ", and ".join(c.words for c in reading.corrections if c.words)


def _signature(reading: Reading) -> set[tuple[object, ...]]:
    return {(c.stream, c.kind, c.axes, c.lag > 0.0) for c in reading.corrections}
