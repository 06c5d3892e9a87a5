"""A hinge's rate against its angle, and its torque against both.

Unit, sign and clock of the rate are those of the angle. Which of the two is wrong the two alone
cannot show, so a finding names either; a torque that drives the hinge decides about the sign.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

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
from twin.conventions.grid import (
    CellGrid,
    Means,
    between_centres,
    counts_in,
    dated,
    grid_of,
)
from twin.conventions.turning import NEAR, far_lags
from twin.platform import Platform
from twin.recording import Recording, Series

Array = NDArray[np.float64]

TORQUE = "command_joint_torque"
WHEEL = "wheel_speed"
SIGNIFICANT = 8.0
"""Sigmas of correlation without which nothing is said."""
ALONE = 0.02
"""Share of a torque's power that neither holds a weight nor is constant, at least."""
LIKE = 5.0
"""Factor by which the share of momentum that a body takes from its wheel may be off."""
DRIVEN = 0.5
"""Share of the acceleration beside gravity that the torque, or a wheel, explains, at least."""


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


def rate_lag(recording: Recording) -> tuple[float, float] | None:
    """How late joint_rate is stamped relative to joint_angle, and its 95 % half width [s].

    None where the log lacks one of them, or they do not show one motion. No dynamics enter.
    """
    hinge = _hinge_of(recording)
    if hinge is None or hinge.factor() is None:
        return None
    misfit = [float(np.sum(np.square(hinge.residual(1.0, float(lag))))) for lag in NEAR]
    return dated(lambda lag: hinge.residual(1.0, lag), float(NEAR[int(np.argmin(misfit))]))


def joint_findings(
    recording: Recording, platform: Platform | None = None
) -> list[ConventionFinding]:
    """What is wrong with joint_rate, joint_angle or the torque of a hinge with one of each, or with
    the speed of its only wheel."""
    by_counts = _unit_by_counts(recording)
    if by_counts is not None:
        return [ConventionFinding(by_counts, CERTAIN)]
    units = _unit(recording)
    result = [
        ConventionFinding(unit, CERTAIN, tuple(other.words for other in units[1:]))
        for unit in units[:1]
    ]
    if len(units) > 1:
        return result
    recording = apply_all(recording, units)
    driven = _driven(recording)
    turned = [] if driven >= 0.0 else [ConventionFinding(_turned(TORQUE), -driven)]
    against = _with_its_wheel(recording, platform)
    if against > 0.0:
        other = _turned("joint_rate").words
        if "joint_angle" in recording:
            other += f", and {_turned('joint_angle').words}"
        turned.append(ConventionFinding(_turned(WHEEL), against, (other,)))
    hinge = _hinge_of(recording)
    if hinge is None or hinge.factor() is None:
        return result + turned
    options = list(_options(hinge))
    left = [hinge.residual(option.sign, option.lag) for option in options]
    power = [0.5 * float(np.sum(np.square(r))) for r in left]
    inflated = inflation(left[int(np.argmin(power))])
    scores = [p / inflated + option.cost for p, option in zip(power, options, strict=True)]
    best = int(np.argmin(scores))
    certainty = evidence(left[best], left[0], inflated) - options[best].cost
    if not options[best].readings or certainty < CLEAR:
        return result + turned
    told = _dated(hinge, options[best])
    if told.sign < 0.0 and driven:
        # the torque goes with one of the two, and that one is right
        wrong = 0 if driven < 0.0 else 1
        return result + [ConventionFinding(c, certainty) for c in told.readings[wrong]]
    result += turned
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
            _turned(stream) if sign < 0.0 else None,
            lag_change(stream, own, half_width),
        )
        told = tuple(change for change in changes if change is not None)
        if told:
            yield told


def _turned(stream: str) -> Correction:
    """The other direction of a stream of one column."""
    change = axes_change(stream, -np.eye(1), ("",))
    assert change is not None
    return change


