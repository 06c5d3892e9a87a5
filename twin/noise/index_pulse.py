"""Angles of which a pulse a turn is all that is known: events, and no grid of 360 deg.

Of such a counter each row but a change of it says only that less than a turn went by. When it
changes, the index mark has just passed, and there the angle is a whole number of turns to within
the rate times the sampling interval.
"""

from dataclasses import replace

import numpy as np

from twin.recording import Series

ANGLES = ("joint_angle", "gimbal_angle")
"""Streams of angles that may turn round and round."""
TURN = 2.0 * np.pi
EXACT = 1e-6
"""Of a turn, by which a count of turns may be off in another unit."""
FEWEST = 4
"""Changes of the count."""


def counts_turns(series: Series) -> bool:
    """Whether an angle (m, 1) [rad] only ever changes by whole turns, one at a time."""
    if series.unit != "rad" or len(series.columns) != 1:
        return False
    steps = np.diff(series.value[:, 0]) / TURN
    turns = np.round(steps)
    passed = turns != 0.0
    return bool(
        np.count_nonzero(passed) >= FEWEST
        and np.abs(steps - turns).max() < EXACT
        and np.abs(turns).max() == 1.0
    )


def passages(series: Series) -> Series:
    """The instants at which the mark passed, and the angle there, forwards or backwards.

    Args:
        series: of a count of turns (m, 1) [rad].
    """
    steps = np.diff(series.value[:, 0])
    after = np.flatnonzero(np.abs(steps) > 0.5 * TURN)
    # a row of a steady clock shows the mark late, by half an interval in the mean; rows that were
    # written at the pulses themselves are all changes
    each = len(after) == len(steps)
    time = series.time[after + 1] if each else 0.5 * (series.time[after] + series.time[after + 1])
    # forwards the new count begins at the mark, backwards the old one ended there
    angle = np.maximum(series.value[after, 0], series.value[after + 1, 0])
    return replace(series, time=time, value=angle[:, None])
