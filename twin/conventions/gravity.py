"""Which way is up: the accelerometer's length and direction, and that a platform stands upright."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.axes import signed_permutations
from twin.conventions.finding import ConventionFinding, no_fit
from twin.conventions.grid import USUAL, Grid, Means, grid_of
from twin.conventions.room_vectors import ARM, Rates
from twin.platform import Platform
from twin.recording import Recording, Series
from twin.units import STANDARD_GRAVITY

Array = NDArray[np.float64]

SHAKEN = 0.5
"""1 sigma of what moves an accelerometer beside gravity, its bias included [m/s^2]."""
AGREE = 2.0
"""Readings nearer than this share the disturbance: one of them counts every so often [s]."""
LEANING = np.radians(5.0)
"""Beyond the tilt stop by more than this, and no machine stands so [rad]."""
TOUCHING = np.radians(1.0)
"""Nearer to the tilt stop than this, it may push [rad]."""
OWN = 2.0
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


def apart(shaken: float, grid: Grid) -> int:
    """Cells between readings of an accelerometer that tell something of their own: where the motion
    itself shakes it, all of them err in one way."""
    few = grid.count // FEW if shaken > OWN * SHAKEN else 0
    return max(int(AGREE / grid.cell), few, 1)


class Upright:
    """The attitude against the accelerometer and the tilt stop."""

    def __init__(self, recording: Recording, platform: Platform | None, grid: Grid) -> None:
        self._attitude = rotation.normalized(Means(recording["attitude"]).over(grid.edges) + 1e-9)
        self._gravity = platform.gravity if platform else STANDARD_GRAVITY
        self._edges = grid.edges
        self._stop = platform.tilt_limit if platform else np.inf
        self._force: Array | None = None
        self._shaken = SHAKEN
        series = recording.streams.get("accelerometer")
        if series is not None and series.columns == ("x", "y", "z"):
            self._force = Means(series).over(grid.edges)
            self._shaken = shaken_by(recording)
        self._every = apart(self._shaken, grid)

    def with_attitude(self, series: Series) -> "Upright":
        """The same beside another reading of the attitude."""
        other = copy(self)
        other._attitude = rotation.normalized(Means(series).over(self._edges) + 1e-9)
        return other

    @property
    def has_accelerometer(self) -> bool:
        """Whether there is something to hold an accelerometer's axes against."""
        return self._force is not None

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
        axes = signed_permutations(3)
        if self._force is None:
            return np.zeros(len(axes))
        up = rotation.vertical_body(self._attitude @ attitude.T)[:: self._every]
        force = self._force[:: self._every] / self._shaken
        level = self._gravity / self._shaken
        shared = np.einsum("sij,ij->s", axes, up.T @ force)
        return len(up) * level**2 + np.sum(np.square(force)) - 2.0 * level * shared

    def residual(self, attitude: Array, axes: Array) -> Array:
        """(n, 3) R f - (0, 0, g) in units of what shakes it; empty without an accelerometer."""
        if self._force is None:
            return np.zeros((0, 3))
        q = self._attitude[:: self._every] @ attitude.T
        turned = rotation.rotate(q, self._force[:: self._every] @ axes.T)
        return (turned - np.array([0.0, 0.0, self._gravity])) / self._shaken


def upright_of(recording: Recording, platform: Platform | None) -> Upright | None:
    """None where the attitude has nothing to stand against."""
    streams = ["attitude"] + ["accelerometer"] * ("accelerometer" in recording)
    grid = grid_of(recording, *streams)
    return Upright(recording, platform, grid) if grid is not None else None
