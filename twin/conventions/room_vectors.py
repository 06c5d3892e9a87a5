"""Gravity and the field, constant in the room: what turns the body turns them in its axes.

    du/dt = -w x u

with w from a gyro or from an attitude. A gyro is held against an accelerometer or a magnetometer
where no attitude was logged, and a magnetometer against an attitude. For w in axes S and u in axes
T only det(T) T' S is seen, so that turned axes of the one look like turned axes of the other, and a
vector with the wrong sign throughout is right in another room.

The gyro's bias and an offset of the vector (a bias, iron near the sensor) enter linearly and are
projected out, so that all 48 relative axes cost one Gram matrix a lag and unit.

Beside an attitude R no rate is needed: u = M R^T b + o, with the room's vector b and the offset o.
Rates of a noisy attitude would be noisy regressors, whose fitted offset makes a reading look better
the less it lets them say.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.correction import (
    LATE,
    SIMPLE,
    Correction,
    axes_changes,
    lag_change,
    signed_permutations,
    unit_changes,
)
from twin.conventions.evidence import (
    PLAIN,
    ConventionFinding,
    chance,
    choose,
    drift,
    evidence,
    findings_of,
    forgetting,
    inflation,
    no_fit,
    whitened,
    without,
    words_of,
)
from twin.conventions.grid import (
    FEWEST,
    CellGrid,
    Means,
    attitude_rates,
    between_centres,
    dated,
    grid_of,
)
from twin.conventions.turning import (
    AMBIGUOUS,
    COMMON,
    MOVING,
    SHIFTS,
    SMALL_LAG,
    far_lags,
    least,
    noise_power,
)
from twin.recording import Recording, Series

Array = NDArray[np.float64]

VECTORS = ("accelerometer", "magnetometer")
"""Streams that show a vector of the room."""
OFFSET = {"accelerometer": 0.05, "magnetometer": 0.3}
"""1 sigma of a component's constant error, of the vector's length."""
BIAS = 0.1
"""1 sigma of the gyro's bias [rad/s]."""
DISTURBED = 0.005
"""1 sigma of what else moves the vector in a cell, of its length: accelerations of the body, coils
and currents."""
UNSTEADY = 2e-3
"""1 sigma of a cell's mean rate [rad/s], in whatever unit it is read: noise, axes not quite square,
scales not quite right."""
ARM = 0.5
"""From the centre of rotation to an accelerometer [m]."""
ROCKED = 0.3
"""Gravity is seen where the sensor's own acceleration moves it by no more than this share."""
SMOOTH = 5
"""Cells over which rates are averaged before their change is taken."""
CELL = 0.1
"""[s]; wider in a log of more than MOST cells."""
MOST = 6000
CLOSE = np.linspace(-SMALL_LAG, SMALL_LAG, 5)
"""Lags that are no wrong convention [s]."""
COARSE = 0.1
"""Between the large lags tried [s]."""
DEAREST = 20.0
"""No reading that costs more is looked at [nats]."""
RIVALS = 12
"""So many of the best readings are weighed in pairs ..."""
POLISHED = 36
"""... of so many motions whose lags are sought finely: where a body swings fast, lags tried so far
apart rank them by chance."""
STRAIGHT = 0.05
"""Half an arc below which it is as long as its chord, to a thousandth [rad]."""
NINE = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
"""Columns of a rotation matrix, row by row."""
FINER = (0.03, 0.01, 0.003)
"""Between the lags tried for that [s]."""
CROSS = np.array([np.cross(np.eye(3), item) for item in np.eye(3)]).transpose(1, 0, 2)
"""(i, k, l): the component l of e_i x e_k."""


