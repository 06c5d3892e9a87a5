"""When the rows of a stream were: clocks, counters of samples, and the rows of a part of a log."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.column_names import names_a_clock
from twin.recording.formats import NumberFile
from twin.recording.recording import Series
from twin.recording.rows import steps_back

Array = NDArray[np.float64]

WRAPS = (2.0**8, 2.0**16, 2.0**32)
"""Where counters of one, two and four bytes begin anew."""
ROUNDING = 1e-6
"""Of times since 1970, of which something was taken off and added again [s]."""
DAY = 86400.0
"""[s]."""
USUALLY = 0.5
"""Share of the rows at least that follow one another by such a counter."""
EVEN = 0.2
"""Share of the usual step by which most steps of a clock differ at most."""
LISTED_CLOCKS = 3
"""Clocks that an error proposes."""


def is_count(time: Array) -> bool:
    """Whether a column counts rows: whole numbers in steps of one."""
    return len(time) > 2 and bool((np.diff(time) == 1.0).all() and time[0] == np.round(time[0]))


def counted(count: Array) -> tuple[Array | None, str]:
    """A counter of samples from 0, without its wraps; else None, and why it is none."""
    integral = count == np.round(count)
    if not integral.all():
        return None, f"holds {count[~integral][0]:g}, which is no count of samples"
    steps = np.diff(count)
    if (steps < 0.0).any():
        modulus = next((wrap for wrap in WRAPS if wrap > count.max()), None)
        back = -steps[steps < 0.0]
        if modulus is None or (back < 0.5 * modulus).any():
            return None, "goes back, so it is no count of samples"
        steps = np.where(steps < 0.0, steps + modulus, steps)
    return np.concatenate([[0.0], np.cumsum(steps)]), ""


def counts_samples(count: Array) -> bool:
    """Whether a counter, which nobody named, goes up by one as a rule, and never stays."""
    steps = np.diff(count)
    return len(steps) > 0 and bool((steps >= 1.0).all()) and float((steps == 1.0).mean()) > USUALLY


def lost_by_counter(count: Array, name: str, where: str) -> tuple[str, ...]:
    """A sentence where a counter says that samples were lost."""
    lost = int(count[-1]) + 1 - len(np.unique(count))
    if not lost:
        return ()
    rows = "1 row" if lost == 1 else f"{lost} rows"
    return (f"{where}: {rows} of {int(count[-1]) + 1} lost, by the counter {name!r}",)


def over_midnight(time: Array, where: str) -> tuple[Array, tuple[str, ...]]:
    """Times of day (m,) [s] that go on after midnight, and a sentence where they pass it: they step
    back by more than half a day, which no clock is set back by within one."""
    steps = np.diff(time, prepend=time[:1])
    passed = np.cumsum(steps < -0.5 * DAY) - np.cumsum(steps > 0.5 * DAY)
    within_day = len(time) > 0 and float(np.nanmin(time)) >= 0.0 and float(np.nanmax(time)) <= DAY
    if not within_day or not passed.any() or passed.min() < 0:
        return time, ()
    return time + DAY * passed, (f"{where}: times of day pass midnight, and go on from there",)


def clocks_among(file: NumberFile, names: Sequence[str]) -> list[str]:
    """Columns that could be the times: called so and never going back; else any that rises evenly.

    Args:
        file: of the columns.
        names: those to look at.
    """
    called: list[str] = []
    even: list[str] = []
    for name in names:
        try:
            steps = np.diff(file.numbers((name,))[:, 0])
        except LogError:  # text
            continue
        if not len(steps) or not (steps >= 0.0).all() or (steps > 0.0).mean() < 0.5:
            continue
        usual = float(np.median(steps))
        if names_a_clock(name):
            called.append(name)
        elif np.mean(np.abs(steps - usual) < EVEN * usual) > 0.5:
            even.append(name)
    return (called or even)[:LISTED_CLOCKS]


@dataclass(frozen=True)
class Timeline:
    """When the rows of a stream were, as its file says."""

    time: Array
    """(m,) [s], in the order of the file."""
    rows: NDArray[np.intp] | None
    """(m,) of the file; None where these are all."""
    lost: tuple[str, ...]
    """What a counter, or a clock that was set back, says."""
    has: NDArray[np.bool_]
    """(m,) whether the stream has a number there."""
    late: float
    """[s] by which the times are late."""
    span: tuple[int, int] | None = None
    """The first and the last row of the file that are taken; None: all."""

    def series(self) -> Series:
        """When the stream has numbers, in order; without these."""
        time = self.time if self.has.all() else self.time[self.has]
        if (np.diff(time) < 0.0).any():
            time = np.sort(time)
        if self.late:
            time = time - self.late
        return Series(time, np.empty((len(time), 0)), (), "1")

    def rows_between(self, start: float, stop: float, margin: int) -> tuple[int, int]:
        """The first and the last row of the file in a time [s], widened by `margin` rows on either
        side within `span`. Where no row is in that time, the nearest one."""
        (mine,) = np.nonzero(self.has)
        if self.span is not None:
            mine = mine[np.searchsorted(self.row_of(mine), self.span[0]) :]
            mine = mine[: np.searchsorted(self.row_of(mine), self.span[1], side="right")]
        time = self.time[mine] - self.late
        (among,) = np.nonzero((time >= start - ROUNDING) & (time <= stop + ROUNDING))
        if not len(among):
            among = np.argmin(np.maximum(start - time, time - stop), keepdims=True)
        first, last = (int(row) for row in self.row_of(mine[among[[0, -1]]]))
        low, high = self.span or (0, np.iinfo(np.intp).max)
        return max(first - margin, low, 0), min(last + margin, high)

    def single_run(self, start: float, stop: float, file: NumberFile, where: str) -> "Timeline":
        """Without rows beyond a step back of the clock.

        A part is of the first run of the clock that has rows in it. Where the part ends within
        that run, later rows at such times are left out, and counted in `lost`.

        Args:
            start: of the part, as the file's clock less `late` has it [s].
            stop: of the part.
            file: for the error.
            where: how the sentence calls the stream.

        Raises:
            LogError: the clock was set back within the part.
        """
        mine = np.flatnonzero(self.has)
        time, row = self.time[mine], self.row_of(mine)
        begins = np.r_[0, np.flatnonzero(steps_back(time)) + 1]
        if len(begins) == 1:
            return self
        within = (time >= start + self.late) & (time <= stop + self.late)
        counts = np.add.reduceat(within, begins, dtype=np.intp)
        used = np.flatnonzero(counts)
        first, after = np.r_[begins, len(time)][used[0] : used[0] + 2]
        said = self.lost
        if len(used) > 1:
            back = f"time goes back from {time[after - 1]:.6g} s to {time[after]:.6g} s"
            if stop + self.late > time[first:after].max():
                raise file.fault(
                    back,
                    "end the part before that with `stop`, or begin it later with `start`, or "
                    "split the file there",
                    int(row[after]),
                )
            others = int(counts[used[1:]].sum())
            rows = "1 row" if others == 1 else f"{others} rows"
            said = (*said, f"{where}: {back}; {rows} after that, at times of this part, left out")
        return replace(self, span=(int(row[first]), int(row[after - 1])), lost=said)

    def row_of(self, index: NDArray[np.intp]) -> NDArray[np.intp]:
        """Rows of the file."""
        return index if self.rows is None else self.rows[index]

    def part(self, first: int, count: int) -> tuple[Array, NDArray[np.intp], NDArray[np.intp]]:
        """Times [s] of the rows among `count` of the file from `first` on, which of these they are,
        and which of the file."""
        low, high = self.span or (0, first + count)
        low, high = max(low, first), min(high + 1, first + count)
        if self.rows is None:
            rows = np.arange(low, min(high, len(self.time)))
            return self.time[low : low + len(rows)], rows - first, rows
        given = (self.rows >= low) & (self.rows < high)
        rows = self.rows[given]
        return self.time[given], rows - first, rows
