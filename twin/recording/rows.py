"""Rows in the order of their times: what can be mended is, what would be guessing is an error."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.recording.formats import NumberFile

Array = NDArray[np.float64]

LATE_ROWS = 10
"""A row later than this many sampling periods was not delayed: the clock was set back."""

MOSTLY = 0.25
"""Share of rows beyond which those that are late are the rule."""
SQUEEZED = 1.5
"""A late row that finds its place free stands two periods between its neighbours; where it has less
room than this [periods], others were there already."""


@dataclass(frozen=True)
class Rows:
    """Rows of one stream."""

    time: Array
    """(m,) [s]"""
    value: Array
    """(m, k), all finite."""
    origin: NDArray[np.intp]
    """(m,) the row of the file (from 0) that each was."""
    repairs: tuple[str, ...]
    """A sentence for each kind of repair."""

    def only(self, keep: NDArray[np.bool_] | NDArray[np.intp], repair: str) -> "Rows":
        """Some of the rows, or all in another order, and the sentence that says so."""
        repairs = (*self.repairs, repair)
        return Rows(self.time[keep], self.value[keep], self.origin[keep], repairs)


def own(value: Array) -> Array | None:
    """The array, where nobody else holds it and a result may be written over it; else None.

    A log's numbers may fill half of the memory, so no step holds them twice without need.
    """
    return value if value.flags.writeable else None


def mended(
    time: Array,
    value: Array,
    file: NumberFile,
    names: Sequence[str],
    clock: str | None,
    where: str,
    origin: NDArray[np.intp],
) -> Rows:
    """Leave out rows without a number, sort late ones, drop repeated ones; say each.

    Args:
        time: (m,) [s].
        value: (m, k); NaN where the file has nothing.
        file: for the errors, where the rows are from.
        names: k columns of the file.
        clock: the column of the file that the times are from; None without one.
        where: how the sentences call the stream.
        origin: (m,) the row of the file (from 0) that each is.

    Raises:
        LogError: a number is missing or not finite, a column has none, the clock was set back or
            is none, or one time stands on two different rows.
    """
    rows = Rows(time, value, origin, file.repairs)
    return _once(_in_order(_filled(rows, file, names, clock, where), file, where), file, where)


def _filled(
    rows: Rows, file: NumberFile, names: Sequence[str], clock: str | None, where: str
) -> Rows:
    finite = np.isfinite(rows.value)
    if finite.all() and np.isfinite(rows.time).all():
        return rows
    blank: NDArray[np.bool_] = np.logical_and.reduce(np.isnan(rows.value), axis=1)
    if blank.all():
        raise file.fault(f"has no number in {', '.join(names)}", "name other `columns`")
    none: NDArray[np.bool_] = np.logical_and.reduce(np.isnan(rows.value), axis=0)
    if none.any():
        empty = ", ".join(repr(name) for name, void in zip(names, none, strict=True) if void)
        raise file.fault(
            f"has nothing in column {empty}", "list the others in `columns`, and in `axes`"
        )
    wrong = ~finite & ~blank[:, None]
    if wrong.any():
        row, column = (int(index) for index in np.argwhere(wrong)[0])
        number = float(rows.value[row, column])
        raise file.not_finite(int(rows.origin[row]), names[column], number)
    stampless = ~np.isfinite(rows.time) & ~blank
    if stampless.any():
        row = int(np.argmax(stampless))
        raise file.not_finite(int(rows.origin[row]), clock or file.time, float(rows.time[row]))
    if not blank.any():
        return rows
    return rows.only(~blank, f"{where}: {_rows(blank)} without a number left out")


def _in_order(rows: Rows, file: NumberFile, where: str) -> Rows:
    gaps = np.diff(rows.time)
    if not (gaps < 0.0).any():
        return rows
    period = float(np.median(np.abs(gaps)))
    behind = np.maximum.accumulate(rows.time) - rows.time
    back = behind > LATE_ROWS * period
    if back.any():
        worst = int(np.argmax(back))
        raise file.fault(
            f"time goes back from {rows.time[worst - 1]:.6g} s to {rows.time[worst]:.6g} s",
            "split the file where its clock starts anew",
            int(rows.origin[worst]),
        )
    late = behind > 0.0
    if np.count_nonzero(late) > MOSTLY * len(late) > 1.0:
        raise file.fault(
            f"time goes back to {_rows(late)} of {len(late)}: it is no clock",
            "name the column of times as `time`, or give `rate`",
        )
    order = np.argsort(rows.time, kind="stable")
    if _squeezed(rows.time[order], np.isin(order, np.flatnonzero(late))):
        first = int(np.argmax(late))
        raise file.fault(
            f"time goes back from {rows.time[first - 1]:.6g} s to {rows.time[first]:.6g} s, where "
            "no row was missing",
            "its clock was set back: split the file there",
            int(rows.origin[first]),
        )
    return rows.only(order, f"{where}: {_rows(late)} out of order sorted by time")


def _squeezed(time: Array, moved: NDArray[np.bool_]) -> bool:
    """Whether rows that were sorted to an earlier place fill no holes there."""
    gaps = np.diff(time)
    inner = np.flatnonzero(moved[1:-1]) + 1
    before, after = gaps[inner - 1], gaps[inner]
    twice = (before == 0.0) | (after == 0.0)  # of one row again
    room = (before + after)[~twice]
    return bool(room.size) and float(np.median(room)) < SQUEEZED * float(np.median(gaps))


def _once(rows: Rows, file: NumberFile, where: str) -> Rows:
    same_time = np.diff(rows.time) == 0.0
    if not same_time.any():
        return rows
    same_row = same_time & (np.diff(rows.value, axis=0) == 0.0).all(axis=1)
    differing = np.flatnonzero(same_time & ~same_row)
    if differing.size:
        second = differing[0] + 1
        raise file.fault(
            f"time {rows.time[second]:.9g} s stands on two rows with different values",
            "correct the time, or delete one",
            int(rows.origin[second]),
        )
    dropped = f"{where}: {_rows(same_row)} that repeat the one before dropped"
    return rows.only(np.concatenate([[True], ~same_row]), dropped)


def _rows(which: NDArray[np.bool_]) -> str:
    count = int(np.count_nonzero(which))
    return f"{count} row" if count == 1 else f"{count} rows"