def _driven(recording: Recording) -> float:
    """Evidence that a torque drives the rate of a hinge [nats]; negative where it drives it
    backwards, 0 where neither is clear.

    The change of rate from cell to cell is regressed on the impulses of the torque and of gravity,
    J dw = u dt - m g l sin(q) dt, over cells in which latencies and a motor's ripple average out.
    """
    rate = next((n for n in ("joint_rate", "joint_angle") if n in recording), None)
    streams = [n for n in ("joint_rate", "joint_angle", TORQUE) if n in recording]
    grid = grid_of(recording, *streams) if rate and TORQUE in streams else None
    if grid is None or rate is None or any(len(recording[name].columns) != 1 for name in streams):
        return 0.0
    if rate == "joint_rate":
        gained = np.diff(Means(recording[rate]).over(grid.around_edges), axis=0)
    else:
        means = Means(recording[rate]).over(grid.around_edges)
        gained = np.diff(np.gradient(means[:, 0]))[:, None] / grid.cell
    others = [np.full((grid.count, 1), grid.cell)]
    if "joint_angle" in recording:
        angle = recording["joint_angle"]
        others += [_impulse(angle, turn(angle.value), grid) for turn in (np.sin, np.cos)]
    beside = np.column_stack(others)
    torque = _impulse(recording[TORQUE], recording[TORQUE].value, grid)
    impulse, undriven = without(beside, torque), without(beside, gained)
    if not float(np.sum(np.square(impulse))) > ALONE * float(np.sum(np.square(torque))):
        return 0.0
    return _evidence_of(undriven, impulse)


def _with_its_wheel(recording: Recording, platform: Platform | None) -> float:
    """Evidence that a hinge's rate rises with the speed of its only wheel [nats], where that takes
    the momentum from it; negative where it falls, 0 where neither is clear."""
    if platform is None or platform.base.kind != "hinge" or len(platform.wheels) != 1:
        return 0.0
    grid = grid_of(recording, "joint_rate", WHEEL)
    if grid is None or any(len(recording[name].columns) != 1 for name in ("joint_rate", WHEEL)):
        return 0.0
    means = [Means(recording[name]) for name in ("joint_rate", WHEEL)]
    kept = np.all([between_centres(grid, item, None) for item in means], axis=0)[:, None]
    rate, wheel = (kept * np.diff(item.over(grid.around_edges), axis=0) for item in means)
    share = float(np.sum(rate * wheel)) / max(float(np.sum(np.square(wheel))), 1e-300)
    stated = abs(share) * np.diag(platform.inertia) / platform.wheels[0].inertia
    if stated.max() < 1.0 / LIKE or stated.min() > LIKE:
        return 0.0
    return _evidence_of(rate, wheel)


def _evidence_of(gained: Array, by: Array) -> float:
    """Evidence that one change (n, 1) explains another [nats], with the sign of their product; 0
    where it does not explain most."""
    square = float(np.sum(np.square(by)))
    if square <= 0.0:
        return 0.0
    slope = float(np.sum(by * gained)) / square
    residual = gained - slope * by
    if float(np.sum(np.square(residual))) > (1.0 - DRIVEN) * float(np.sum(np.square(gained))):
        return 0.0
    scale = max(float(np.std(residual)), 1e-300)
    certainty = evidence(residual / scale, gained / scale, inflation(residual / scale)) - SIMPLE
    return float(np.copysign(certainty, slope)) if certainty > CLEAR else 0.0


def _impulse(series: Series, value: Array, grid: CellGrid) -> Array:
    """(n, 1) change of a value's integral from cell to cell."""
    total = cumulative_trapezoid(value, series.time, axis=0, initial=0.0)
    return np.diff(Means(replace(series, value=total)).over(grid.around_edges), axis=0)


def _unit_by_counts(recording: Recording) -> Correction | None:
    """The unit of an angle in which its encoder has a whole number of counts a turn, where it has
    none as it was read."""
    if "joint_angle" not in recording or len(recording["joint_angle"].columns) != 1:
        return None
    value = recording["joint_angle"].value[:, 0]
    if counts_in(value, 2.0 * np.pi):
        return None
    options = unit_changes(recording, "joint_angle")
    return next((one for one in options if counts_in(value * one.factor, 2.0 * np.pi)), None)


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
