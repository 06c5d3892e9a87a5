"""The noise of one stream, from its own samples: white, quantised, slow; clock and outliers.

Angles of which a pulse a turn is all that is known: events, and no grid of 360 deg.

Of such a counter each row but a change of it says only that less than a turn went by. When it
changes, the index mark has just passed, and there the angle is a whole number of turns to within
the rate times the sampling interval.

Slow noise of a sensor at rest: Allan deviation, and what it is made of.
Over an averaging time tau, white noise N, bias instability B and rate random walk K add up to

    sigma^2(tau) = N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3

IEEE Std 952-1997, annex C. The deviation is the overlapping one of its C.1.

White noise of a moving signal: what is left of it when the motion has been differenced away.
The fourth divided difference over samples that lie `stride` apart takes every cubic out of a signal
and, scaled to unit weights, leaves white noise at sigma whatever the stride. All else grows with
the stride: a random walk (a wheel driven by a noisy law) with its first power, an integrated one
with the third, smooth motion with the eighth. So the white part is what does not grow, found by
non-negative least squares over the strides.

Gasser, Sroka and Jennen-Steinmetz, Residual variance and residual pattern in nonlinear regression,
Biometrika 73 (1986), have the divided difference with unit weights, for any spacing of the samples.

Which samples no noise explains: one rule, fixed before any fit sees the data.
Hampel's identifier: a sample is an outlier when it lies farther from what its neighbours make of it
than 6 robust sigmas (1.4826 times the median of all such distances), and farther than any of them.
The median is moved by nothing short of half the samples, so outliers cannot hide each other as they
do behind a standard deviation; and Gaussian noise goes beyond 6 sigma once in 5e8 samples, so in a
log of any length a flag is news.

F. R. Hampel, The influence curve and its role in robust estimation, J. Am. Stat. Assoc. 69 (1974).
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from twin import rotation
from twin.recording import Series

ANGLES = ("joint_angle", "gimbal_angle")
"""Streams of angles that may turn round and round."""
TURN = 2.0 * np.pi
EXACT = 1e-6
"""Of a turn, by which a count of turns may be off in another unit."""
MIN_CHANGES = 4
"""Changes of the count."""


def counts_turns(series: Series) -> bool:
    """Whether an angle (m, 1) [rad] only ever changes by whole turns, one at a time."""
    if series.unit != "rad" or len(series.columns) != 1:
        return False
    steps = np.diff(series.value[:, 0]) / TURN
    turns = np.round(steps)
    passed = turns != 0.0
    return bool(
        np.count_nonzero(passed) >= MIN_CHANGES
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


Array = NDArray[np.float64]


FLATNESS = 2.0 * np.log(2.0) / np.pi
SEEN = 3.0
"""A part is seen when it is this many times its own standard deviation."""
AVERAGES = 9
"""The longest averaging time leaves at least so many averages; fewer scatter by over a third."""


@dataclass(frozen=True)
class SlowNoise:
    """The parts of a column's Allan deviation; NaN where the log is too short to see one."""

    start: float
    """Of the stretch at rest [s]."""
    stop: float
    """[s]."""
    tau: Array
    """(t,) averaging times [s]."""
    deviation: Array
    """(t, k) Allan deviation, in the stream's unit."""
    random_walk: Array
    """(k,) N: angle random walk of a gyro [unit sqrt(s)]."""
    bias_instability: Array
    """(k,) B [unit]."""
    rate_random_walk: Array
    """(k,) K [unit / sqrt(s)]."""


def slow_noise(time: Array, value: Array) -> SlowNoise:
    """Allan deviation of (m, k) values at rest, m at least 3 AVERAGES."""
    period = float(np.median(np.diff(time)))
    sizes = 2 ** np.arange(int(np.log2(len(time) / AVERAGES)) + 1)
    deviation = np.sqrt(np.array([_allan_variance(value, int(size)) for size in sizes]))
    tau = sizes.astype(np.float64) * period
    parts = np.array([_parts(tau, column, len(time) / sizes) for column in deviation.T])
    walk, flat, ramp = np.sqrt(parts.T)
    return SlowNoise(float(time[0]), float(time[-1]), tau, deviation, walk, flat, ramp)


