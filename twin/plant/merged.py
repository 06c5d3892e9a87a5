"""Samples of several devices, each at its own rate, merged into one reading a tick."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from twin.plant.devices.device import Sample
from twin.plant.routes import Route
from twin.platform import Platform
from twin.signals import Reading, Samples

Array = NDArray[np.float64]

Row = tuple[float, Array, bool]
"""Time [s], values (columns,), valid."""


class Merged:
    """The streams of one machine, row by row."""

    def __init__(self, platform: Platform, routes: Iterable[Route]) -> None:
        """Nothing has come."""
        self.out_of_range = 0
        """Samples at or beyond the range that the platform states of their sensor."""
        self._widths = {route.stream: len(platform.columns(route.stream)) for route in routes}
        self._ranges = {name: sensor.range for name, sensor in platform.sensors.items()}
        self._rows: dict[str, list[Row]] = {name: [] for name in self._widths}
        self._parts: dict[str, dict[int, Row]] = {name: {} for name in self._widths}

    def add(self, sample: Sample, route: Route, zero: float, column: int | None = None) -> None:
        """One sample of a device.

        Args:
            sample: as it came.
            route: to the machine.
            zero: the host's monotonic clock at tick 0 [s].
            column: of the one part that the sample is of; None: of all of the route's.
        """
        time = sample.host_time - sample.latency - zero
        with np.errstate(invalid="ignore"):
            value = np.asarray(sample.value)
            value = route.taken(value) if column is None else route.taken_of(column, value)
        valid = sample.valid and bool(np.isfinite(value).all())
        if valid and np.abs(value).max() >= self._ranges.get(route.stream, np.inf):
            self.out_of_range += 1
            valid = False
        columns = route.columns if column is None else (column,)
        if len(columns) == self._widths[route.stream]:
            ordered = np.empty(len(columns))
            ordered[list(columns)] = value
            self._rows[route.stream].append((time, ordered, valid))
        else:
            self._join(route.stream, columns, (time, value, valid))

    def take(self, until: float) -> Reading:
        """All rows since the last call, in the order of their times."""
        streams: dict[str, Samples] = {}
        for name, rows in self._rows.items():
            if rows:
                rows.sort(key=lambda row: row[0])
                streams[name] = Samples(
                    np.array([[row[1] for row in rows]]),
                    np.array([[row[0] for row in rows]]),
                    np.array([[row[2] for row in rows]]),
                )
                self._rows[name] = []
        return Reading(until, streams)

    def begin_anew(self) -> None:
        """Forget parts that wait for others: their times are of another zero."""
        for parts in self._parts.values():
            parts.clear()

    def _join(self, stream: str, columns: tuple[int, ...], row: Row) -> None:
        """Keep the columns of some parts until all have come: then they are one row.

        Its time is the mean of theirs: what drives on one line tell one after the other.
        """
        time, value, valid = row
        parts = self._parts[stream]
        for place, column in enumerate(columns):
            parts[column] = (time, value[place : place + 1], valid)
        if len(parts) == self._widths[stream]:
            whole = [parts[column] for column in range(len(parts))]
            self._rows[stream].append(
                (
                    float(np.mean([part[0] for part in whole])),
                    np.concatenate([part[1] for part in whole]),
                    all(part[2] for part in whole),
                )
            )
            parts.clear()
