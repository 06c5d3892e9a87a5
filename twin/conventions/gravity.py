"""Which way is up: the accelerometer's length and direction, and that a platform stands upright."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.correction import attitude_changes, read_angles, signed_permutations
from twin.conventions.evidence import ConventionFinding, no_fit
from twin.conventions.grid import USUAL, CellGrid, Means, grid_of
from twin.conventions.room_vectors import ARM, Rates
from twin.platform import Platform
from twin.recording import Recording, Series
from twin.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

SHAKEN = 0.2
"""1 sigma of what moves an accelerometer beside gravity, at most, unless the body is turned to and
fro [m/s^2]. Where a reading leaves less, that is its size: 3 of 330 misread logs of the panel,
which lean by 0.03 to 0.3 m/s^2, were missed without it."""
ASKEW = 0.85
"""1 sigma of what it is off by throughout [m/s^2]: 5 deg of its mounting, and its bias."""
AGREE = 2.0
"""Readings nearer than this share the disturbance: one of them counts every so often [s]."""
LEANING = np.radians(5.0)
"""Beyond the tilt stop by more than this, and no machine stands so [rad]."""
TOUCHING = np.radians(1.0)
"""Nearer to the tilt stop than this, it may push [rad]."""
OWN = 5.0
"""Times the usual disturbance from which on the body's own motion is most of it ..."""
FEW = 3
"""... and so many readings count in all."""
ALIKE = 0.1
"""A stream shows gravity that leaves no more than this share of its movement unexplained."""
UPSIDE_DOWN = 60.0
"""What an attitude that always does costs a hypothesis [nats]."""


def median_length(recording: Recording, stream: str) -> float:
    """Of the vectors that a stream shows; 0 where there are none."""
    if stream not in recording or not len(recording[stream]):
        return 0.0
    return float(np.median(np.linalg.norm(recording[stream].value, axis=1)))


def gravity_as_rate(recording: Recording) -> ConventionFinding | None:
    """What to say of a gyro whose values are those of gravity in body axes; None of any other.

    They follow the accelerometer, or where the attitude has the vertical, in length and direction:
    with one scale, and without the constant that a bias would be.
    """
    if "gyro" not in recording or recording["gyro"].columns != ("x", "y", "z"):
        return None
    other = "accelerometer" if "accelerometer" in recording else "attitude"
    grid = grid_of(recording, "gyro", other, narrowest=0.5 * USUAL)
    if grid is None:
        return None
    means = Means(recording[other]).over(grid.edges)
    down = means if other == "accelerometer" else rotation.vertical_body(rotation.normalized(means))
    rate = Means(recording["gyro"]).over(grid.edges)
    moved = float(np.sum(np.square(down - down.mean(axis=0))))
    shared = float(np.einsum("sij,ij->s", signed_permutations(3), down.T @ rate).max())
    power = float(np.sum(np.square(rate)))
    left = float(np.sum(np.square(down))) - shared**2 / power if power > 0.0 else np.inf
    if left > ALIKE * moved:
        return None
    return no_fit("gyro", "gyro fits: it points the way that gravity does")


def shaken_by(recording: Recording) -> float:
    """1 sigma of what moves an accelerometer beside gravity [m/s^2]: more, the faster the body is
    turned to and fro, for the sensor is not at the centre of rotation."""
    source = "gyro" if "gyro" in recording else "attitude"
    grid = grid_of(recording, source, "accelerometer", narrowest=0.5 * USUAL)
    if grid is None:
        return SHAKEN
    return float(np.hypot(SHAKEN, ARM * Rates(recording[source], grid).acceleration))


def apart(shaken: float, grid: CellGrid) -> int:
    """Cells between readings of an accelerometer that tell something of their own: where the motion
    itself shakes it, all of them err in one way."""
    few = grid.count // FEW if shaken > OWN * SHAKEN else 0
    return max(int(AGREE / grid.cell), few, 1)


