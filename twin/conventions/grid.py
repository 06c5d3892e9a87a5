"""Streams of any rate as means over the cells of one grid, and the offset of a clock."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from weakref import finalize, ref

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from twin import rotation
from twin.noise import noise_of
from twin.recording import Recording, Series

Array = NDArray[np.float64]


CELLS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Widths of a cell [s]."""
USUAL = 0.2
"""No narrower without need [s]."""
KEPT = 0.97
"""A cell is no wider than lets its means keep this share of the gyro's power beyond noise."""
QUIET = 1e-4
"""Nor wider than brings the noise down to this share of the power: what is averaged away is noise,
and two noises multiplied look like evidence."""
LONGEST_LAG = 2.0
"""Clock offsets are looked for up to this [s]."""
FEWEST = 20
"""Cells without which nothing is said."""
MISSED = 3.5
"""Periods between two samples from which on some are missing."""


_MEASURED: dict[int, tuple["ref[Array]", float]] = {}
"""By the values' identity: the times that they had, and their noise."""


def noise_rms(series: Series) -> float:
    """1 sigma of a sample, over all columns. Kept as long as the values are, for every hypothesis
    asks for it, and measuring it takes a third of the time of a check."""
    key = id(series.value)
    known = _MEASURED.get(key)
    if known is not None and known[0]() is series.time:
        return known[1]
    noise = float(np.sqrt(np.mean(np.square(noise_of(series)))))
    if known is None:
        finalize(series.value, _MEASURED.pop, key, None)
    _MEASURED[key] = ref(series.time), noise
    return noise


class Means:
    """A series that can be averaged over any intervals: the integral of its linear interpolation,
    or of what holds until the next row (a command)."""

    def __init__(self, series: Series, *, held: bool = False) -> None:
        finite = np.isfinite(series.value).all(axis=1)
        self.time, value = series.time[finite], series.value[finite]
        if series.columns == ("w", "x", "y", "z") and len(value) > 1:
            # q and -q are one attitude; their mean is none
            value = rotation.continuous(value)
        between = value[:-1] if held else 0.5 * (value[1:] + value[:-1])
        steps = between * np.diff(self.time)[:, None]
        self._integral = np.concatenate([np.zeros((1, value.shape[1])), np.cumsum(steps, axis=0)])
        self.rate = series.rate
        self._series, self._held = series, held

    @cached_property
    def noise(self) -> float:
        """1 sigma of a sample; 0 of what holds."""
        return 0.0 if self._held else noise_rms(self._series)

    def over(self, edges: Array) -> Array:
        """(n, k) means between n + 1 edges [s]."""
        sums = np.empty((len(edges), self._integral.shape[1]))
        for k, column in enumerate(self._integral.T):
            sums[:, k] = np.interp(edges, self.time, column)
        return (sums[1:] - sums[:-1]) / (edges[1:] - edges[:-1])[:, None]

    def covers(self, edges: Array, reach: float = 0.0) -> NDArray[np.bool_]:
        """(n,) cells between n + 1 edges [s] that no gap of the series reaches into, though it be
        shifted by up to `reach` [s]."""
        longest = MISSED / self.rate
        (gaps,) = np.nonzero(np.diff(self.time) > longest)
        first = np.searchsorted(edges, self.time[gaps] - reach, side="right") - 1
        last = np.searchsorted(edges, self.time[gaps + 1] + reach, side="left")
        ends = np.zeros(len(edges) + 1, dtype=np.intp)
        np.add.at(ends, np.clip(first, 0, len(edges)), 1)
        np.add.at(ends, np.clip(last, 0, len(edges)), -1)
        return np.cumsum(ends)[: len(edges) - 1] == 0

    def cell_noise(self, cell: float) -> float:
        """1 sigma of a mean over `cell` [s]."""
        return self.noise / np.sqrt(max(self.rate * cell, 1.0))


@dataclass(frozen=True)
class CellGrid:
    """Cells between the latest start and the earliest end of the streams, less the longest lag."""

    start: float
    cell: float
    count: int
    longest_lag: float

    @property
    def edges(self) -> Array:
        """(count + 1,) [s]."""
        return self.start + self.cell * np.arange(self.count + 1, dtype=np.float64)

    @property
    def around_edges(self) -> Array:
        """(count + 2,) edges of the cells that have `edges` for their centres."""
        return self.start + self.cell * (np.arange(self.count + 2, dtype=np.float64) - 0.5)


def between_centres(grid: CellGrid, fixed: Means, shifted: Means | None) -> NDArray[np.bool_]:
    """(count,) steps from the centre of a cell to the next over which nothing is interpolated
    across a gap; all of them, where too few are left to say anything.

    Args:
        grid: of the cells.
        fixed: a stream.
        shifted: one whose times are tried up to the longest lag off.
    """
    edges = grid.around_edges
    covered = fixed.covers(edges)
    if shifted is not None:
        covered &= shifted.covers(edges, grid.longest_lag)
    kept = covered[1:] & covered[:-1]
    return kept if np.count_nonzero(kept) >= FEWEST else np.ones(len(kept), dtype=np.bool_)


RAREST = 30.0
"""Between samples [s]; what comes more rarely shows no motion of such a body, or its times are in
another unit."""


