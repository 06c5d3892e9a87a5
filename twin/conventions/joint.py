"""A hinge's rate against its angle: unit, sign and clock of the one are those of the other.

Which of the two is wrong the two alone cannot tell, so a sign or a clock is told of either.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.conventions.correction import (
    CLOSE,
    LATE,
    SIMPLE,
    Correction,
    apply_all,
    axes_change,
    lag_change,
    unit_changes,
)
from twin.conventions.evidence import (
    CERTAIN,
    CLEAR,
    TIED,
    ConventionFinding,
    drift,
    evidence,
    forgetting,
    inflation,
    whitened,
    without,
)
from twin.conventions.grid import CellGrid, Means, between_centres, dated, grid_of
from twin.conventions.turning import NEAR, far_lags
from twin.recording import Recording

Array = NDArray[np.float64]

SIGNIFICANT = 8.0
"""Sigmas of correlation without which nothing is said."""


class Hinge:
    """joint_angle and joint_rate on one grid."""

    def __init__(self, recording: Recording, grid: CellGrid) -> None:
        self.grid = grid
        angle, self._rate = Means(recording["joint_angle"]), Means(recording["joint_rate"])
        self._turned = np.diff(angle.over(grid.around_edges), axis=0) / grid.cell
        self._angle_noise = angle.cell_noise(grid.cell) / grid.cell
        self._rate_noise = self._rate.cell_noise(grid.cell)
        self._kept = between_centres(grid, angle, self._rate)[:, None]

    def residual(self, sign: float, lag: float) -> Array:
        """(n, 1) what is left of the angle's rate, in units of its noise."""
        left = self._turned - sign * self._rate.over(self.grid.edges + lag)
        pole = forgetting(self._angle_noise, self._rate_noise)
        white = whitened(left * self._kept, self._angle_noise, self._rate_noise)
        return without(drift(self._kept[:, 0], pole)[:, :1], white)

    def factor(self) -> float | None:
        """Size of what the rate must be multiplied by, or None where the two do not go together."""
        turned = self._turned - self._turned.mean()
        best, size = 0.0, None
        for lag in np.concatenate([NEAR, far_lags(self.grid.longest_lag)]):
            rate = self._rate.over(self.grid.edges + float(lag))
            rate = rate - rate.mean()
            power = float(np.sum(np.square(turned))) * float(np.sum(np.square(rate)))
            shared = abs(float(np.sum(turned * rate))) / np.sqrt(power) if power > 0.0 else 0.0
            if shared > best:
                # between the two regressions, each of which takes one side for free of noise
                best, size = shared, float(np.std(turned) / np.std(rate))
        sigmas = best * np.sqrt(len(turned) / max(1.0 - best**2, 1e-12))
        return size if sigmas > SIGNIFICANT else None


@dataclass(frozen=True)
class _Option:
    """A sign and a lag of the rate, and what of them can be told, of either stream."""

    sign: float
    lag: float
    cost: float
    readings: tuple[tuple[Correction, ...], ...]

    @property
    def words(self) -> list[str]:
        return [", and ".join(c.words for c in reading) for reading in self.readings]


def joint_findings(recording: Recording) -> list[ConventionFinding]:
    """What is wrong with joint_rate or joint_angle, for a hinge with one of each."""
    units = _unit(recording)
    result = [
        ConventionFinding(unit, CERTAIN, tuple(other.words for other in units[1:]))
        for unit in units[:1]
    ]
    if len(units) > 1:
        return result
    hinge = _hinge_of(apply_all(recording, units))
    if hinge is None or hinge.factor() is None:
        return result
    options = list(_options(hinge))
    left = [hinge.residual(option.sign, option.lag) for option in options]
    power = [0.5 * float(np.sum(np.square(r))) for r in left]
    inflated = inflation(left[int(np.argmin(power))])
    scores = [p / inflated + option.cost for p, option in zip(power, options, strict=True)]
    best = int(np.argmin(scores))
    certainty = evidence(left[best], left[0], inflated) - options[best].cost
    if not options[best].readings or certainty < CLEAR:
        return result
    told = _dated(hinge, options[best])
    words = told.words[1:]
    for option, residual in zip(options, left, strict=True):
        rival = evidence(left[best], residual, inflated) + option.cost - options[best].cost
        if option is not options[best] and rival < TIED:
            words += _dated(hinge, option).words
    return result + [ConventionFinding(c, certainty, tuple(words)) for c in told.readings[0]]


def _options(hinge: Hinge) -> Iterator[_Option]:
    far = far_lags(hinge.grid.longest_lag)
    for lags in (NEAR, far) if len(far) else (NEAR,):
        for sign in (1.0, -1.0):
            misfit = [float(np.sum(np.square(hinge.residual(sign, float(lag))))) for lag in lags]
            lag = float(lags[int(np.argmin(misfit))])
            cost = SIMPLE * (sign < 0.0) + LATE * (lags is not NEAR)
            yield _Option(sign, lag, cost, tuple(_readings(sign, lag)))


def _dated(hinge: Hinge, option: _Option) -> _Option:
    """The same with its lag sought finely, and told with its interval."""
    lag, half_width = dated(lambda lag: hinge.residual(option.sign, lag), option.lag)
    readings = tuple(_readings(option.sign, lag, half_width))
    return replace(option, lag=lag, readings=readings) if readings else option


def _readings(sign: float, lag: float, half_width: float = 0.0) -> Iterator[tuple[Correction, ...]]:
    for stream, own in (("joint_rate", lag), ("joint_angle", -lag)):
        changes = (
            axes_change(stream, np.array([[sign]]), ("",)),
            lag_change(stream, own, half_width),
        )
        told = tuple(change for change in changes if change is not None)
        if told:
            yield told


def _unit(recording: Recording) -> list[Correction]:
    """Units of rate or angle that would make the two agree; empty where they do."""
    hinge = _hinge_of(recording)
    factor = hinge.factor() if hinge is not None else None
    if factor is None or abs(np.log(factor)) < CLOSE:
        return []
    options = unit_changes(recording, "joint_rate") + unit_changes(recording, "joint_angle")
    off = [
        abs(np.log(factor / o.factor) if o.stream == "joint_rate" else np.log(factor * o.factor))
        for o in options
    ]
    return [option for option, distance in zip(options, off, strict=True) if distance < CLOSE]


def _hinge_of(recording: Recording) -> Hinge | None:
    streams = ("joint_angle", "joint_rate")
    if any(n in recording and len(recording[n].columns) != 1 for n in streams):
        return None
    grid = grid_of(recording, *streams)
    return Hinge(recording, grid) if grid is not None else None
