"""What an emulated device is, and the faults of its line.

What an emulated device is: bytes in, bytes out, and the time told to it.
An emulation is written from a device's documents, never from the driver's code, so that the two
check each other. It knows nothing of ports, threads or the real clock.
"""

import abc
import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from twin.errors import UnknownName


class EmulatedDevice(abc.ABC):
    """One device, or several on one line."""

    baud: int
    """At which it talks and listens now."""
    stop_bits: int = 1

    @abc.abstractmethod
    def receive(self, data: bytes, now: float) -> bytes:
        """Bytes have come in at `now` [s]; what it sends at once."""

    @abc.abstractmethod
    def advance(self, now: float) -> bytes:
        """Time has come to `now` [s]; what it has sent since the last call."""

    @abc.abstractmethod
    def power_cycle(self, now: float) -> None:
        """Switched off and on again: all is forgotten but what it keeps without power."""

    @abc.abstractmethod
    def inject(self, fault: str, value: float = 0.0) -> None:
        """Begin to fail in a way of its own.

        Raises:
            UnknownName: it cannot fail so.
        """


LINE_FAULTS: Mapping[str, str] = {
    "drop": "bytes vanish",
    "duplicate": "bytes come twice",
    "garble": "bits flip",
    "burst": "bytes wait for the next beat of the adapter",
    "baud": "the device talks at another rate than the host",
    "silence": "nothing passes in either direction",
    "unplug": "the port disappears, and comes back afterwards",
    "power_cycle": "the device is switched off and on",
}
"""Kinds of faults that a line has, whatever device is on it."""

BURST = 0.016
"""Latency timer of common USB adapters [s]."""


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong."""

    kind: str
    """One of LINE_FAULTS, or one of the device's own."""
    start: float = 0.0
    """After the line was opened [s]."""
    duration: float = float("inf")
    """How long [s]; what only happens, happens at the start."""
    share: float = 1.0
    """Part of the bytes it hits, of `drop`, `duplicate` and `garble`."""
    value: float = 0.0
    """What the device's own fault takes as its value."""
    device: str = ""
    """Whose, by the laboratory's name, where several are emulated together; empty: the first's."""


def schedule(
    seed: int, kinds: Iterable[str], *, span: float, mean_gap: float, duration: float, share: float
) -> tuple[Fault, ...]:
    """Faults at random times of a Poisson process, the same for the same seed.

    Args:
        seed: Of the times and the kinds.
        kinds: Drawn from with equal chance.
        span: No fault starts later than this [s].
        mean_gap: Between two starts [s].
        duration: Of each [s].
        share: Part of the bytes that each hits.
    """
    chance = random.Random(seed)
    choice = sorted(kinds)
    faults: list[Fault] = []
    start = chance.expovariate(1.0 / mean_gap)
    while start < span:
        faults.append(Fault(chance.choice(choice), start, duration, share))
        start += chance.expovariate(1.0 / mean_gap)
    return tuple(faults)


@dataclass
class Wire:
    """Bytes of both directions pass through here and suffer what is wrong at the time."""

    faults: list[Fault] = field(default_factory=list[Fault])
    seed: int = 0

    def __post_init__(self) -> None:
        self._chance = random.Random(self.seed)

    def active(self, kind: str, now: float) -> Fault | None:
        """The fault of that kind that holds at `now` [s], if any."""
        if kind not in LINE_FAULTS:
            raise UnknownName("line fault", kind, LINE_FAULTS)
        return next(
            (f for f in self.faults if f.kind == kind and f.start <= now < f.start + f.duration),
            None,
        )

    def carry(self, data: bytes, now: float, *, matched: bool) -> bytes:
        """What arrives of `data`; `matched`: both ends agree on the baud rate."""
        if not data or self.active("silence", now):
            return b""
        if not matched or self.active("baud", now):
            # A receiver at another rate sees edges where there are none: any bytes, fewer or more.
            return bytes(self._chance.randrange(256) for _ in range(max(1, len(data) * 2 // 3)))
        drop, double = self.active("drop", now), self.active("duplicate", now)
        garble = self.active("garble", now)
        if not (drop or double or garble):
            return data
        out = bytearray()
        for byte in data:
            if drop and self._chance.random() < drop.share:
                continue
            if garble and self._chance.random() < garble.share:
                byte ^= 1 << self._chance.randrange(8)
            out.append(byte)
            if double and self._chance.random() < double.share:
                out.append(byte)
        return bytes(out)