def _allan_variance(value: Array, size: int) -> Array:
    sums = np.concatenate([np.zeros((1, value.shape[1])), np.cumsum(value, axis=0)])
    means = (sums[size:] - sums[:-size]) / size
    return 0.5 * np.mean(np.square(means[size:] - means[:-size]), axis=0)


def _parts(tau: Array, deviation: Array, averages: Array) -> Array:
    """(3,) N^2, B^2, K^2 by weighted non-negative least squares; NaN where not seen."""
    if not deviation.all():
        return np.full(3, np.nan)
    # an Allan variance over a averages scatters by about sqrt(2 / (a - 1)) of itself
    scatter = np.square(deviation) * np.sqrt(2.0 / (averages - 1.0))
    design = np.stack([1.0 / tau, np.full_like(tau, FLATNESS), tau / 3.0], axis=-1)
    rows = design / scatter[:, None]
    parts = cast(Array, nnls(rows, np.square(deviation) / scatter)[0])
    spread = np.sqrt(np.diag(np.linalg.pinv(rows.T @ rows)))
    return np.where(parts > SEEN * spread, parts, np.nan)


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


ORDER = 4
STRIDES = (1, 2, 3, 4, 6, 8, 12, 16)
BLOCKS = 20
"""The median of so many stretches is taken, so that a bump in one of them counts for nothing."""
SHORTEST_BLOCK = 50
"""[samples]."""
COLOURED = 0.25
"""The white part is never taken for less than this share of the least variance."""
MOTION = 30.0
"""Strides at which the variance is more than this times the least show motion, not noise."""

SHORT = 4
"""Longest stride of the mean. Longer ones would make it a tenth sharper, and they see how a control
law answers the noise: a percent more, too little to be told from chance in one log."""

FLAT = 3.0
"""Standard deviations by which the variance at a stride must exceed that at shorter ones to have
grown."""


def white_noise(time: Array, value: Array) -> tuple[Array, Array]:
    """White noise of each column, 1 sigma a sample, and how well it is known.

    Args:
        time: (m,) [s], in order; uneven spacing and gaps do no harm.
        value: (m, k).

    Returns:
        (k,) sigma; zeros where there are no more than ORDER rows. (k,) the share of the samples
        that would tell as much of sigma were they nothing but noise.
    """
    strides = [stride for stride in STRIDES if len(time) > ORDER * stride]
    enough = [stride for stride in strides if len(time) > ORDER * stride + SHORTEST_BLOCK]
    strides = enough or strides[:1]
    if not strides:
        return np.zeros(value.shape[1]), np.full(value.shape[1], _worth(1))
    variances = np.array([_difference_variance(time, value, stride) for stride in strides])
    growth = np.array([_growth(stride) for stride in strides])
    spread = float(np.sqrt(2.0 / (len(time) * _worth(1))))
    short = sum(stride <= SHORT for stride in strides)
    flat = [_flat(column[:short], spread) for column in variances.T]
    # Held to be no less than nothing, growth that is not there would take its share of the noise.
    sigma = [
        np.sqrt(column[:count].mean()) if count > 1 else _constant_part(column, growth)
        for column, count in zip(variances.T, flat, strict=True)
    ]
    return np.array(sigma), np.array([_worth(count) for count in flat])


def _flat(variance: Array, spread: float) -> int:
    """How many of the first strides show no growth, their variances known to a share of them."""
    for count in range(1, len(variance)):
        if variance[count] > (1.0 + FLAT * spread) * variance[:count].mean():
            return count
    return len(variance)


