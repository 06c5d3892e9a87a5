"""Rows that repeat: a dead axis, a sensor that hung, a slower sensor, the end of a range.

What a sensor that hung repeats: rows that noise would have changed, and that did not change.
Noise carries a value out of its step of the grid with a known chance, so a row that repeats the one
before in every column says little, and a long stretch of them says that nobody measured. A stream
whose grid hides its noise may honestly stand still, and nothing is said of it.

One axis of a sensor that keeps a value while the others go on: a broken wire, a dead channel.
The axes of one sensor scatter alike. An axis that repeats its value for longer than the scatter of
the other axes allows, and than its own where it is alive, gives no measurements meanwhile. Where
the grid hides the scatter, an axis may really keep its value, and nothing is said of it.

Samples of a sensor that is slower than its log: its values held, or joined by straight lines.
A 10 Hz sensor in a 100 Hz log gives one measurement in ten rows; the other nine repeat it or are
interpolated. Taken as measurements they count one error ten times. The measurements follow each
other at a steady rate, and from one to the next the value jumps by several steps of its grid. A
coarse counter passes every step, so a body at rest or in slow motion is not mistaken for one.

Samples at the end of a sensor's range, where nobody stated the range.
Beyond its range a sensor gives the same extreme value again and again. Noise would have changed
that value, and a sensor that hung repeats any value, rarely the largest one of the log. Where a
coarse grid hides the noise, only an extreme value far more frequent than all others counts.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.noise.stream import angles, measure_noise, noise_of, resolution_of
from twin.recording import Series
from twin.signals import OF_MOTION

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]


MIN_MISSING = 5
"""Fresh values that a stretch must lack, or it is no more than a hiccup."""
CHANCE = 1e-9
"""Of a stretch that noise leaves alone, over all the rows of a log."""
ROUNDED_NOISE = 1e-9
"""Of the largest value: what scatters by less does so by rounding, and is no sensor's noise."""
QUIET = 1e-6
"""Of the largest value: a column with less noise than this is computed, not measured."""
USUAL = 0.95
"""Quantile of the rows for which a value is held that a sensor slower than its log holds it."""
LEAP = 3.0
"""Times the largest other step by which a part's speed must jump after such a stretch: a wheel that
coasts, unlike a body on a ball of air, may keep to a number."""


def stopped(series: Series, *, steady: bool = False) -> Mask:
    """Rows that repeat what a sensor read when it hung.

    Args:
        series: m rows of a sensor.
        steady: what it measures may honestly stay the same.

    Returns:
        (m,); the first row of a stretch is not one of them.
    """
    lost = np.zeros(len(series), dtype=np.bool_)
    first, held = runs_of(series.value)
    if held.max(initial=0) <= MIN_MISSING:
        return lost
    repeats = _chance_of_a_repeat(series)
    if repeats == 1.0:
        return lost
    needed = repeats_needed(repeats, len(series))
    usual = usual_run(held)
    step = np.abs(np.diff(series.value[first], axis=0))
    for index in np.flatnonzero(held > usual * max(MIN_MISSING, needed)):
        if steady and not _leaps(step, int(index)):
            continue
        lost[first[index] + 1 : first[index] + held[index]] = True
    return lost


def _chance_of_a_repeat(series: Series) -> float:
    """That all columns of a row fall into the step of the grid in which the last one was."""
    noise = measure_noise(series)
    if series.columns == ("w", "x", "y", "z"):
        peak = np.full(3, np.pi)
    else:
        peak = np.abs(series.value).max(axis=0)
    told = ~noise.quantised & (noise.white > ROUNDED_NOISE * peak)
    chance = noise.resolution[told] / (2.0 * np.sqrt(np.pi) * noise.white[told])
    return float(np.prod(np.minimum(chance, 1.0)))


def runs_of(value: Array | Mask) -> tuple[Rows, Rows]:
    """First rows and lengths of the runs of equal rows in (m, k)."""
    changes = (value[1:] != value[:-1]).any(axis=1)
    first = np.flatnonzero(np.r_[np.ones(min(len(value), 1), dtype=np.bool_), changes])
    return first, np.diff(np.r_[first, len(value)])


def usual_run(lengths: Rows) -> float:
    """Rows for which a sensor, perhaps slower than its log, holds a value."""
    return float(np.quantile(lengths, USUAL, method="inverted_cdf"))


def chance_of_a_repeat(grid: float, noise: float, peak: float) -> float:
    """That noise leaves one value in its step of the grid; 1 where that cannot be known.

    Args:
        grid: step of the values; 0 without one.
        noise: white, 1 sigma a sample. A grid may hide it.
        peak: largest size of a value. With hardly any noise beside it, values are computed.
    """
    if grid / np.sqrt(12.0) > np.sqrt(0.5) * noise or noise <= QUIET * peak:
        return 1.0
    return min(grid / (2.0 * np.sqrt(np.pi) * noise), 1.0)


