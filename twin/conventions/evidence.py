"""How much better one reading of a log explains it than another, in nats.

Both leave a residual that the right reading would leave white with unit variance. Their likelihood
ratio alone cannot be trusted where the signal is weak: the same sensor noise turned another way, or
taken at another time, is another draw, and two draws of n samples differ by sqrt(n) nats by chance.
How far the residuals are apart tells how large that chance is, and the ratio is weighed by it:

    L = (|r0|^2 - |r1|^2) / 2,   evidence = L min(1, 2 |L| / |r0 - r1|^2)

For a clear signal, r0 = r1 + s, this is the likelihood ratio |s|^2 / 2 itself; for two draws of
mere noise it is of the order of one. Where it is known how far noise alone would take them apart,
only the share of |r0 - r1|^2 beyond that counts: an axis about which the body does not turn has a
sign that no log shows, however well its noise may fit.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from twin.conventions.correction import Correction

Array = NDArray[np.float64]


def evidence(residual: Array, other: Array, inflated: float, noise: float = 0.0) -> float:
    """In favour of `residual` over `other` [nats]; what no reading explains divides it.

    Args:
        residual: white with unit variance, of the one.
        other: of the other.
        inflated: from `inflation`.
        noise: of |other - residual|^2, what noise alone makes; 0 where that is not known.
    """
    ratio = 0.5 * float(np.sum(np.square(other)) - np.sum(np.square(residual)))
    apart = float(np.sum(np.square(other - residual)))
    if apart <= noise:
        return 0.0
    return ratio * min(1.0, 2.0 * abs(ratio) / apart) * (1.0 - noise / apart) / inflated


PLAIN = 12
"""So many of those that fit as well as the best but for noise are weighed too, the plainest ones:
where the body moves little there are many, and chance ranks them."""


def chance(count: int) -> float:
    """By how much misfits of two readings may differ that leave so many numbers of noise [nats]."""
    return 2.0 * float(np.sqrt(count))


def inflation(residual: Array) -> float:
    """By how much the best residual, (n, k), falls short of white with unit variance; at least 1.

    What no reading explains (a misaligned gyro, a torque nobody models) must not count as
    evidence: its size and its correlation from sample to sample divide all of it. Both together,
    for it is the slow part of it that looks like motion: a small one does so however slow it is.
    """
    power = float(np.mean(np.square(residual)))
    if power <= 0.0 or len(residual) < 3:
        return 1.0
    echo = float(np.mean(residual[1:] * residual[:-1])) / power
    echo = float(np.clip(echo, 0.0, 0.98))
    return max(power * (1.0 + echo) / (1.0 - echo), 1.0)


def whitened(rate: Array, angle_noise: float, rate_noise: float) -> Array:
    """Differences of noisy angles minus noisy rates, made white with unit variance.

    Their noise is rate_noise on each row and the difference of angle_noise (both as rates, 1 sigma
    a row): a first-order low-pass undoes its spectrum.
    """
    pole = forgetting(angle_noise, rate_noise)
    gain = (1.0 - pole) / rate_noise
    return np.asarray(lfilter([gain], [1.0, -pole], rate, axis=0))


def forgetting(angle_noise: float, rate_noise: float) -> float:
    """What the whitening filter keeps from row to row: the root below 1 of its spectral factor."""
    first = 0.5 * (rate_noise + np.hypot(rate_noise, 2.0 * angle_noise))
    return 1.0 - rate_noise / first


def drift(kept: NDArray[np.bool_], pole: float) -> Array:
    """(n, 3) bias, its drift, and a whitening filter's memory of what came before, of rows that are
    0 before the filter where they are not kept (n,)."""
    count = len(kept)
    memory = np.power(pole, np.arange(count, dtype=np.float64))
    columns = np.stack([np.ones(count), np.linspace(-1.0, 1.0, count)], axis=-1)
    if not kept.all():
        columns = lfilter([1.0 - pole], [1.0, -pole], columns * kept[:, None], axis=0)
    return np.column_stack([columns, memory])


def without(columns: Array, values: Array) -> Array:
    """Values (n, k) with the columns (n, c) projected out."""
    basis = np.linalg.qr(columns)[0]
    return values - basis @ (basis.T @ values)


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


class Interpretation(Protocol):
    """A log put right in one way."""

    @property
    def corrections(self) -> tuple[Correction, ...]:
        """Nothing in it: the log as read."""
        ...


R = TypeVar("R", bound=Interpretation)


def choose(ranked: Sequence[R], weigh: Callable[[R, R], float]) -> tuple[list[R], float]:
    """The best reading and its equals, where it clearly beats the log as read.

    Args:
        ranked: the likeliest first, the log as read among them.
        weigh: evidence for the one over the other [nats], their costs taken off.

    Returns:
        The best and what fits as well, none for a log that was read rightly; and the evidence
        against the log as read [nats].
    """
    as_read = [item for item in ranked if not item.corrections]
    best = ranked[0]
    for rival in ranked[1:]:
        best = rival if weigh(rival, best) > 0.0 else best
    equals = [best, *(h for h in ranked if h is not best and weigh(best, h) < TIED)]
    # of those that the data cannot tell apart, one that says less than another says enough
    simplest = [h for h in equals if not any(_signature(other) < _signature(h) for other in equals)]
    best = simplest[0]
    certainty = min(weigh(best, item) for item in as_read)
    return (simplest, certainty) if best.corrections and certainty >= CLEAR else ([], certainty)


def words_of(reading: Interpretation) -> str:
    """What is wrong; empty for the log as read."""
    return ", and ".join(c.words for c in reading.corrections if c.words)


def _signature(reading: Interpretation) -> set[tuple[object, ...]]:
    return {(c.stream, c.kind, c.axes, c.lag > 0.0) for c in reading.corrections}
