"""Columns that tell when a row was: clocks, counters of samples, and what only counts rows."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.column_names import names_a_clock
from twin.recording.formats import NumberFile

Array = NDArray[np.float64]

WRAPS = (2.0**8, 2.0**16, 2.0**32)
"""Where counters of one, two and four bytes begin anew."""
USUALLY = 0.5
"""Share of the rows at least that follow one another by such a counter."""
EVEN = 0.2
"""Share of the usual step by which most steps of a clock differ at most."""
MOST_LISTED = 3
"""Clocks that an error proposes."""


def is_count(time: Array) -> bool:
    """Whether a column counts rows: whole numbers in steps of one."""
    return len(time) > 2 and bool((np.diff(time) == 1.0).all() and time[0] == np.round(time[0]))


def counted(count: Array) -> tuple[Array | None, str]:
    """A counter of samples from 0, without its wraps; else None, and why it is none."""
    whole = count == np.round(count)
    if not whole.all():
        return None, f"holds {count[~whole][0]:g}, which is no count of samples"
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
    return (called or even)[:MOST_LISTED]