class Rates:
    """How the body turns, by one stream. (n, 3) [rad/s] over the cells of a grid."""

    def __init__(self, series: Series, grid: CellGrid) -> None:
        self.grid = grid
        self.means = Means(series)
        self._of_attitude = series.columns == ("w", "x", "y", "z")

    def at(self, lag: float) -> Array:
        """If the stream is late by `lag` [s]."""
        if self._of_attitude:
            means = self.means.over(self.grid.around_edges + lag)
            return attitude_rates(rotation.normalized(means + 1e-9), self.grid.cell)[0]
        edges = self.grid.edges + lag
        return np.mean([self.means.over(edges + s * self.grid.cell) for s in SHIFTS], axis=0)

    @property
    def acceleration(self) -> float:
        """How fast the rates change, rms [rad/s^2]."""
        sums = np.cumsum(self.at(0.0), axis=0)
        smooth = (sums[SMOOTH:] - sums[:-SMOOTH]) / SMOOTH
        turning = np.gradient(smooth, self.grid.cell, axis=0)
        return float(np.sqrt(np.mean(np.sum(np.square(turning), axis=1))))


class RoomVector(ABC):
    """A vector that the body sees, in units of its length, beside what shows how the body turns."""

    stream: str
    grid: CellGrid
    _polished_at: dict[tuple[bytes, float], tuple[float, float]]

    def match(self, lags: Array, factors: Sequence[float] = (1.0,)) -> Array:
        """(lags, factors, 48) [nats] left over with rates in other axes, units and times."""
        axes = signed_permutations(3)
        left = np.empty((len(lags), len(factors), len(axes)))
        for row, lag in zip(left, lags, strict=True):
            for entry, factor in zip(row, factors, strict=True):
                entry[:] = self._left(factor * axes, float(lag))
        return left

    def polished(self, rates: Array, lag: float) -> tuple[float, float]:
        """[nats] left over with rates in the axes and unit (3, 3), and by how much they are late
        [s], sought about a lag."""
        key = rates.tobytes(), lag
        if key not in self._polished_at:
            self._polished_at[key] = self._polished(rates, lag)
        return self._polished_at[key]

    def _polished(self, rates: Array, lag: float) -> tuple[float, float]:
        value, farthest = np.inf, SMALL_LAG if abs(lag) <= SMALL_LAG else np.inf
        for step in FINER:
            tried = np.round(lag + step * np.array([-1.0, 0.0, 1.0]), 4)
            tried = tried[np.abs(tried) <= farthest + 1e-9]
            left = np.array([self._left(rates[None], float(item))[0] for item in tried])
            if len(tried) == 3:
                value, lag = least_of(tried, left)
            else:
                value, lag = float(left.min()), float(tried[int(np.argmin(left))])
        return value, lag

    @abstractmethod
    def _left(self, rates: Array, lag: float) -> Array:
        """(m,) [nats] left over with rates in axes (m, 3, 3), all of one unit."""

    @abstractmethod
    def residual(self, rates: Array, lag: float) -> Array:
        """(n + 2, 3) white with unit variance, for rates that (3, 3) times those read are: what is
        left, and two rows of what was fitted, in units of their 1 sigma."""

    @property
    @abstractmethod
    def movement(self) -> Array:
        """(n, 3) all that moves the vector, in units of its noise."""

    @abstractmethod
    def is_rocked(self, factor: float) -> bool:
        """Whether gravity hides behind accelerations of the sensor, for rates in a unit of this
        factor."""

    @abstractmethod
    def rates_move(self) -> bool:
        """Whether the rates show more than noise, in whatever unit they are."""