class _Arm:
    """What the turning of the body does to a sensor beside the centre of rotation,
    alpha x r + omega x (omega x r), in every so many cells of a grid."""

    def __init__(self, gyro: Series, edges: Array, every: int) -> None:
        means, cell = Means(gyro), float(edges[1] - edges[0])
        around = np.append(edges - 0.5 * cell, edges[-1] + 0.5 * cell)
        self._faster = (np.diff(means.over(around), axis=0) / cell)[::every]
        squares = np.einsum("ni,nj->nij", gyro.value, gyro.value).reshape(-1, 9)
        pairs = Means(Series(gyro.time, squares, gyro.columns * 3, "rad^2/s^2")).over(edges)
        pairs = pairs.reshape(-1, 3, 3)[::every]
        power = np.trace(pairs, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        self._inwards = pairs - power

    def felt(self, left: Array, axes: Array) -> Array:
        """(n, 3) of what an accelerometer feels beside gravity, in right axes, with the likeliest
        arm, the gyro being in axes (3, 3); a constant is no turning's."""
        columns = np.cross((self._faster @ axes.T)[:, None], np.eye(3)).swapaxes(1, 2)
        columns = columns + axes @ self._inwards @ axes.T
        rows = np.concatenate([columns, np.broadcast_to(np.eye(3), columns.shape)], axis=2)
        known = np.diag(np.repeat([SHAKEN / ARM, SHAKEN / ASKEW], 3))
        stacked = np.concatenate([rows.reshape(-1, 6), known])
        arm = np.linalg.lstsq(stacked, np.append(left.ravel(), np.zeros(6)), rcond=None)[0][:3]
        return np.asarray(columns @ arm)


class Vertical:
    """One reading of an attitude's angles beside the accelerometer, every two seconds."""

    def __init__(
        self, attitude: Series, accelerometer: Series, grid: CellGrid, gravity: float, shaken: float
    ) -> None:
        self._every, self._edges = apart(shaken, grid), grid.edges
        self._attitude = self._read(attitude)
        means = Means(accelerometer)
        self._force = means.over(grid.edges)[:: self._every]
        self._gravity, self._shaken = gravity, shaken
        self._expected = shaken
        self._quietest = means.cell_noise(grid.cell)

    def measured(self, recording: Recording) -> "Vertical":
        """The same with what shakes the accelerometer taken from the reading that leaves least;
        unchanged where that is the motion itself, which a wrong reading may hide."""
        if self._expected > OWN * SHAKEN:
            return self
        least = min(
            float(reading.leans(attitude).min())
            for _, series in read_angles(recording)
            for reading in [self.with_attitude(series)]
            for attitude, _ in attitude_changes(recording)
        )
        other, size = copy(self), float(np.sqrt(least / self._force.size))
        other._shaken = max(min(size, self._shaken), self._quietest)
        return other

    def with_attitude(self, series: Series) -> "Vertical":
        """The same beside another reading of the attitude."""
        other = copy(self)
        other._attitude = self._read(series)
        return other

    def without_arm(self, gyro: Series) -> "Vertical":
        """The same without what the body's turning does to a sensor beside the centre of
        rotation."""
        arm = _Arm(gyro, self._edges, self._every)
        other = copy(self)
        left = self._force - self._gravity * rotation.vertical_body(self._attitude)
        other._force = self._force - arm.felt(left, np.eye(3))
        return other

    def _read(self, attitude: Series) -> Array:
        means = Means(attitude).over(self._edges)[:: self._every]
        return rotation.normalized(means + 1e-9)

    def leans(self, attitude: Array) -> Array:
        """(48,) by how much what is felt leans otherwise than the attitude says, for every axes of
        the accelerometer: sum of squares [m^2/s^4]."""
        return self._compared(attitude)[0]

    def match(self, attitude: Array) -> Array:
        """(48,) squared norm of the residual for every axes of the accelerometer."""
        leans, off = self._compared(attitude)
        return leans / self._shaken**2 + off / self._askew

    def _compared(self, attitude: Array) -> tuple[Array, Array]:
        """(48,) sum of squares of how what is felt leans otherwise, and square of its mean."""
        up = self._gravity * rotation.vertical_body(self._attitude @ attitude.T)
        force, axes = self._force, signed_permutations(3)
        lean, felt = up - up.mean(axis=0), force - force.mean(axis=0)
        shared = np.einsum("sij,ij->s", axes, lean.T @ felt)
        leans = np.sum(np.square(lean)) + np.sum(np.square(felt)) - 2.0 * shared
        off = axes @ force.mean(axis=0) - up.mean(axis=0)
        leans = np.asarray(leans, dtype=np.float64).clip(0.0)
        return leans, np.sum(np.square(off), axis=1)

    def residual(
        self, attitude: Array, axes: Array, arm: _Arm | None = None, gyro: Array | None = None
    ) -> Array:
        """(n + 2, 3): how what is felt leans otherwise than the attitude (4, 4) says, in units of
        what shakes it; by how much it is off throughout, and the turn of the sensor's mounting that
        was taken out, in units of their 1 sigma. Beside a gyro read as (3, 3) says, without what
        the turning does to the sensor on its arm."""
        up = self._gravity * rotation.vertical_body(self._attitude @ attitude.T)
        left = self._force @ axes.T - up
        if arm is not None and gyro is not None:
            left = left - arm.felt(left, gyro)
        off = left.mean(axis=0)
        lean = up - up.mean(axis=0)
        # a sensor that is mounted askew feels a part of one lean as another
        columns = np.cross(np.eye(3), lean[:, None]).swapaxes(1, 2).reshape(-1, 3)
        turned = ASKEW / self._gravity
        rows = np.vstack([columns / self._shaken, np.eye(3) / turned])
        seen = np.append(((left - off) / self._shaken).ravel(), np.zeros(3))
        turn = np.asarray(np.linalg.lstsq(rows, seen, rcond=None)[0], dtype=np.float64)
        rest = (left - off - (columns @ turn).reshape(-1, 3)) / self._shaken
        return np.asarray(np.vstack([rest, off / np.sqrt(self._askew), turn / turned]))

    def angle(self, attitude: Array, axes: Array) -> float:
        """Median between what is felt and upright [rad]."""
        felt = rotation.rotate(self._attitude @ attitude.T, self._force @ axes.T)
        return float(np.median(np.arctan2(np.hypot(felt[:, 0], felt[:, 1]), felt[:, 2])))

    def stands_on_its_head(self, attitude: Array) -> bool:
        """Whether the body's z axis points down most of the time."""
        up = rotation.vertical_body(self._attitude @ attitude.T)
        return float(np.median(up[:, 2])) < 0.0

    @property
    def shaken_aside(self) -> float:
        """By how much accelerations of the sensor turn what it feels [rad]."""
        return float(np.arctan2(self._expected - SHAKEN, self._gravity))

    @property
    def _askew(self) -> float:
        """Variance of the mean residual."""
        return ASKEW**2 + self._shaken**2 / len(self._force)


class Upright:
    """The attitude against the accelerometer and the tilt stop."""

    def __init__(self, recording: Recording, platform: Platform | None, grid: CellGrid) -> None:
        self._attitude = rotation.normalized(Means(recording["attitude"]).over(grid.edges) + 1e-9)
        self._edges = grid.edges
        self._stop = platform.tilt_limit if platform else np.inf
        self._vertical: Vertical | None = None
        series = recording.streams.get("accelerometer")
        if series is not None and series.columns == ("x", "y", "z"):
            gravity = platform.gravity if platform else STANDARD_GRAVITY
            attitude, shaken = recording["attitude"], shaken_by(recording)
            self._vertical = Vertical(attitude, series, grid, gravity, shaken).measured(recording)
            # beside a gyro, what the turning does to it is known but for the arm
            self._still, self._arm = self._vertical, None
            gyro = recording.streams.get("gyro")
            if gyro is not None and gyro.columns == ("x", "y", "z"):
                still = Vertical(attitude, series, grid, gravity, SHAKEN)
                self._still = still.measured(recording)
                self._arm = _Arm(gyro, grid.edges, apart(SHAKEN, grid))

    def with_attitude(self, series: Series) -> "Upright":
        """The same beside another reading of the attitude."""
        other = copy(self)
        other._attitude = rotation.normalized(Means(series).over(self._edges) + 1e-9)
        if self._vertical is not None:
            other._vertical = self._vertical.with_attitude(series)
            other._still = self._still.with_attitude(series)
        return other

    @property
    def has_accelerometer(self) -> bool:
        """Whether there is something to hold an accelerometer's axes against."""
        return self._vertical is not None

    @property
    def has_arm(self) -> bool:
        """Whether there is a gyro to tell what the turning does to that."""
        return self._vertical is not None and self._arm is not None

    def penalty(self, attitude: Array) -> float:
        """[nats] for an attitude, read as the 4 x 4 matrix says, that leans beyond the stop."""
        if self._stop + LEANING >= 0.5 * np.pi:
            return 0.0
        tilt = rotation.tilt(self._attitude @ attitude.T)
        return UPSIDE_DOWN * float(np.mean(tilt > self._stop + LEANING))

    def free(self, attitude: Array) -> tuple[float, float]:
        """Start and end [s] of the longest stretch in which an attitude, read as the 4 x 4 matrix
        says, stays off the tilt stop."""
        touches = rotation.tilt(self._attitude @ attitude.T) > self._stop - TOUCHING
        ends = np.flatnonzero(np.r_[True, touches, True])
        longest = int(np.argmax(np.diff(ends)))
        return float(self._edges[ends[longest]]), float(self._edges[ends[longest + 1] - 1])

    def match(self, attitude: Array) -> Array:
        """(48,) squared norm of the residual for every axes of the accelerometer; else zeros."""
        if self._vertical is None:
            return np.zeros(len(signed_permutations(3)))
        return self._vertical.match(attitude)

    def residual(self, attitude: Array, axes: Array, gyro: Array) -> Array:
        """Of `Vertical`, beside the gyro in axes (3, 3); empty without an accelerometer."""
        if self._vertical is None:
            return np.zeros((0, 3))
        return self._still.residual(attitude, axes, self._arm, gyro)


def upright_of(recording: Recording, platform: Platform | None) -> Upright | None:
    """None where the attitude has nothing to stand against."""
    streams = ["attitude"] + ["accelerometer"] * ("accelerometer" in recording)
    grid = grid_of(recording, *streams)
    return Upright(recording, platform, grid) if grid is not None else None
