"""A run or a log in memory: streams on their own clocks, and where they come from."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import UnknownName
from twin.shown import Shown
from twin.units import unit_named

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Series:
    """One stream: rows in the order of their times."""

    time: Array
    """Shape (m,), host seconds, when the value was true."""
    value: Array
    """Shape (m, k), SI."""
    columns: tuple[str, ...]
    """k names."""
    unit: str
    """SI unit of every column."""

    def __post_init__(self) -> None:
        if self.value.shape != (len(self.time), len(self.columns)):
            raise ValueError(
                f"value is {self.value.shape}, time {self.time.shape}, columns {self.columns}"
            )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rate(self) -> float:
        """Median rate [Hz]; NaN with fewer than two rows."""
        return float(1.0 / np.median(np.diff(self.time))) if len(self) > 1 else float("nan")

    @property
    def stands_still(self) -> bool:
        """Whether there are several rows, and all the same."""
        return len(self) > 1 and bool((self.value == self.value[:1]).all())

    def between(self, start: float, stop: float) -> "Series":
        """The rows with start <= time < stop."""
        first, last = np.searchsorted(self.time, [start, stop])
        return replace(self, time=self.time[first:last], value=self.value[first:last])

    def only(self, rows: NDArray[np.bool_]) -> "Series":
        """Some of the rows, by a mask (m,)."""
        return replace(self, time=self.time[rows], value=self.value[rows])

    def held_at(self, times: Array) -> Array:
        """Zero-order hold: the last value at or before each time, shape (len(times), k)."""
        index = np.searchsorted(self.time, times, side="right") - 1
        return self.value[np.clip(index, 0, len(self) - 1)]

    def interpolated_at(self, times: Array) -> Array:
        """Linear between rows, constant outside, shape (len(times), k)."""
        columns = [np.interp(times, self.time, column) for column in self.value.T]
        return np.stack(columns, axis=-1)


@dataclass(frozen=True)
class Recording(Shown, Mapping[str, Series]):
    """Streams by name, with their provenance."""

    streams: Mapping[str, Series]
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """JSON-able facts: platform, its files' hashes, versions, seed, command line, schema."""
    repairs: tuple[str, ...] = ()
    """A sentence for each thing that was mended on reading."""

    def __getitem__(self, name: str) -> Series:
        if name not in self.streams:
            raise UnknownName("stream", name, self.streams)
        return self.streams[name]

    def __contains__(self, name: object) -> bool:
        return name in self.streams

    def __iter__(self) -> Iterator[str]:
        return iter(self.streams)

    def __len__(self) -> int:
        return len(self.streams)

    def unit_of(self, name: str) -> str:
        """SI unit of a stream's values; where its scale is to be fitted that may be volts, say."""
        stated = (self.provenance.get("streams") or {}).get(name) or {}
        if not stated.get("fit_scale"):
            return self[name].unit
        return unit_named(stated.get("unit") or self[name].unit).si

    @property
    def source(self) -> str:
        """What it is called in a message: its file or folder."""
        return str(self.provenance.get("source", "the log"))

    @property
    def start(self) -> float:
        """Time of the first row [s]; NaN when there is none."""
        return min((s.time[0] for s in self.streams.values() if len(s)), default=float("nan"))

    @property
    def stop(self) -> float:
        """Time of the last row [s]; NaN when there is none."""
        return max((s.time[-1] for s in self.streams.values() if len(s)), default=float("nan"))

    def between(self, start: float, stop: float) -> "Recording":
        """The rows of every stream with start <= time < stop."""
        cut = {name: series.between(start, stop) for name, series in self.streams.items()}
        return replace(self, streams=cut)

    def without_truth(self) -> "Recording":
        """What a lab would have measured: everything but a simulation's true states."""
        kept = {k: s for k, s in self.streams.items() if not k.startswith("truth_")}
        return replace(self, streams=kept)
