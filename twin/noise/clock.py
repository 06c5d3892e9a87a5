"""What the stamps of a stream say of its clock: period, jitter, gaps, rows that repeat."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.recording import Series

Array = NDArray[np.float64]

GAP = 1.5
"""An interval longer than this many periods has lost samples."""


@dataclass(frozen=True)
class SampleClock:
    """How regularly a stream was sampled."""

    period: float
    """Median interval [s]; NaN with fewer than two rows."""
    jitter: float
    """Rms of the intervals about the period, those over gaps left out [s]."""
    gaps: int
    """Intervals longer than GAP periods."""
    lost: int
    """Samples that would fill them."""
    longest_gap: float
    """[s]; 0 without gaps."""
    repeated: float
    """Share of the rows that repeat the one before in every column: a sensor slower than its log,
    or one that stands still on its grid."""


def clock_of(series: Series) -> SampleClock:
    """Measure the clock of a stream."""
    if len(series) < 2:
        return SampleClock(float("nan"), 0.0, 0, 0, 0.0, 0.0)
    intervals = np.diff(series.time)
    period = float(np.median(intervals))
    wide = intervals > GAP * period
    regular = intervals[~wide] - period
    repeats = (np.diff(series.value, axis=0) == 0.0).all(axis=1)
    return SampleClock(
        period,
        float(np.sqrt(np.mean(np.square(regular)))) if len(regular) else 0.0,
        int(wide.sum()),
        int(np.round(intervals[wide] / period - 1.0).sum()),
        float(intervals[wide].max(initial=0.0)),
        float(repeats.mean()),
    )
