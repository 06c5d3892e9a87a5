"""Samples of a sensor that is slower than its log: its values held, or joined by straight lines.

A 10 Hz sensor in a 100 Hz log gives one measurement in ten rows; the other nine repeat it or are
interpolated. Taken as measurements they count one error ten times. The measurements follow each
other at a steady rate, and from one to the next the value jumps by several steps of its grid. A
coarse counter passes every step, so a body at rest or in slow motion is not mistaken for one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.noise.quantisation import resolution_of
from twin.noise.stream import angles
from twin.recording import Series
from twin.signals import OF_MOTION

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SLOW = (*OF_MOTION, "accelerometer", "magnetometer", "wheel_speed")
"""Streams that a slow sensor may hold. A stage and a gimbal may really stay where they are."""
FEWEST = 20
"""Measurements that a stream must hold before its rate can be called steady."""
LEAST = 0.1
"""Share of the rows that must be no measurements."""
COUNT = 10
"""Measurements over which the rate is taken: an interval alone varies by a row of the log."""
UNSTEADY = 0.05
"""Share by which the time of COUNT measurements may vary, besides one row of the log."""
STEADY = 0.9
"""Share of the log in which the rate must be steady: the sensor may have hung now and then."""
STEPS = 3.0
"""Steps of the grid by which measurements of a held stream differ, in the median."""
ROUNDED = 1e-7
"""Of the largest value: rounding by which an interpolated value may miss its line."""
STRAIGHT = 0.3
"""Share of the rows that must lie on a line."""
BENT = 30.0
"""Times the rounding by which a stream leaves the line at its measurements, in the median."""


@dataclass(frozen=True)
class SlowSensor:
    """The measurements in a stream whose sensor is slower than its log."""

    measured: Mask
    """(m,) rows that hold a measurement of their own."""
    rate: float
    """Of the measurements [Hz]."""
    interpolated: bool
    """The other rows lie on straight lines between measurements; else they repeat them."""


def slow_sensor(series: Series) -> SlowSensor | None:
    """The measurements of a stream, where other rows only repeat or interpolate them.

    Args:
        series: m rows of a sensor.

    Returns:
        None where every row may be a measurement.
    """
    for measured, interpolated in ((_first_of_each_value(series), False), (_knots(series), True)):
        if measured is None or np.count_nonzero(~measured) < LEAST * len(series):
            continue
        rate = _steady_rate(series.time, measured)
        if rate:
            return SlowSensor(measured, rate, interpolated)
    return None


def measurements(name: str, series: Series) -> Series:
    """The rows of a stream that hold a measurement of their own."""
    slow = slow_sensor(series) if name in SLOW else None
    return series if slow is None else series.only(slow.measured)


def _first_of_each_value(series: Series) -> Mask | None:
    """(m,) rows that differ from the one before; None where a coarse grid explains the others."""
    changed = np.r_[True, (np.diff(series.value, axis=0) != 0.0).any(axis=1)]
    if np.count_nonzero(changed) < FEWEST or changed.all():
        return None
    jump = np.abs(np.diff(series.value[changed], axis=0))
    grid = np.array([resolution_of(column) for column in series.value.T])
    steps = np.where(grid > 0.0, jump / np.where(grid > 0.0, grid, 1.0), np.inf)
    steps[jump == 0.0] = 0.0
    return changed if np.median(steps.max(axis=1)) >= STEPS else None


def _knots(series: Series) -> Mask | None:
    """(m,) rows at which straight lines meet; None where the stream is not made of lines."""
    if len(series) < 2 * FEWEST:
        return None
    attitude = series.columns == ("w", "x", "y", "z")
    # an attitude is interpolated in its components, or along the turn between two attitudes
    for value in (series.value, angles(series.value)) if attitude else (series.value,):
        bend = _bend(series.time, value)
        bent = bend > 1.0
        # a knot between two rows bends the stream at both; the nearer row bends more
        nearest = bent & (bend >= np.r_[bend[1:], 0.0]) & (bend > np.r_[0.0, bend[:-1]])
        alone = ~bent | nearest | np.r_[nearest[1:], False] | np.r_[False, nearest[:-1]]
        if np.count_nonzero(nearest) < FEWEST or np.mean(~bent) < STRAIGHT:
            continue
        if alone.mean() > STEADY and np.median(bend[nearest]) > BENT:
            nearest[[0, -1]] = True
            return nearest
    return None


def _bend(time: Array, value: Array) -> Array:
    """(m,) by how many times the rounding a row is off the line through its neighbours, in the
    column (m, k) in which it is furthest; 0 at both ends."""
    before, after = np.diff(time)[:-1, None], np.diff(time)[1:, None]
    line = (value[:-2] * after + value[2:] * before) / (before + after)
    grid = np.array([resolution_of(column) for column in value.T])
    rounding = np.maximum(ROUNDED * np.abs(value).max(axis=0), 2.0 * grid)
    off = np.abs(value[1:-1] - line) / np.where(rounding > 0.0, rounding, 1.0)
    return np.r_[0.0, off.max(axis=1), 0.0]


def _steady_rate(time: Array, measured: Mask) -> float:
    """Rate of the measurements [Hz]; 0 where they come at no steady rate."""
    index = np.flatnonzero(measured)
    if len(index) < FEWEST:
        return 0.0
    spans = time[index[COUNT:]] - time[index[:-COUNT]]
    usual = float(np.median(spans))
    period = float(np.median(np.diff(time)))
    steady = np.abs(spans - usual) <= UNSTEADY * usual + 1.001 * period
    # by rows, so that a long rest counts as long as it is and a pause of the log does not
    rows = index[COUNT:] - index[:-COUNT]
    if rows[steady].sum() < STEADY * rows.sum() or usual < (1.0 + LEAST) * COUNT * period:
        return 0.0
    return COUNT / usual
