"""What travels round the loop -> rows of streams, for one run of the batch.

A tick is only kept; rows are made of many ticks at once, as raw float64 bytes, which costs a
fraction of what NumPy takes to put a few numbers together.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.recording.recording import Series
from twin.signals import Estimate, Samples, Tick, stream_named

Array = NDArray[np.float64]
Item = TypeVar("Item")

_stamp = struct.Struct("d").pack


class Block(NamedTuple):
    """Rows of one stream, m of them, as bytes."""

    time: bytes
    """m float64 [s]."""
    value: bytes
    """m k float64."""
    valid: bytes
    """m times 0 or 1; a row with 0 is none."""


class Header(NamedTuple):
    """What a stream's columns are."""

    columns: tuple[str, ...]
    unit: str


@dataclass
class Placed:
    """A machine in a recording of several, and where the viewer shows it."""

    platform: Platform | None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of its room in the one that all share [m]."""
    streams: dict[str, Header] = field(default_factory=dict[str, Header])
    """As far as they are known."""


class StreamRows:
    """Turns ticks into rows of the streams of one run."""

    def __init__(self, platform: Platform, run: int = 0) -> None:
        self.headers: dict[str, Header] = {}
        """Of every stream seen so far."""
        self._platform = platform
        self._run = run

    def of(self, ticks: Sequence[Tick]) -> dict[str, Block]:
        """The rows of some ticks, by stream; commands are stamped with the tick they apply from."""
        run = self._run
        blocks: dict[str, Block] = {}
        for streams in (
            [t.reading.streams for t in ticks],
            [t.truth for t in ticks],
            [t.relative for t in ticks],
        ):
            for name, (_, samples) in _by_name(streams).items():
                blocks[name] = self._samples(samples)
        stamps = [_stamp(t.reading.time) for t in ticks]
        for name, (which, values) in _by_name([t.applied for t in ticks]).items():
            blocks[name] = self._values(stamps, which, values)
        for name, (which, values) in _by_name([t.wanted for t in ticks]).items():
            wishes = [np.asarray(value, dtype=np.float64) for value in values]
            wish = "wanted_" + name.removeprefix("command_")
            blocks[wish] = self._values(stamps, which, wishes)
        every = range(len(ticks))
        for name, values in (
            ("reference_attitude", [t.target.attitude for t in ticks]),
            ("reference_rate", [t.target.rate_body for t in ticks]),
        ):
            blocks[name] = self._values(stamps, every, values)
        for name, values in (
            ("reference_position", [t.target.position for t in ticks]),
            ("reference_velocity", [t.target.velocity for t in ticks]),
            ("estimate_position", [t.estimate.position for t in ticks]),
            ("estimate_velocity", [t.estimate.velocity for t in ticks]),
        ):
            rows = [(i, value) for i, value in enumerate(values) if self._known(value)]
            if rows:
                which, known = zip(*rows, strict=True)
                blocks[name] = self._values(stamps, which, known)
        cycles = [t.cycle for t in ticks if t.cycle is not None]
        if len(cycles) == len(ticks):
            blocks["loop_time"] = self._values(stamps, every, cycles)
        valid = [i for i, t in enumerate(ticks) if t.estimate.valid[run]]
        if valid:
            estimates = [ticks[i].estimate for i in valid]
            for name, values in (
                ("estimate_attitude", [e.attitude for e in estimates]),
                ("estimate_rate", [e.rate_body for e in estimates]),
                ("estimate_gyro_bias", [e.gyro_bias for e in estimates]),
            ):
                blocks[name] = self._values(stamps, valid, values)
            blocks |= self._quantities(stamps, valid, estimates)
        for name in blocks:
            if name not in self.headers:
                unit = stream_named(name).unit
                self.headers[name] = Header(self._platform.columns(name), unit)
        return blocks

    def _known(self, place: Array | None) -> TypeGuard[Array]:
        """Whether this run's place, or its velocity, has been seen or asked for."""
        if place is None:
            return False
        own = place[self._run] if place.ndim == 2 and len(place) > 1 else place
        return bool(np.isfinite(own).all())

    def _quantities(
        self, stamps: Sequence[bytes], valid: Sequence[int], estimates: Sequence[Estimate]
    ) -> dict[str, Block]:
        """What an estimator states beside the motion; it states the same names at each tick."""
        if not estimates[0].quantities():
            return {}
        blocks: dict[str, Block] = {}
        stated = [estimate.quantities() for estimate in estimates]
        for name, first in stated[0].items():
            rows = [quantities[name] for quantities in stated]
            streams = {f"estimate_{name}_sigma": [row.sigma for row in rows]}
            if first.value is not None:
                streams[f"estimate_{name}"] = [row.value for row in rows if row.value is not None]
            for stream, values in streams.items():
                blocks[stream] = self._values(stamps, valid, values)
                self.headers[stream] = Header(first.columns, first.unit)
        return blocks

    def _samples(self, samples: Sequence[Samples]) -> Block:
        return Block(
            self._bytes([s.time for s in samples], 2),
            self._bytes([s.value for s in samples], 3),
            self._bytes([s.valid for s in samples], 2),
        )

    def _values(
        self, stamps: Sequence[bytes], which: Sequence[int], values: Sequence[Array]
    ) -> Block:
        times = stamps if len(which) == len(stamps) else [stamps[i] for i in which]
        return Block(b"".join(times), self._bytes(values, 2), b"\1" * len(times))

    def _bytes(self, arrays: Sequence[NDArray[Any]], ndim: int) -> bytes:
        """This run's part of arrays whose first of `ndim` axes is the batch, if they have it."""
        if arrays and arrays[0].ndim == ndim and len(arrays[0]) > 1:
            arrays = [array[self._run] for array in arrays]
        try:
            return b"".join(arrays)  # pyright: ignore[reportArgumentType] - NumPy has buffers
        except (BufferError, TypeError):
            # some are views with gaps
            return b"".join([array.tobytes() for array in arrays])


def decode(block: Block, width: int) -> tuple[Array, Array]:
    """The valid rows of a block: times (m,) and values (m, width)."""
    time = np.frombuffer(block.time)
    value = np.frombuffer(block.value).reshape(-1, width)
    if b"\0" not in block.valid:
        return time, value
    valid = np.frombuffer(block.valid, dtype=np.bool_)
    return time[valid], value[valid]


def series(header: Header, block: Block) -> Series:
    """A block as a stream in memory, in the order of its times."""
    time, value = decode(block, len(header.columns))
    order = np.argsort(time, kind="stable")
    return Series(time[order], value[order], header.columns, header.unit)


def _by_name(
    mappings: Iterable[Mapping[str, Item]],
) -> dict[str, tuple[list[int], list[Item]]]:
    """For each name, in which of the mappings it is, and what it is there."""
    result: dict[str, tuple[list[int], list[Item]]] = {}
    for number, mapping in enumerate(mappings):
        for name, item in mapping.items():
            which, items = result.get(name) or result.setdefault(name, ([], []))
            which.append(number)
            items.append(item)
    return result