def grid_of(recording: Recording, *streams: str, narrowest: float | None = None) -> CellGrid | None:
    """The grid on which these streams can be compared; None where they share too little time.

    Its cells are as wide as the body's motion allows, or `narrowest` [s] and a sample wide.
    """
    if any(name not in recording or len(recording[name]) < FEWEST for name in streams):
        return None
    start = max(float(recording[name].time[0]) for name in streams)
    stop = min(float(recording[name].time[-1]) for name in streams)
    slowest = max(1.0 / recording[name].rate for name in streams)
    if slowest > RAREST:
        return None
    cell = max(narrowest, slowest) if narrowest else _cell(recording)
    longest = min(LONGEST_LAG, 0.1 * max(stop - start, 0.0))
    margin = longest + max(cell, slowest)
    count = int((stop - start - 2.0 * margin) / cell)
    return CellGrid(start + margin, cell, count, longest) if count >= FEWEST else None


def _cell(recording: Recording) -> float:
    """As wide as the body's motion allows and its noise asks for."""
    name = next((n for n in ("gyro", "joint_rate") if n in recording), None)
    if name is None or len(recording[name]) < FEWEST:
        return CELLS[-1]
    means = Means(recording[name])
    start, stop = float(means.time[0]), float(means.time[-1])
    power, best = 0.0, CELLS[0]
    for cell in CELLS:
        count = int((stop - start) / cell)
        if count < 2 * FEWEST:
            break
        values = means.over(start + cell * np.arange(count + 1, dtype=np.float64))
        noise = values.shape[1] * means.cell_noise(cell) ** 2
        # the variance of count values is known to sqrt(2 / count) of itself: four times that is
        # beyond chance
        doubt = 4.0 * noise * np.sqrt(2.0 / count)
        result = float(np.sum(np.var(values, axis=0))) - noise
        power = max(power, result - doubt)
        if power > 0.0 and result + doubt < KEPT * power:
            break
        best = cell
        if cell >= USUAL and noise < QUIET * power:
            break
    return best


def attitude_rates(attitude: Array, cell: float) -> tuple[Array, Array]:
    """Body and world rates (n, 3) [rad/s] between n + 1 attitudes."""
    turn = rotation.multiply(rotation.conjugate(attitude[:-1]), attitude[1:])
    body = rotation.to_rotation_vector(turn) / cell
    between = rotation.normalized(attitude[:-1] + attitude[1:])
    return body, rotation.rotate(between, body)


NARROW, WIDE = 0.02, 0.4
"""The parabola is laid through lags no nearer and no farther than this [s]."""
FIRST = 0.05
"""Where it is laid first [s]."""
ROUNDS = 3
POINTS = np.linspace(-1.0, 1.0, 9)
PARTS = 20
"""Into which the log is cut."""


def dated(residual: Callable[[float], Array], lag: float) -> tuple[float, float]:
    """The lag near `lag` at which a residual is least, and its 95 % half width [s].

    Args:
        residual: of a lag: (n, ...) rows in the order of time, in units of their noise.
        lag: where to begin [s].

    The squared residual is a parabola over the interval; nearer, it ripples with the sampling. Two
    noisy series held against each other agree by chance as well, at one lag or another: the slopes
    of the parts of the log, which should all be 0, tell how much (a sandwich variance). Infinite
    where the residual does not grow.
    """
    best, half_width, reach = lag, np.inf, FIRST
    for _ in range(ROUNDS):
        tried = np.array([_misfit(residual(float(best + reach * point))) for point in POINTS])
        bends, slopes, _ = np.polyfit(reach * POINTS, tried, 2)
        bend = float(bends.sum())
        if bend <= 0.0:
            return best, np.inf
        step = float(np.clip(-0.5 * slopes.sum() / bend, -reach, reach))
        left = slopes + 2.0 * bends * step
        scatter = float(left @ left) * PARTS / (PARTS - 1)
        variance = max(1.0 / (2.0 * bend), scatter / (2.0 * bend) ** 2)
        best, half_width = best + step, float(student.ppf(0.975, PARTS - 1) * np.sqrt(variance))
        reach = float(np.clip(half_width, NARROW, WIDE))
    return best, half_width


def _misfit(residual: Array) -> Array:
    """(PARTS,) [nats] of the parts of the log."""
    return np.array([0.5 * np.sum(np.square(part)) for part in np.array_split(residual, PARTS)])


FEWEST_COUNTS, MOST_COUNTS = 90, 20000
"""Of an encoder a turn: of more, printed digits do not show whether they are whole."""
WHOLE = 0.02
"""By which a number of counts may miss a whole one."""
DECIMAL = (1.0, 2.0, 5.0, 10.0)
"""Steps of numbers that are printed to some digits, by their first one: they are of no encoder."""


def counts_in(value: Array, turn: float) -> int:
    """Counts a turn of the encoder that read angles (n,), in a unit of which `turn` make a turn; 0
    where they are no multiples of one step, or no whole number of such steps is a turn."""
    every = np.unique(value)
    steps = np.diff(every)
    steps = steps[steps > 1e-9 * turn]
    if len(steps) < FEWEST:
        return 0
    least = float(steps.min())
    whole = np.round(steps / least)
    # the step to more digits than one difference of printed numbers has
    step = float(steps.sum() / whole.sum())
    if float(np.abs(steps / step - whole).max()) > 0.05:
        return 0
    first = step / 10.0 ** np.floor(np.log10(step))
    counts = turn / step
    if min(abs(first - digit) for digit in DECIMAL) < 1e-3 or not (
        FEWEST_COUNTS <= counts <= MOST_COUNTS
    ):
        return 0
    return round(counts) if abs(counts - round(counts)) < WHOLE else 0