def repeats_needed(chance: float, rows: int) -> float:
    """How many repeats in a row are beyond CHANCE anywhere in a log of so many rows."""
    return float(np.log(CHANCE / rows) / np.log(chance)) if chance > 0.0 else 0.0


def _leaps(step: Array, index: int) -> bool:
    """Whether a stretch ends in a jump. `step` (stretches - 1, k) is from each to the next."""
    if index >= len(step):
        return False
    others = np.delete(step, index, axis=0).max(axis=0)
    return bool((step[index] > LEAP * others).any())


OF_AXES = ("gyro", "accelerometer", "magnetometer", "inclinometer")
"""Streams of sensors with several axes of one kind."""
MIN_ROWS = 50
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
        long = length > MIN_ROWS
        if not len(others) or not long.any():
            continue
        repeat = float(repeats[others].max())
        if alive[column]:
            repeat = max(repeat, _chance_in(series.only(~np.repeat(long, length)), column))
        if repeat == 1.0:
            continue
        needed = max(TIMES, repeats_needed(repeat, len(series)))
        usual = usual_run(length) if alive[column] else 1.0
        result = long & (length > usual * needed)
        stuck[:, column] = result.repeat(length)
    return stuck


def dead_axes(series: Series) -> tuple[str, ...]:
    """Axes that are stuck in all rows of a sensor, or nearly all."""
    if len(series.columns) < 2 or len(series) <= MIN_ROWS:
        return ()
    share = stuck_rows(series).mean(axis=0)
    return tuple(
        name for name, part in zip(series.columns, share.tolist(), strict=True) if part >= DEAD
    )


def _chance_in(series: Series, column: int) -> float:
    """That noise leaves a column in its step of the grid; 1 where that cannot be known."""
    values = series.value[:, column]
    if len(values) <= MIN_ROWS:
        return 1.0
    part = replace(series, value=values[:, None], columns=series.columns[column : column + 1])
    peak = float(np.abs(values).max())
    return chance_of_a_repeat(resolution_of(values), float(noise_of(part)[0]), peak)


SLOW = (*OF_MOTION, "accelerometer", "magnetometer", "wheel_speed")
"""Streams that a slow sensor may hold. A stage and a gimbal may really stay where they are."""
MIN_MEASURED = 20
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
ROUNDED_VALUE = 1e-7
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
    if np.count_nonzero(changed) < MIN_MEASURED or changed.all():
        return None
    jump = np.abs(np.diff(series.value[changed], axis=0))
    grid = np.array([resolution_of(column) for column in series.value.T])
    steps = np.where(grid > 0.0, jump / np.where(grid > 0.0, grid, 1.0), np.inf)
    steps[jump == 0.0] = 0.0
    return changed if np.median(steps.max(axis=1)) >= STEPS else None


def _knots(series: Series) -> Mask | None:
    """(m,) rows at which straight lines meet; None where the stream is not made of lines."""
    if len(series) < 2 * MIN_MEASURED:
        return None
    attitude = series.columns == ("w", "x", "y", "z")
    # an attitude is interpolated in its components, or along the turn between two attitudes
    for value in (series.value, angles(series.value)) if attitude else (series.value,):
        bend = _bend(series.time, value)
        bent = bend > 1.0
        # a knot between two rows bends the stream at both; the nearer row bends more
        nearest = bent & (bend >= np.r_[bend[1:], 0.0]) & (bend > np.r_[0.0, bend[:-1]])
        alone = ~bent | nearest | np.r_[nearest[1:], False] | np.r_[False, nearest[:-1]]
        if np.count_nonzero(nearest) < MIN_MEASURED or np.mean(~bent) < STRAIGHT:
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
    rounding = np.maximum(ROUNDED_VALUE * np.abs(value).max(axis=0), 2.0 * grid)
    off = np.abs(value[1:-1] - line) / np.where(rounding > 0.0, rounding, 1.0)
    return np.r_[0.0, off.max(axis=1), 0.0]


def _steady_rate(time: Array, measured: Mask) -> float:
    """Rate of the measurements [Hz]; 0 where they come at no steady rate."""
    index = np.flatnonzero(measured)
    if len(index) < MIN_MEASURED:
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