class VectorBesideGyro(RoomVector):
    """du/dt = -w x u, with the rates w of a gyro."""

    def __init__(self, stream: str, series: Series, rates: Rates) -> None:
        self.stream, self.grid, self._rates = stream, rates.grid, rates
        cell, means = rates.grid.cell, Means(series)
        seen = means.over(rates.grid.around_edges)
        length = max(float(np.median(np.linalg.norm(seen, axis=1))), 1e-300)
        self._length = length
        self._gained = np.diff(seen / length, axis=0) / cell
        self._middle = 0.5 * (seen[1:] + seen[:-1]) / length
        self._angle_noise = float(np.hypot(means.cell_noise(cell) / length, DISTURBED)) / cell
        self._kept = between_centres(rates.grid, means, rates.means)
        prior = np.repeat([BIAS, OFFSET[stream]], 3)
        self._precision = np.diag(prior**-2.0)
        self._grams: dict[tuple[float, float], Array] = {}
        self._polished_at = {}

    def _left(self, rates: Array, lag: float) -> Array:
        key = lag, self._bending(rates)
        if key not in self._grams:
            columns = self._columns(*key)
            self._grams[key] = columns @ columns.T
        parts = _parts(rates)
        moments = parts.swapaxes(1, 2) @ self._grams[key] @ parts
        known = moments[:, 1:, 1:] + self._precision
        fitted = np.linalg.solve(known, moments[:, 1:, :1])
        return 0.5 * (moments[:, 0, 0] - np.sum(moments[:, 0, 1:] * fitted[:, :, 0], 1))

    def residual(self, rates: Array, lag: float) -> Array:
        columns = _parts(rates[None])[0].T @ self._columns(lag, self._bending(rates))
        gram = columns[1:] @ columns[1:].T + self._precision
        fitted = np.linalg.solve(gram, columns[1:] @ columns[0])
        left = (columns[0] - fitted @ columns[1:]).reshape(-1, 3)
        return np.vstack([left, (fitted * np.sqrt(np.diag(self._precision))).reshape(2, 3)])

    @property
    def movement(self) -> Array:
        return self._white(self._gained)

    def is_rocked(self, factor: float) -> bool:
        if self.stream != "accelerometer":
            return False
        moved = np.sqrt(np.sum(np.var(self._middle, axis=0))) * self._length
        return ARM * factor * self._rates.acceleration > ROCKED * float(moved)

    def rates_move(self) -> bool:
        rate = self._white(self._rates.at(0.0))
        return float(np.mean(np.square(rate))) > MOVING * noise_power(self._angle_noise, UNSTEADY)

    def _white(self, values: Array) -> Array:
        white = whitened(values * self._kept[:, None], self._angle_noise, UNSTEADY)
        return without(drift(self._kept, forgetting(self._angle_noise, UNSTEADY)), white)

    def _bending(self, rates: Array) -> float:
        """What puts rates in this unit into rad/s; 0 where no arc is longer than its chord, so that
        one set of columns does for all such units."""
        factor = _factor(rates)
        return factor if 0.5 * self.grid.cell * factor * self._fastest > STRAIGHT else 0.0

    @cached_property
    def _fastest(self) -> float:
        return float(np.max(np.linalg.norm(self._rates.at(0.0), axis=1), initial=0.0))

    def _columns(self, lag: float, factor: float) -> Array:
        """(22, 3 n) white: what the vector gains; e_i x u w_j; e_i x u; w_j e_l, for rates w as
        read that `factor` puts into rad/s."""
        rate = _chords(self._rates.at(lag), self.grid.cell, factor)
        count = len(self._gained)
        turn = np.cross(np.eye(3)[:, None], self._middle)
        taken = np.einsum("inc,nj->nijc", turn, rate).reshape(count, 27)
        values = np.hstack([self._gained, taken, turn.swapaxes(0, 1).reshape(count, 9), rate])
        white = self._white(values)
        alone = np.einsum("nj,lc->nljc", white[:, 39:], np.eye(3)).reshape(count, 9, 3)
        every = np.concatenate([white[:, :39].reshape(count, 13, 3), alone], axis=1)
        return every.swapaxes(0, 1).reshape(22, 3 * count)


