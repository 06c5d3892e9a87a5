"""Rows in the order of their times: what can be mended is, what would be guessing is an error."""

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.table import CsvFile

Array = NDArray[np.float64]

LATE_ROWS = 10
"""A row later than this many sampling periods was not delayed: the clock was set back."""


def in_order(
    time: Array, value: Array, file: CsvFile, where: str
) -> tuple[Array, Array, list[str]]:
    """Sort late rows and drop repeated ones, with a sentence for each kind of repair.

    Raises:
        LogError: the clock was set back, or one time stands on two different rows.
    """
    repairs: list[str] = []
    gaps = np.diff(time)
    late = np.flatnonzero(gaps < 0.0)
    if late.size:
        period = float(np.median(np.abs(gaps)))
        highest = np.maximum.accumulate(time)
        behind = highest - time
        worst = int(np.argmax(behind > LATE_ROWS * period))
        if behind[worst] > LATE_ROWS * period:
            raise LogError(
                file.path,
                f"time goes back from {time[worst - 1]:.6g} s to {time[worst]:.6g} s",
                "split the file where its clock starts anew",
                line=file.line_of(worst),
            )
        order = np.argsort(time, kind="stable")
        time, value = time[order], value[order]
        count = int(np.count_nonzero(behind > 0.0))
        repairs.append(f"{where}: {_rows(count)} out of order sorted by time")
    else:
        order = np.arange(len(time))
    same_time = np.diff(time) == 0.0
    if same_time.any():
        same_row = same_time & (np.diff(value, axis=0) == 0.0).all(axis=1)
        differing = np.flatnonzero(same_time & ~same_row)
        if differing.size:
            row = int(order[differing[0] + 1])
            raise LogError(
                file.path,
                f"time {time[differing[0]]:.9g} s stands on two rows with different values",
                "correct the time, or delete one",
                line=file.line_of(row),
            )
        keep = np.concatenate([[True], ~same_row])
        time, value = time[keep], value[keep]
        repairs.append(f"{where}: {_rows(int(same_row.sum()))} that repeat the one before dropped")
    return time, value, repairs


def _rows(count: int) -> str:
    return f"{count} row" if count == 1 else f"{count} rows"