@cache
def _worth(strides: int) -> float:
    """Independent squares a sample, in the mean over so many strides of medians over blocks."""
    taps = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(_SQUARED_WEIGHTS)
    filters: list[Array] = []
    for stride in STRIDES[:strides]:
        spaced = np.zeros(ORDER * stride + 1)
        spaced[::stride] = taps
        filters.append(spaced)
    alike = np.array(
        [[np.sum(np.square(np.convolve(a, b[::-1]))) for a in filters] for b in filters]
    )
    # Medians of normal variables that correlate by r vary together as asin(r), means as r.
    return float(1.0 / np.mean(alike[0, 0] * np.arcsin(np.minimum(alike / alike[0, 0], 1.0))))


def _difference_variance(time: Array, value: Array, stride: int) -> Array:
    """(k,) variance of the scaled difference: the median over stretches of the log."""
    taps = ORDER + 1
    count = len(time) - ORDER * stride
    times = np.stack([time[j * stride : j * stride + count] for j in range(taps)])
    span = times[-1] - times[0]
    weights = np.empty_like(times)
    for j in range(taps):
        apart = np.delete(times, j, axis=0) - times[j]
        weights[j] = span**ORDER / np.prod(apart, axis=0)
    weights /= np.sqrt(np.sum(np.square(weights), axis=0))
    difference = np.zeros((count, value.shape[1]))
    for j in range(taps):
        difference += weights[j][:, None] * value[j * stride : j * stride + count]
    squares = np.square(difference[span < 1.5 * np.median(span)])
    blocks = int(np.clip(len(squares) // SHORTEST_BLOCK, 1, BLOCKS))
    means = np.array([block.mean(axis=0) for block in np.array_split(squares, blocks)])
    # Neighbouring differences overlap: a block's mean scatters as chi2 of so many degrees.
    freedom = len(squares) / blocks * _SHARE
    bias = (1.0 - 2.0 / (9.0 * freedom)) ** 3 if blocks > 2 else 1.0
    return np.median(means, axis=0) / max(bias, 0.5)


_SHARE = 0.36
"""Independent squares a fourth difference: C(8, 4)^2 / C(16, 8)."""


@cache
def _growth(stride: int) -> tuple[float, ...]:
    """Variance of the scaled difference of white noise, of its once and twice running sum, and of
    smooth motion, relative to stride 1 for the last."""
    omega = (np.arange(4096) + 0.5) / 4096 * np.pi
    gain = (2.0 * np.sin(0.5 * stride * omega)) ** (2 * ORDER) / _SQUARED_WEIGHTS
    once = 4.0 * np.sin(0.5 * omega) ** 2
    return (
        1.0,
        float(np.mean(gain / once)),
        float(np.mean(gain / once**2)),
        float(stride) ** (2 * ORDER),
    )


_SQUARED_WEIGHTS = 70.0
"""C(8, 4): sum of the squares of 1 -4 6 -4 1."""


def _constant_part(variance: Array, growth: Array) -> float:
    if not variance.any():
        return 0.0
    used = variance <= MOTION * max(float(variance[0]), float(variance.min()))
    # each variance is known to a share of itself
    rows = growth[used] / np.maximum(variance[used], 1e-300)[:, None]
    parts = cast(Array, nnls(rows, np.ones(len(rows)))[0])
    # Noise that a sensor's own filter has smoothed grows from the start, and would leave nothing.
    return float(np.sqrt(max(parts[0], COLOURED * variance.min())))


SIGMAS = 6.0
REACH = 2
"""Neighbours on either side; the cubic through them is what they make of the sample."""
ON_A_GRID = np.sqrt(70.0 / 36.0 / 12.0)
"""Sigma of the distance when every value is off by up to half a step."""


def outliers(value: Array, resolution: Array) -> NDArray[np.bool_]:
    """(m,) rows of which any column of (m, k) values is an outlier.

    The sigma of a column on a grid of step `resolution` (k,) is no less than the grid makes it. One
    that scatters in fewer than half its samples has no noise to be held against, and none.
    """
    flagged = np.zeros(len(value), dtype=np.bool_)
    if len(value) <= 2 * REACH:
        return flagged
    near = value[1:-3] + value[3:-1]
    far = value[:-4] + value[4:]
    distance = np.abs(value[REACH:-REACH] - (4.0 * near - far) / 6.0)
    sigma = 1.4826 * np.median(distance, axis=0)
    limit = SIGMAS * np.maximum(sigma, resolution * ON_A_GRID)
    suspect = (distance > limit) & (sigma > 0.0)
    if not suspect.any():
        return flagged
    padded = np.pad(distance, ((REACH, REACH), (0, 0)))
    around = [padded[k : k + len(distance)] for k in range(2 * REACH + 1)]
    worst = distance >= np.max(around, axis=0)
    flagged[REACH:-REACH] = (suspect & worst).any(axis=1)
    return flagged


OFF_GRID = 0.01
"""Of a step: how far from the grid rounding in another unit may leave a value."""


def resolution_of(column: Array) -> float:
    """The step of the grid on which all values of a column lie; 0 where there is none.

    The step is the smallest distance between two different values, if every other distance is a
    whole number of it. A column of one value, or two, shows no grid.
    """
    steps = np.diff(np.unique(column))
    if len(steps) < 2:
        return 0.0
    # the same value written in another unit differs in its last bits
    alike = 64.0 * np.finfo(np.float64).eps * float(np.abs(column).max())
    steps = steps[steps > alike]
    if len(steps) < 2:
        return 0.0
    smallest = float(steps.min())
    counts = np.round(steps / smallest)
    # the mean over all distances sharpens the step beyond the rounding of the smallest one
    step = float(steps.sum() / counts.sum())
    off = np.abs(steps / step - np.round(steps / step))
    tolerance = max(OFF_GRID, 2.0 * alike / step)
    return step if tolerance < 0.1 and float(off.max()) < tolerance else 0.0


Mask = NDArray[np.bool_]

FLOOR = 1e-12
"""No noise is taken for less, so that it can be divided by."""
HELD = 0.2
"""When more rows than this repeat the one before, the sensor is slower than its log."""
AT_REST = 1.5
"""A stretch is at rest while it scatters by less than this times the white noise."""
REST = 500
"""Shortest stretch at rest of which the slow noise is worth a look [samples]."""


@dataclass(frozen=True)
class StreamNoise:
    """How a stream scatters. k columns; of an attitude three: a rotation about body axes [rad]."""

    white: Array
    """(k,) 1 sigma a sample; never below what the quantisation leaves, step / sqrt(12)."""
    resolution: Array
    """(k,) step of the grid on which the values lie; 0 without one."""
    clock: SampleClock
    outliers: Mask
    """(m,) rows that no noise explains, or that are no numbers; left out of `white`."""
    slow: SlowNoise | None
    """From the longest stretch at rest; None where there is none."""

    @property
    def quantised(self) -> Mask:
        """(k,) whether the grid makes most of the noise: its errors are neither white nor normal
        while the signal stands still."""
        return self.resolution / np.sqrt(12.0) > np.sqrt(0.5) * self.white


def noise_of(series: Series) -> Array:
    """White noise of a stream, 1 sigma a sample: (k,), or (3,) of an attitude [rad]."""
    return _white(series)[0]


def noise_and_worth(series: Series) -> tuple[Array, Array]:
    """The same, and the share of the samples that would tell as much of it were they all noise."""
    white, worth, *_ = _white(series)
    return white, worth


def noise_left(time: Array, value: Array, left: Array) -> tuple[Array, Array]:
    """The same of a stream whose motion is known.

    Args:
        time: (m,) [s].
        value: (m, k) as measured, or (m, 4) of an attitude.
        left: (m, k) measured less predicted, in the stream's unit; of an attitude (m, 3) [rad].

    Returns:
        (k,) white noise, 1 sigma a sample, and (k,) what it is worth.
    """
    white, worth = white_noise(time, left)
    return _no_less_than_rounding(white, _resolution(value, left.shape[1])), worth


def measure_noise(series: Series) -> StreamNoise:
    """Everything that a stream says of its own noise."""
    white, _, resolution, flagged, moved = _white(series)
    return StreamNoise(
        white, resolution, clock_of(series), flagged, _slow(series, moved, white, flagged)
    )


def _white(series: Series) -> tuple[Array, Array, Array, Mask, Array]:
    """White noise, what it is worth, resolution, outliers, and the values as numbers that
    differences make sense of."""
    attitude = series.columns == ("w", "x", "y", "z")
    finite = np.isfinite(series.value).all(axis=1)
    resolution = _resolution(series.value[finite], 3 if attitude else len(series.columns))
    value = np.full((len(series), len(resolution)), np.nan)
    value[finite] = angles(series.value[finite]) if attitude else series.value[finite]
    flagged: Mask = np.logical_not(finite)
    flagged[finite] = outliers(value[finite], resolution)
    white, worth = white_noise(series.time[~flagged], value[~flagged])
    fresh = np.concatenate([[True], (np.diff(series.value, axis=0) != 0.0).any(axis=1)])
    if 1.0 - fresh.mean() > HELD and np.all(resolution <= white):
        kept = fresh & ~flagged
        white, worth = white_noise(series.time[kept], value[kept])
    return _no_less_than_rounding(white, resolution), worth, resolution, flagged, value


def _resolution(value: Array, k: int) -> Array:
    """(k,) steps of a stream (m, k), or of the turns of an attitude (m, 4).

    A step of one turn is that of an index mark's passages, which are exact.
    """
    steps = np.array([resolution_of(column) for column in value.T])
    steps = np.where(np.abs(steps / TURN - 1.0) < 1e-6, 0.0, steps)
    # a rotation vector is twice the vector part of its quaternion
    return steps if len(steps) == k else np.full(k, 2.0 * steps.max(initial=0.0))


def _no_less_than_rounding(white: Array, resolution: Array) -> Array:
    least = np.maximum(resolution / np.sqrt(12.0), FLOOR)
    return np.where(white > least, white, least)


def angles(attitude: Array) -> Array:
    """(m, 3) running sum of the turns from one attitude (m, 4) to the next, in body axes [rad].

    No attitude in itself, but its differences are those of the noise: each turn holds the error of
    its end minus that of its start.
    """
    turns = rotation.to_rotation_vector(
        rotation.multiply(rotation.conjugate(attitude[:-1]), attitude[1:])
    )
    return np.concatenate([np.zeros((min(len(attitude), 1), 3)), np.cumsum(turns, axis=0)])


def _slow(series: Series, value: Array, white: Array, flagged: Mask) -> SlowNoise | None:
    """Allan deviation of the longest stretch in which every column only scatters."""
    size = REST // 10
    count = len(value) // size
    if count < REST // size:
        return None
    kept = value.copy()
    kept[flagged] = np.nan
    blocks = kept[: count * size].reshape(count, size, -1)
    scatter, level = np.nanstd(blocks, axis=1), np.nanmean(blocks, axis=1)
    still = (scatter < AT_REST * white).all(axis=1)
    # At rest the level stays; 10 standard errors leave room for the drift of a bias.
    same = (np.abs(np.diff(level, axis=0)) < 10.0 * white / np.sqrt(size)).all(axis=1)
    first, last = _longest_run(still, same)
    stretch = slice(first * size, last * size)
    if (last - first) * size < REST:
        return None
    wander = np.std(level[first:last], axis=0)
    if (wander > 10.0 * white / np.sqrt(size)).any():
        return None
    good = ~flagged[stretch]
    return slow_noise(series.time[stretch][good], value[stretch][good])


def _longest_run(still: Mask, same: Mask) -> tuple[int, int]:
    """First and one past the last of the longest row of still blocks at the same level."""
    best, start = (0, 0), None
    for index, quiet in enumerate(still):
        if not quiet:
            start = None
            continue
        if start is None or not same[index - 1]:
            start = index
        if index + 1 - start > best[1] - best[0]:
            best = (start, index + 1)
    return best