class VectorBesideAttitude(RoomVector):
    """u = M R^T b + o, with the attitude R; of one that is the inverse, u = M R b + o.

    M are the axes of the attitude's body rates (or, of the inverse, world rates) relative to the
    vector; b, whose sign and length are the room's, is free. Attitudes enter as matrices averaged
    over the cells, which is exact however fast the body turns.
    """

    def __init__(self, stream: str, series: Series, attitude: Series, grid: CellGrid) -> None:
        self.stream, self.grid = stream, grid
        means, orientation = Means(series), Means(attitude)
        seen = means.over(grid.edges)
        length = max(float(np.median(np.linalg.norm(seen, axis=1))), 1e-300)
        noises = means.cell_noise(grid.cell) / length, orientation.cell_noise(grid.cell)
        self._angle_noise = noises[1]
        self._noise = float(np.linalg.norm([*noises, DISTURBED]))
        kept = means.covers(grid.edges) & orientation.covers(grid.edges, grid.longest_lag)
        self._kept = kept if np.count_nonzero(kept) >= FEWEST else np.ones_like(kept)
        self._seen = seen[self._kept] / length
        self._precision = (self._noise / OFFSET[stream]) ** 2
        self._turn_into(attitude, world=False)

    def _turn_into(self, attitude: Series, *, world: bool) -> None:
        turned = rotation.matrix(attitude.value)
        turned = turned if world else turned.swapaxes(1, 2)
        self._axes = Means(replace(attitude, value=turned.reshape(-1, 9), columns=NINE))
        self._polished_at = {}

    def with_attitude(self, series: Series, *, world: bool) -> "VectorBesideAttitude":
        """The same vector beside another reading of the attitude, or the inverse of that."""
        other = copy(self)
        other._turn_into(series, world=world)
        return other

    def _at(self, lag: float) -> Array:
        """(n, 3, 3) the room's axes in the body's, for an attitude that is late by `lag` [s]."""
        return self._axes.over(self.grid.edges + lag)[self._kept].reshape(-1, 3, 3)

    def _fit(self, rates: Array, turned: Array) -> tuple[Array, Array]:
        """What the vector gives for b and o (m, 6), in the axes of the attitude, with relative axes
        (m, 3, 3); and these."""
        count, total = len(turned), turned.sum(axis=0)
        normal = np.block(
            [
                [np.einsum("nki,nkj->ij", turned, turned), total.T],
                [total, (count + self._precision) * np.eye(3)],
            ]
        )
        shared = np.einsum("nji,nl->jil", turned, self._seen)
        right = np.hstack([np.einsum("mlj,jil->mi", rates, shared), self._seen.sum(axis=0) @ rates])
        return right, np.asarray(np.linalg.solve(normal, right.T).T, dtype=np.float64)

    def _left(self, rates: Array, lag: float) -> Array:
        right, fitted = self._fit(rates, self._at(lag))
        power = float(np.sum(np.square(self._seen)))
        return 0.5 * (power - np.sum(right * fitted, axis=1)) / self._noise**2

    def residual(self, rates: Array, lag: float) -> Array:
        turned = self._at(lag)
        vector, offset = self._fit(rates[None], turned)[1].reshape(2, 3)
        left = self._seen @ rates - turned @ vector - offset
        priors = np.sqrt(self._precision) * offset, np.zeros(3)
        return np.vstack([left @ rates.T, *priors]) / self._noise

    @property
    def movement(self) -> Array:
        return (self._seen - self._seen.mean(axis=0)) / self._noise

    def is_rocked(self, factor: float) -> bool:
        return False  # a field is the same however the sensor is accelerated

    def rates_move(self) -> bool:
        turned = self._at(0.0)
        moved = np.square(turned - turned.mean(axis=0)).sum(axis=(1, 2)).mean()
        return float(moved) > MOVING * self._angle_noise**2


def _chords(rates: Array, cell: float, factor: float) -> Array:
    """Rates (n, 3) as they move a vector beside the middle between two of its values, along the
    chord of its arc: longer than the arc, but for a unit that turns it half round.

    Args:
        rates: as read.
        cell: time between the values [s].
        factor: what puts the rates into rad/s.
    """
    half = 0.5 * cell * factor * np.linalg.norm(rates, axis=1, keepdims=True)
    bent = np.clip(half, 1e-9, AMBIGUOUS)
    return rates * np.where(half < AMBIGUOUS, np.tan(bent) / bent, 1.0)


def _parts(rates: Array) -> Array:
    """(m, 22, 7): what is left over of the columns for rates in other axes (m, 3, 3), and what
    bias (3) and offset (3) would take of it."""
    parts = np.zeros((len(rates), 22, 7))
    parts[:, 0, 0] = 1.0
    parts[:, 1:10, 0] = rates.reshape(-1, 9)
    parts[:, 10:13, 1:4] = np.eye(3)
    parts[:, 13:, 4:] = np.einsum("sij,ikl->sljk", rates, CROSS).reshape(-1, 9, 3)
    return parts


