"""What an emulated device is, and the faults of its line.

What an emulated device is: bytes in, bytes out, and the time told to it.
An emulation is written from a device's documents, never from the driver's code, so that the two
check each other. It knows nothing of ports, threads or the real clock.
"""

import abc
import random
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from twin.errors import UnknownName


class Emulated(abc.ABC):
    """One device, whatever it is connected by."""

    @abc.abstractmethod
    def power_cycle(self, time: float) -> None:
        """Switched off and on again: all is forgotten but what it keeps without power."""

    @abc.abstractmethod
    def inject(self, fault: str, value: float = 0.0) -> None:
        """Start a fault of this kind of device.

        Raises:
            UnknownName: it cannot fail so.
        """


class EmulatedDevice(Emulated):
    """One device, or several on one line."""

    baud: int
    """At which it talks and listens now."""
    stop_bits: int = 1

    @abc.abstractmethod
    def receive(self, data: bytes, time: float) -> bytes:
        """Bytes have come in at `time` [s]; what it sends at once."""

    @abc.abstractmethod
    def advance(self, time: float) -> bytes:
        """Time has come to `time` [s]; what it has sent since the last call."""


class EmulatedPeer(Emulated):
    """One device in a network."""

    listens: bool
    """It waits at its port for whoever asks; else it sends to that port, unasked."""

    @abc.abstractmethod
    def receive(self, packet: bytes, time: float) -> list[bytes]:
        """A packet has come in at `time` [s]; what it sends at once."""

    @abc.abstractmethod
    def advance(self, time: float) -> list[bytes]:
        """Time has come to `time` [s]; what it has sent since the last call."""


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
"""Kinds of faults of a line, the same for all devices."""

NETWORK_FAULTS: Mapping[str, str] = {
    "drop": "packets vanish",
    "duplicate": "packets come twice",
    "garble": "a bit of a packet flips",
    "burst": "packets wait for the next beat",
    "reorder": "packets come after the one behind them",
    "replay": "packets of before come again",
    "stranger": "another computer sends packets of its own",
    "silence": "nothing passes in either direction",
    "unplug": "the same, as by a cable",
    "power_cycle": "the device is switched off and on",
}
"""Kinds of faults of a network, the same for all devices."""

BURST = 0.016
"""Latency timer of common USB adapters [s]."""


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong."""

    kind: str
    """One of LINE_FAULTS (of a network NETWORK_FAULTS), or a kind of the device."""
    start: float = 0.0
    """After the line was opened [s]."""
    duration: float = float("inf")
    """How long [s]; what only happens, happens at the start."""
    share: float = 1.0
    """Part of the bytes or packets it hits, of `drop`, `duplicate`, `garble` and the like."""
    value: float = 0.0
    """Parameter of a fault of the device."""
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

    def active(self, kind: str, time: float) -> Fault | None:
        """The fault of that kind that holds at `time` [s], if any."""
        if kind not in LINE_FAULTS:
            raise UnknownName("line fault", kind, LINE_FAULTS)
        return next(
            (f for f in self.faults if f.kind == kind and f.start <= time < f.start + f.duration),
            None,
        )

    def carry(self, data: bytes, time: float, *, matched: bool) -> bytes:
        """What arrives of `data`; `matched`: both ends agree on the baud rate."""
        if not data or self.active("silence", time):
            return b""
        if not matched or self.active("baud", time):
            # A receiver at another rate sees edges where there are none: any bytes, fewer or more.
            return bytes(self._chance.randrange(256) for _ in range(max(1, len(data) * 2 // 3)))
        drop, double = self.active("drop", time), self.active("duplicate", time)
        garble = self.active("garble", time)
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


@dataclass
class PacketWire:
    """Packets of both directions pass through here and suffer what is wrong at the time."""

    faults: list[Fault] = field(default_factory=list[Fault])
    seed: int = 0

    def __post_init__(self) -> None:
        self._chance = random.Random(self.seed)
        self._early = deque[bytes](maxlen=64)
        """Packets of before, to be replayed."""
        self._held: list[bytes] = []
        """Packets that others overtake."""
        self._beat = deque[bytes](maxlen=4096)

    def active(self, kind: str, time: float) -> Fault | None:
        """The fault of that kind that holds at `time` [s], if any."""
        if kind not in NETWORK_FAULTS:
            raise UnknownName("network fault", kind, NETWORK_FAULTS)
        return next(
            (f for f in self.faults if f.kind == kind and f.start <= time < f.start + f.duration),
            None,
        )

    def carry(self, packets: Iterable[bytes], time: float) -> list[bytes]:
        """What arrives of `packets`, in the order in which it does."""
        out: list[bytes] = []
        cut = self.active("silence", time) or self.active("unplug", time)
        for packet in packets:
            if cut or self._hit("drop", time):
                continue
            if packet and self._hit("garble", time):
                place = self._chance.randrange(len(packet))
                bit = 1 << self._chance.randrange(8)
                packet = packet[:place] + bytes([packet[place] ^ bit]) + packet[place + 1 :]
            self._early.append(packet)
            if self._hit("reorder", time):
                self._held.append(packet)
                continue
            out += [packet] * (2 if self._hit("duplicate", time) else 1)
            if self._hit("replay", time):
                out.append(self._chance.choice(self._early))
            out += self._held
            self._held = []
        return out

    def beaten(self, packets: Iterable[bytes], time: float, before: float) -> list[bytes]:
        """As they come from an adapter that passes on what it has in beats, where it does."""
        self._beat += packets
        if self.active("burst", time) and time // BURST == before // BURST:
            return []
        out = list(self._beat)
        self._beat.clear()
        return out

    def forged(self, packet: bytes, time: float) -> list[bytes]:
        """What a stranger sends who has heard a packet and changes it."""
        if not packet or not self._hit("stranger", time):
            return []
        place = self._chance.randrange(len(packet))
        return [packet[:place] + self._chance.randbytes(len(packet) - place)]

    def _hit(self, kind: str, time: float) -> bool:
        fault = self.active(kind, time)
        return fault is not None and self._chance.random() < fault.share
