"""One axis of a sensor that keeps a value while the others go on: a broken wire, a dead channel.

The axes of one sensor scatter alike. An axis that repeats its value for longer than the scatter of
the other axes allows, and than its own where it is alive, gives no measurements meanwhile. Where
the grid hides the scatter, an axis may really keep its value, and nothing is said of it.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.noise.quantisation import resolution_of
from twin.noise.stopped import chance_of_a_repeat, repeats_needed, runs_of, usual_run
from twin.noise.stream import noise_of
from twin.recording import Series

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OF_AXES = ("gyro", "accelerometer", "magnetometer", "inclinometer")
"""Streams of sensors with several axes of one kind."""
FEWEST = 50
"""Rows of the shortest stretch that counts."""
TIMES = 5.0
"""Usual runs of equal values that a stretch must exceed, besides what noise allows."""
DEAD = 0.9
"""Share of the rows from which an axis counts as dead: the other rows are too few to use."""


def stuck_rows(series: Series) -> Mask:
    """(m, k) rows in which an axis is stuck, axis by axis.

    Args:
        series: m rows of a sensor with k axes.
    """
    # rows in which all axes repeat are of a slow sensor, or of one that hung
    first, held = runs_of(series.value)
    rows = np.zeros(len(series), dtype=np.bool_)
    rows[first] = True
    # among all rows a slow sensor jumps, among the others a coarse one flickers, both like noise
    coarse = [_chance_in(series, column) for column in range(series.value.shape[1])]
    return _stuck(series.only(rows), np.array(coarse)).repeat(held, axis=0)


def _stuck(series: Series, coarse: Array) -> Mask:
    """The same of a series in which no row repeats the one before.

    Args:
        series: m rows.
        coarse: (k,) chances of a repeat, at least.
    """
    value = series.value
    stuck = np.zeros(value.shape, dtype=np.bool_)
    alive = (value != value[:1]).any(axis=0)
    slow = [_chance_in(series, column) for column in range(value.shape[1])]
    repeats = np.maximum(coarse, slow)
    for column in range(value.shape[1]):
        others = np.flatnonzero(alive & (np.arange(len(alive)) != column))
        length = runs_of(value[:, column : column + 1])[1]
        long = length > FEWEST
        if not len(others) or not long.any():
            continue
        repeat = float(repeats[others].max())
        if alive[column]:
            repeat = max(repeat, _chance_in(series.only(~np.repeat(long, length)), column))
        if repeat == 1.0:
            continue
        needed = max(TIMES, repeats_needed(repeat, len(series)))
        usual = usual_run(length) if alive[column] else 1.0
        found = long & (length > usual * needed)
        stuck[:, column] = found.repeat(length)
    return stuck


def dead_axes(series: Series) -> tuple[str, ...]:
    """Axes that are stuck in all rows of a sensor, or nearly all."""
    if len(series.columns) < 2 or len(series) <= FEWEST:
        return ()
    share = stuck_rows(series).mean(axis=0)
    return tuple(
        name for name, part in zip(series.columns, share.tolist(), strict=True) if part >= DEAD
    )


def _chance_in(series: Series, column: int) -> float:
    """That noise leaves a column in its step of the grid; 1 where that cannot be known."""
    values = series.value[:, column]
    if len(values) <= FEWEST:
        return 1.0
    part = replace(series, value=values[:, None], columns=series.columns[column : column + 1])
    peak = float(np.abs(values).max())
    return chance_of_a_repeat(resolution_of(values), float(noise_of(part)[0]), peak)