@cache
def relative_axes() -> NDArray[np.intp]:
    """(48, 48) where det(T) T' S stands among signed permutations, for T and S among them."""
    axes = signed_permutations(3)
    place = {axis.tobytes(): index for index, axis in enumerate(axes)}
    signs = np.round(np.linalg.det(axes))
    pairs = np.einsum("t,tji,sjk->tsik", signs, axes, axes) + 0.0
    return np.array([[place[pair.tobytes()] for pair in row] for row in pairs], dtype=np.intp)


def room_vector(recording: Recording, stream: str, source: str) -> RoomVector | None:
    """A vector beside the gyro or the body rates of the attitude; None where they share too little
    time."""
    if any(name not in recording for name in (stream, source)):
        return None
    if recording[stream].columns != ("x", "y", "z") or len(recording[source].columns) < 3:
        return None
    cell = max(CELL, _duration(recording[source]) / MOST)
    grid = grid_of(recording, source, stream, narrowest=cell)
    if grid is None:
        return None
    if source == "attitude":
        return VectorBesideAttitude(stream, recording[stream], recording[source], grid)
    return VectorBesideGyro(stream, recording[stream], Rates(recording[source], grid))


def _duration(series: Series) -> float:
    return float(series.time[-1] - series.time[0]) if len(series) else 0.0


Seen = tuple[RoomVector, Array, float]
"""A vector beside rates, the axes and unit of these relative to it, and by how much they are late
[s]."""


class Rough(Protocol):
    """A reading whose lags were sought between coarse ones."""

    @property
    def corrections(self) -> tuple[Correction, ...]: ...

    @property
    def cost(self) -> float: ...

    @property
    def misfit(self) -> float: ...

    @property
    def score(self) -> float: ...

    @property
    def residuals(self) -> list[Array]: ...

    @property
    def polished(self) -> Self:
        """The same with its lags sought finely."""
        ...


R = TypeVar("R", bound=Rough)


@dataclass(frozen=True)
class _Seen:
    """A vector with what every unit and axes of the rates leave over: (lags, units, 48)."""

    vector: RoomVector
    near: Array
    far: Array
    lags: Array
    """Those of `far`."""


@dataclass(frozen=True)
class _Reading:
    """One reading of the rates and of the vectors."""

    corrections: tuple[Correction, ...]
    cost: float
    misfit: float
    relative: tuple[Seen, ...]
    """Vectors, the rates' axes and unit relative to each, and by how much they are late."""

    @property
    def residuals(self) -> list[Array]:
        return [vector.residual(axes, lag) for vector, axes, lag in self.relative]

    @property
    def polished(self) -> "_Reading":
        """The same with its lags sought finely."""
        result = [vector.polished(axes, lag) for vector, axes, lag in self.relative]
        return replace(
            self,
            misfit=sum(left for left, _ in result),
            relative=tuple(
                (vector, axes, lag)
                for (vector, axes, _), (_, lag) in zip(self.relative, result, strict=True)
            ),
        )

    @property
    def score(self) -> float:
        return self.misfit + self.cost


def gyro_findings(recording: Recording) -> list[ConventionFinding]:
    """What is wrong with a gyro beside an accelerometer, a magnetometer or both, without an
    attitude; none in a right log."""
    if "gyro" not in recording or recording["gyro"].columns != ("x", "y", "z"):
        return []
    units = [None, *unit_changes(recording, "gyro")]
    return _findings(recording, "gyro", units, _changes(recording, "gyro"))


def field_findings(recording: Recording) -> list[ConventionFinding]:
    """What is wrong with a magnetometer beside an attitude that is read rightly."""
    return _findings(recording, "attitude", [None], [None], ("magnetometer",))


