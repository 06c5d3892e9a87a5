"""The attitude against the accelerometer, which needs no gyro: what is felt points up.

An accelerometer is mounted askew and has a bias, so that a constant difference in body axes counts
little. It must lean when the attitude does.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.axes import SIMPLE, signed_permutations
from twin.conventions.changes import axes_changes
from twin.conventions.correction import Correction
from twin.conventions.euler import read_angles
from twin.conventions.evidence import evidence, inflation
from twin.conventions.finding import ConventionFinding, findings_of, no_fit
from twin.conventions.gravity import AGREE, SHAKEN
from twin.conventions.grid import Grid, Means, grid_of
from twin.conventions.motion import DEAREST, orientations, place_of
from twin.conventions.selection import choose, words_of
from twin.recording import Recording, Series

Array = NDArray[np.float64]

ASKEW = 0.85
"""1 sigma of what an accelerometer is off by throughout [m/s^2]: 5 deg of its mounting."""
ASTRAY = np.radians(30.0)
"""A reading whose acceleration is in the median further from upright fits nothing [rad]."""
UPSIDE_DOWN = SIMPLE
"""What an attitude of a machine that stands on its head costs a reading [nats]."""
RIVALS = 12
"""So many of the best readings are weighed in pairs."""


class Vertical:
    """One reading of an attitude's angles beside the accelerometer, every two seconds."""

    def __init__(self, attitude: Series, accelerometer: Series, grid: Grid, gravity: float) -> None:
        every = max(int(AGREE / grid.cell), 1)
        edges = grid.edges
        means = rotation.normalized(Means(attitude).over(edges) + 1e-9)
        self._attitude = means[::every]
        self._force = Means(accelerometer).over(edges)[::every]
        self._gravity = gravity

    def match(self, attitude: Array) -> Array:
        """(48,) squared norm of the residual for every axes of the accelerometer."""
        up = self._gravity * rotation.vertical_body(self._attitude @ attitude.T)
        force, axes = self._force, signed_permutations(3)
        lean, felt = up - up.mean(axis=0), force - force.mean(axis=0)
        shared = np.einsum("sij,ij->s", axes, lean.T @ felt)
        leans = np.sum(np.square(lean)) + np.sum(np.square(felt)) - 2.0 * shared
        off = axes @ force.mean(axis=0) - up.mean(axis=0)
        return leans / SHAKEN**2 + np.sum(np.square(off), axis=1) / self._askew

    def residual(self, attitude: Array, axes: Array) -> Array:
        """(n + 1, 3): how what is felt leans otherwise than the attitude (4, 4) says, in units of
        what shakes it, and by how much it is off throughout."""
        up = self._gravity * rotation.vertical_body(self._attitude @ attitude.T)
        left = self._force @ axes.T - up
        off = left.mean(axis=0)
        return np.vstack([(left - off) / SHAKEN, off / np.sqrt(self._askew)])

    def angle(self, attitude: Array, axes: Array) -> float:
        """Median between what is felt and upright [rad]."""
        felt = rotation.rotate(self._attitude @ attitude.T, self._force @ axes.T)
        return float(np.median(np.arctan2(np.hypot(felt[:, 0], felt[:, 1]), felt[:, 2])))

    def stands_on_its_head(self, attitude: Array) -> bool:
        """Whether the body's z axis points down most of the time."""
        up = rotation.vertical_body(self._attitude @ attitude.T)
        return float(np.median(up[:, 2])) < 0.0

    @property
    def _askew(self) -> float:
        """Variance of the mean residual."""
        return ASKEW**2 + SHAKEN**2 / len(self._force)


@dataclass(frozen=True)
class _Leaning:
    """One reading of attitude and accelerometer."""

    corrections: tuple[Correction, ...]
    cost: float
    """[nats]."""
    misfit: float
    """[nats]."""
    vertical: Vertical
    attitude: Array
    force: Array

    @property
    def residual(self) -> Array:
        return self.vertical.residual(self.attitude, self.force)

    @property
    def score(self) -> float:
        return self.misfit + self.cost


def vertical_of(recording: Recording, gravity: float) -> Vertical | None:
    """The attitude as read; None without an accelerometer, or with too little of both."""
    grid = _grid(recording)
    if grid is None:
        return None
    return Vertical(recording["attitude"], recording["accelerometer"], grid, gravity)


def vertical_findings(recording: Recording, gravity: float) -> list[ConventionFinding]:
    """What is wrong with attitude or accelerometer; none without one of them, or in a right log.

    Args:
        recording: units are right.
        gravity: [m/s^2].
    """
    grid = _grid(recording)
    if grid is None:
        return []
    every = sorted(_leanings(recording, grid, gravity), key=lambda one: one.score)
    ranked = every[:RIVALS] + [one for one in every[RIVALS:] if not one.corrections]
    inflated = inflation(ranked[0].residual[:-1])

    def weigh(one: _Leaning, other: _Leaning) -> float:
        return evidence(one.residual, other.residual, inflated) + other.cost - one.cost

    chosen, certainty = choose(ranked, weigh)
    best = chosen[0] if chosen else next(one for one in ranked if not one.corrections)
    angle = best.vertical.angle(best.attitude, best.force)
    if angle > ASTRAY:
        told = f"the acceleration is {np.degrees(angle):.0f} deg from upright in the best of them"
        return [no_fit("accelerometer", f"accelerometer and attitude fits: {told}")]
    if not chosen:
        return []
    others = dict.fromkeys(words_of(rival) for rival in chosen[1:])
    return list(findings_of(best.corrections, certainty, tuple(others)))


def _leanings(recording: Recording, grid: Grid, gravity: float) -> Iterator[_Leaning]:
    turns = list(orientations(recording))
    forces = list(axes_changes(recording, "accelerometer"))
    for change, series in read_angles(recording):
        vertical = Vertical(series, recording["accelerometer"], grid, gravity)
        for frame, attitude, attitude_change in turns:
            misfit = 0.5 * vertical.match(attitude)
            lean = UPSIDE_DOWN * vertical.stands_on_its_head(attitude)
            for axes, force_change in forces:
                total = frame.vector @ axes
                changes = [c for c in (change, attitude_change, force_change) if c is not None]
                cost = lean + frame.cost + sum(c.cost for c in changes)
                if cost < DEAREST or not changes:
                    corrections = (*changes, *frame.corrections)
                    left = float(misfit[place_of(total)])
                    yield _Leaning(corrections, cost, left, vertical, attitude, total)


def _grid(recording: Recording) -> Grid | None:
    if "accelerometer" not in recording or recording["accelerometer"].columns != ("x", "y", "z"):
        return None
    return grid_of(recording, "attitude", "accelerometer")