CLIPPED = ("gyro", "joint_rate", "accelerometer", "magnetometer")
"""Streams whose sensors have a range that the machine can leave. An angle may really stay where it
is largest, at a stop, and a wheel at its largest speed."""
SAME = 1e-9
"""Of a value: rounding that another unit leaves in it."""
LARGE = 0.5
"""Of the largest value of a column, either sign: an end of the range is at least so large. A rate
that is never negative is at rest at its smallest value."""
MIN_CLIPPED = 5
"""Repeated rows at an end, at least."""
NEIGHBOURS = 3
"""Rows on either side of one at an end that are not used. Near an end, only the rows whose noise
points inwards stay off it: used alone, they would bend the motion inwards too."""
SHARE, STRETCH, OFTEN = 0.02, 5, 10.0
"""On a grid that hides the noise: share of the rows at an end, rows of each of at least two
stretches there, and times the rows at the most frequent value that is no end."""


@dataclass(frozen=True)
class RangeEnds:
    """Samples at the ends of a range."""

    rows: Mask
    """(m,) rows in which at least one column is at an end."""
    ends: tuple[float, ...]
    """The values of the ends, in the stream's unit, rising."""


def range_ends(series: Series) -> RangeEnds:
    """The samples at the ends of a range that shows in the data.

    Args:
        series: m rows of a sensor.
    """
    rows = np.zeros(len(series), dtype=np.bool_)
    ends: list[float] = []
    if len(series) <= MIN_CLIPPED or series.stands_still:
        return RangeEnds(rows, ())
    value = series.value
    high, low = value.max(axis=0), value.min(axis=0)
    at_ends: Mask = np.stack([_same(value, high), _same(value, low)])
    inside = ~(at_ends & (high > low)).any(axis=(0, 2))
    noise = noise_of(series.only(inside)) if inside.any() else np.zeros(value.shape[1])
    stuck = np.r_[False, (np.diff(value, axis=0) == 0.0).all(axis=1)]
    stuck &= ~np.all(at_ends[0] | at_ends[1], axis=1)
    for column in range(value.shape[1]):
        peak = max(abs(high[column]), abs(low[column]))
        for end, at in zip((high[column], low[column]), at_ends[:, :, column], strict=True):
            if abs(end) < LARGE * peak or high[column] == low[column]:
                continue
            # a row in which all columns repeat is of a sensor that hung
            at = _without_leaps(value[:, column], at)
            if _is_end(value[:, column], at & ~stuck, at_ends[:, :, column], noise[column], peak):
                rows |= at
                ends.append(float(end))
    return RangeEnds(rows, tuple(sorted(set(ends))))


def with_neighbours(rows: Mask) -> Mask:
    """Rows (m,) at an end of a range, and those too near to it to be used."""
    if not rows.any():
        return rows
    return np.convolve(rows, np.ones(2 * NEIGHBOURS + 1), mode="full")[NEIGHBOURS:-NEIGHBOURS] > 0.5


def _same(value: Array, end: Array) -> Mask:
    return np.abs(value - end) <= SAME * np.abs(end)


def _is_end(column: Array, at: Mask, ends: Mask, noise: float, peak: float) -> bool:
    """Whether the rows `at` an extreme value of a column (m,) repeat it as the end of a range.

    Args:
        column: (m,).
        at: (m,) rows at that value.
        ends: (2, m) rows at the largest and at the smallest value.
        noise: white, 1 sigma a sample, of the other rows.
        peak: largest size of a value.
    """
    others = column[~ends.any(axis=0)]
    lengths = _lengths(at)
    if not len(others) or not len(lengths):
        return False
    grid = resolution_of(others)
    if grid / np.sqrt(12.0) > np.sqrt(0.5) * noise:  # the grid hides the noise
        most = np.unique(others, return_counts=True)[1].max()
        many = np.count_nonzero(at) > max(SHARE * len(at), OFTEN * float(most))
        return bool(many and np.count_nonzero(lengths >= STRETCH) >= 2)
    chance = chance_of_a_repeat(grid, noise, peak)
    if chance == 1.0:
        return False
    usual = usual_run(runs_of(others[:, None])[1])
    repeats = np.maximum(lengths - usual, 0.0).sum()
    return bool(repeats >= usual * max(MIN_CLIPPED, repeats_needed(chance, len(at))))


def _without_leaps(column: Array, at: Mask) -> Mask:
    """Rows (m,) at an extreme value, without stretches after which a column (m,) leaps away.

    A rate comes back into the range where it left it; an axis that was stuck goes on elsewhere.
    """
    first, length = runs_of(at[:, None])
    first, length = first[at[first]], length[at[first]]
    after = first + length
    inside = after < len(at)
    step = np.abs(np.diff(column))
    others = step[~at[1:] & ~at[:-1]].max(initial=0.0)
    kept = at.copy()
    for begin, end in zip(first[inside], after[inside], strict=True):
        if end - begin > MIN_CLIPPED and step[end - 1] > LEAP * others:
            kept[begin:end] = False
    return kept


def _lengths(rows: Mask) -> Rows:
    """Lengths of the stretches of True in (m,)."""
    first, length = runs_of(rows[:, None])
    return length[rows[first]]
