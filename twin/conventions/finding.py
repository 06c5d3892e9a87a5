"""A wrong convention as it is told: a sentence, its evidence, what else would fit, and the cure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from twin.conventions.correction import Correction

CLEAR = 7.0
"""Nats by which another reading must beat the log as read, its cost taken off."""
TIED = 4.0
"""Nats by which the best reading must beat another, or both are named."""
CERTAIN = 100.0
"""Evidence stated for a unit: a factor of six or more, not a matter of likelihood [nats]."""


@dataclass(frozen=True)
class ConventionFinding:
    """A stream that looks as if it had been read wrongly."""

    correction: Correction
    evidence: float
    """By how much the data prefer it to the log as read [nats], its own improbability taken off."""
    alternatives: tuple[str, ...] = ()
    """Other readings that fit as well, in words; the log does not tell which."""
    others: tuple[Correction, ...] = ()
    """What the same mistake did to further streams: those of a frame."""

    @property
    def corrections(self) -> tuple[Correction, ...]:
        """Of every stream that it concerns."""
        return (self.correction, *self.others)

    @property
    def stream(self) -> str:
        """Which stream; of a frame, the first of them."""
        return self.correction.stream

    @property
    def kind(self) -> str:
        """`unit`, `axes`, `frame`, `order`, `direction`, `angles`, `time_unit`, `clock_lag`
        or `no_fit`."""
        return self.correction.kind

    @property
    def ambiguous(self) -> bool:
        """Whether something else fits as well."""
        return bool(self.alternatives)

    @property
    def sentence(self) -> str:
        """For a person."""
        words = opened(self.correction.words)
        if not self.ambiguous:
            return f"{words}."
        others = "; or ".join(self.alternatives)
        return f"{words}; or {others}: the log does not tell which."


def findings_of(
    corrections: Iterable[Correction], evidence: float, alternatives: tuple[str, ...] = ()
) -> Iterator[ConventionFinding]:
    """One a correction, and one for all the streams of a frame."""
    corrections = tuple(corrections)
    frame = tuple(c for c in corrections if c.kind == "frame")
    for correction in corrections:
        if correction.words:
            others = frame[1:] if correction.kind == "frame" else ()
            yield ConventionFinding(correction, evidence, alternatives, others)


def no_fit(stream: str, words: str) -> ConventionFinding:
    """Two streams that go together in no reading: nothing is corrected, and nothing is silent."""
    return ConventionFinding(
        Correction(stream, "no_fit", f"no reading of {words}"), evidence=CERTAIN
    )


def opened(words: str) -> str:
    """As a sentence begins; the name of a stream stays as it is written in log.toml."""
    first = words.split()[0]
    return words if "_" in first else words[0].upper() + words[1:]