def _findings(
    recording: Recording,
    source: str,
    units: Sequence[Correction | None],
    turns: Sequence[Correction | None],
    streams: Sequence[str] = VECTORS,
) -> list[ConventionFinding]:
    result = (room_vector(recording, name, source) for name in streams)
    seen = [_tabled(item, units) for item in result if item is not None]
    every = _sorted(recording, source, seen, units, turns)
    rocked = [vector for vector, axes, _ in every[0].relative if vector.is_rocked(_factor(axes))]
    if rocked:
        seen = [item for item in seen if item.vector not in rocked]
        every = _sorted(recording, source, seen, units, turns)
    if not seen:
        return []
    ranked = best_of(every, lambda item: item.relative)
    if not _explains(ranked[0]):
        # accelerations may hide from an accelerometer that a body leans: a pendulum's do
        apart = [
            item.vector for item in seen if item.vector.stream != "accelerometer" and _apart(item)
        ]
        return [_no_fit(source, vector) for vector in apart[:1]]
    inflated = [inflation(residual[:-2]) for residual in ranked[0].residuals]

    def weigh(one: _Reading, other: _Reading) -> float:
        pairs = zip(one.residuals, other.residuals, inflated, strict=True)
        return sum(evidence(*pair) for pair in pairs) + other.cost - one.cost

    chosen, certainty = choose(ranked, weigh)
    if not chosen:
        return []
    best, *rivals = (_dated(item) for item in chosen)
    others = dict.fromkeys(words_of(rival) for rival in rivals if words_of(rival) != words_of(best))
    return list(findings_of(best.corrections, certainty, tuple(others)))


def best_of(every: Sequence[R], seen: Callable[[R], Sequence[Seen]]) -> list[R]:
    """The likeliest, the plainest that fit as well but for noise, and the log as read, of readings
    whose rough misfits rank them, by finer ones.

    Args:
        every: all readings, the likeliest first.
        seen: what a reading makes of the vectors.
    """
    motions, pool = set[tuple[object, ...]](), list[tuple[R, bool]]()
    near = every[0].misfit + chance(sum(residual.size for residual in every[0].residuals))
    alike = (place for place, item in enumerate(every) if item.misfit < near)
    plainest = set(sorted(alike, key=lambda place: every[place].cost)[:PLAIN])
    for place, item in enumerate(every):
        motion = tuple((id(vector), axes.tobytes(), lag) for vector, axes, lag in seen(item))
        sought = motion in motions or len(motions) < POLISHED
        if sought or place in plainest or not item.corrections:
            motions.add(motion)
            pool.append((item.polished, place in plainest))
    pool.sort(key=lambda pair: pair[0].score)
    return [
        item
        for place, (item, plain) in enumerate(pool)
        if place < RIVALS or plain or not item.corrections
    ]


def _factor(axes: Array) -> float:
    """The unit in a signed permutation."""
    return float(np.abs(axes).max())


def _sorted(
    recording: Recording,
    source: str,
    seen: Sequence[_Seen],
    units: Sequence[Correction | None],
    turns: Sequence[Correction | None],
) -> list[_Reading]:
    """Every reading, the likeliest first; the log as read alone without a vector."""
    if not seen:
        return [_Reading((), 0.0, 0.0, ())]
    options = [list(enumerate(_changes(recording, item.vector.stream))) for item in seen]
    readings = _readings(source, seen, options, units, turns)
    return sorted(readings, key=lambda reading: reading.score)


def _changes(recording: Recording, stream: str) -> list[Correction | None]:
    return [change for _, change in axes_changes(recording, stream)]


def _tabled(vector: RoomVector, units: Sequence[Correction | None]) -> _Seen:
    factors = [1.0 if unit is None else unit.factor for unit in units]
    lags = far_lags(vector.grid.longest_lag, COARSE)
    return _Seen(vector, vector.match(CLOSE, factors), vector.match(lags, factors), lags)


def _explains(best: _Reading) -> bool:
    """Whether the rates explain most of what the vectors do: else nothing is said of their axes."""
    left = sum(float(np.sum(np.square(residual))) for residual in best.residuals)
    moved = sum(float(np.sum(np.square(vector.movement))) for vector, *_ in best.relative)
    return left < (1.0 - COMMON) * moved


def _apart(seen: _Seen) -> bool:
    """Whether rates and vector both move beyond doubt, and not together in any reading."""
    moved = float(np.sum(np.square(seen.vector.movement)))
    least = 2.0 * float(np.concatenate([seen.near, seen.far]).min())
    moves = moved > MOVING * seen.vector.movement.size and seen.vector.rates_move()
    return moves and least > (1.0 - COMMON**2) * moved


