"""Rows of one stream of all runs of a batch, as they come; those of a run lie side by side."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.signals import Mask

Array = NDArray[np.float64]
Number = TypeVar("Number", bound=np.generic)

ROOM = 256
"""Rows at first."""


class Kept:
    """Grows as it must; what nobody will ask for makes room."""

    def __init__(self, runs: int, width: int) -> None:
        self._time = np.empty((runs, ROOM))
        self._value = np.empty((runs, ROOM, width))
        self._valid = np.empty((runs, ROOM), dtype=np.bool_)
        self._count = 0

    def add(self, time: Array, value: Array, valid: Mask, since: float) -> None:
        """Rows of all runs.

        Args:
            time: (n or 1, m) [s].
            value: (n or 1, m, k).
            valid: (n or 1, m), False where a run has no such row.
            since: what is older will not be asked for [s].
        """
        if self._count + value.shape[1] > self._time.shape[1]:
            self._make_room(value.shape[1], since)
        new = slice(self._count, self._count + value.shape[1])
        self._time[:, new], self._value[:, new], self._valid[:, new] = time, value, valid
        self._count = new.stop

    def rows(self, run: int, start: float) -> tuple[Array, Array]:
        """Times (m,) and values (m, k) of a run from a time on [s], in the order of the times."""
        time, value = self._time[run, : self._count], self._value[run, : self._count]
        there = np.flatnonzero(self._valid[run, : self._count] & (time >= start))
        there = there[np.argsort(time[there], kind="stable")]
        return time[there], value[there]

    def _make_room(self, more: int, since: float) -> None:
        asked = (self._time[:, : self._count] >= since).any(axis=0)
        first = int(np.argmax(asked)) if asked.any() else self._count
        live = slice(first, self._count)
        self._count -= first
        room = max(self._time.shape[1], 2 * (self._count + more))
        self._time = _moved(self._time, live, room)
        self._value = _moved(self._value, live, room)
        self._valid = _moved(self._valid, live, room)


def _moved(rows: NDArray[Number], live: slice, room: int) -> NDArray[Number]:
    """Those that live, at the front of so much room."""
    found = np.empty((len(rows), room, *rows.shape[2:]), dtype=rows.dtype)
    found[:, : live.stop - live.start] = rows[:, live]
    return found
