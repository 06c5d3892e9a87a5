"""Which way is up: the accelerometer's length and direction, and that a platform stands upright."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.axes import signed_permutations
from twin.conventions.grid import Grid, Means, grid_of
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
UPSIDE_DOWN = 60.0
"""What an attitude that always does costs a hypothesis [nats]."""


def median_length(recording: Recording, stream: str) -> float:
    """Of the vectors that a stream shows; 0 where there are none."""
    if stream not in recording or not len(recording[stream]):
        return 0.0
    return float(np.median(np.linalg.norm(recording[stream].value, axis=1)))


class Upright:
    """The attitude against the accelerometer and the tilt stop."""

    def __init__(self, recording: Recording, platform: Platform | None, grid: Grid) -> None:
        self._attitude = rotation.normalized(Means(recording["attitude"]).over(grid.edges) + 1e-9)
        self._gravity = platform.gravity if platform else STANDARD_GRAVITY
        self._edges = grid.edges
        self._stop = platform.tilt_limit if platform else np.inf
        self._force: Array | None = None
        series = recording.streams.get("accelerometer")
        if series is not None and series.columns == ("x", "y", "z"):
            self._force = Means(series).over(grid.edges)
        self._every = max(int(AGREE / grid.cell), 1)

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
        force = self._force[:: self._every] / SHAKEN
        level = self._gravity / SHAKEN
        shared = np.einsum("sij,ij->s", axes, up.T @ force)
        return len(up) * level**2 + np.sum(np.square(force)) - 2.0 * level * shared

    def residual(self, attitude: Array, axes: Array) -> Array:
        """(n, 3) R f - (0, 0, g) in units of what shakes it; empty without an accelerometer."""
        if self._force is None:
            return np.zeros((0, 3))
        q = self._attitude[:: self._every] @ attitude.T
        turned = rotation.rotate(q, self._force[:: self._every] @ axes.T)
        return (turned - np.array([0.0, 0.0, self._gravity])) / SHAKEN


def upright_of(recording: Recording, platform: Platform | None) -> Upright | None:
    """None where the attitude has nothing to stand against."""
    streams = ["attitude"] + ["accelerometer"] * ("accelerometer" in recording)
    grid = grid_of(recording, *streams)
    return Upright(recording, platform, grid) if grid is not None else None