def _no_fit(source: str, vector: RoomVector) -> ConventionFinding:
    return no_fit(source, f"{source} and {vector.stream} fits: both move, and not together")


def _readings(
    source: str,
    seen: Sequence[_Seen],
    options: Sequence[Sequence[tuple[int, Correction | None]]],
    units: Sequence[Correction | None],
    turns: Sequence[Correction | None],
) -> Iterator[_Reading]:
    """Every unit and axes of the rates with every axes of the vectors, in step or one late."""
    axes = signed_permutations(3)
    for (u, unit), (s, turn) in product(enumerate(units), enumerate(turns)):
        rates = tuple(c for c in (unit, turn) if c is not None)
        factor = 1.0 if unit is None else unit.factor
        for chosen in affordable(options, DEAREST - sum(c.cost for c in rates)):
            changes = (*rates, *(c for _, c in chosen if c is not None))
            cost = sum(c.cost for c in changes)
            relative = [int(relative_axes()[t, s]) for t, _ in chosen]
            for clock, misfit, lags in _clocks(source, seen, relative, u):
                if clock and cost + SIMPLE > DEAREST:
                    continue
                yield _Reading(
                    (*changes, *([clock] if clock else [])),
                    cost + LATE * (clock is not None),
                    misfit,
                    tuple(
                        (item.vector, factor * axes[r], lag)
                        for item, r, lag in zip(seen, relative, lags, strict=True)
                    ),
                )


def affordable(
    options: Sequence[Sequence[tuple[int, Correction | None]]], most: float
) -> Iterator[tuple[tuple[int, Correction | None], ...]]:
    """One option (number, correction) of each stream, those that cost `most` [nats] together at
    most."""
    if not options:
        yield ()
        return
    for index, change in options[0]:
        left = most - (change.cost if change is not None else 0.0)
        if left >= 0.0:
            for others in affordable(options[1:], left):
                yield ((index, change), *others)


def _clocks(
    source: str, seen: Sequence[_Seen], relative: Sequence[int], unit: int
) -> Iterator[tuple[Correction | None, float, list[float]]]:
    """No clock off, that of the rates, or that of one vector; [nats], and by how much the rates
    are late beside each vector [s]."""
    near = [item.near[:, unit, r] for item, r in zip(seen, relative, strict=True)]
    far = [item.far[:, unit, r] for item, r in zip(seen, relative, strict=True)]
    misfit, lag = least_of(CLOSE, np.sum(near, axis=0))
    yield None, misfit, [lag] * len(seen)
    if len(seen[0].lags) < 3:
        return
    misfit, lag = least_of(seen[0].lags, np.sum(far, axis=0))
    yield lag_change(source, lag), misfit, [lag] * len(seen)
    for k, item in enumerate(seen):
        rest = [left for i, left in enumerate(near) if i != k]
        in_step, close = least_of(CLOSE, np.sum(rest, axis=0)) if rest else (0.0, 0.0)
        misfit, lag = least_of(item.lags, far[k])
        lags = [lag if i == k else close for i in range(len(seen))]
        yield lag_change(item.vector.stream, -lag), in_step + misfit, lags


def least_of(lags: Array, misfit: Array) -> tuple[float, float]:
    """The least of misfits at these lags (three or more), between them too, and where [s]."""
    value, lag = least(lags, misfit[:, None])
    return float(value[0]), float(lag[0])


def _dated(item: _Reading) -> _Reading:
    """The same with the offset of its clock sought finely."""
    clocks = [c for c in item.corrections if c.kind == "clock_lag"]
    if not clocks:
        return item
    (clock,) = clocks
    vector, axes, lag = next(
        (r for r in item.relative if r[0].stream == clock.stream), item.relative[0]
    )
    best, half_width = dated(lambda tried: vector.residual(axes, tried)[:-2], lag)
    own = -best if clock.stream == vector.stream else best
    told = lag_change(clock.stream, own, half_width) or clock
    return replace(item, corrections=tuple(told if c is clock else c for c in item.corrections))
