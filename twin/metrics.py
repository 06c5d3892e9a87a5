"""Figures of merit of a run, gathered while it flies; one row a run of the batch."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.budget import SINGULAR, constant_gyros, singular_margin
from twin.controller.exchange import Gyros
from twin.platform import Platform
from twin.rotation import conjugate, multiply, tilt
from twin.signals import Tick

Array = NDArray[np.float64]

SETTLE = 30.0
"""Within which a law has come to its reference [s], where a flight is that long."""


def settled(duration: float) -> float:
    """When tracking begins to count in a flight of that duration [s]: half of it at the latest."""
    return min(SETTLE, 0.5 * duration)


def begun(time: float, since: float) -> bool:
    """Whether a tick lies in a window that begins at `since` [s], perhaps a difference of times.

    60 - 59.9 is larger than 0.1, the time of a tick: rounding may not decide which ticks count.
    """
    return time >= since - 1e-9


@dataclass
class Metrics:
    """Observer of a loop: how well the reference was followed, and what it took.

    Errors are of the true attitude and place where the plant knows them, else of the estimated
    ones; that of the place is along the floor, where the reference asks for one.
    """

    platform: Platform
    settle: float = SETTLE
    """Tracking counts from here on [s]."""
    say: Callable[[str], None] | None = None
    """Takes a sentence while it flies: gyros of the first run that come near a singular state."""

    def __post_init__(self) -> None:
        self._squares: Array | float = 0.0
        self._counted = 0
        self._worst: Array | float = 0.0
        self._strayed: Array | float = 0.0
        self._farthest: Array | float = 0.0
        self._places = 0
        self._tilt: Array | float = 0.0
        self._momentum: Array | float = 0.0
        self._saturated: Array | None = None
        self._inertia = np.array([wheel.inertia for wheel in self.platform.wheels])
        self._limit = np.array([wheel.momentum_limit for wheel in self.platform.wheels])
        of_gyros = constant_gyros(self.platform)
        self._gyros = GyroMargin(self.platform, self.say) if of_gyros else None

    def collect(self, tick: Tick) -> None:
        """One tick."""
        estimate, truth, time = tick.estimate, tick.truth, tick.reading.time
        if self.platform.base.kind != "hinge":
            seen = truth.get("truth_attitude")
            attitude = estimate.attitude if seen is None else seen.value[:, -1]
            self._tilt = np.maximum(self._tilt, tilt(attitude))
            if begun(time, self.settle):
                error = multiply(conjugate(tick.target.attitude), attitude)
                sine = np.minimum(np.sqrt((error[:, 1:] ** 2).sum(axis=1)), 1.0)
                angle = 2.0 * np.arcsin(sine)
                self._squares = self._squares + angle**2
                self._worst = np.maximum(self._worst, angle)
                self._counted += 1
        where = tick.target.position
        if where is not None and self.platform.base.travels and begun(time, self.settle):
            shown = truth.get("truth_position")
            position = estimate.position if shown is None else shown.value[:, -1]
            if position is not None:
                error = np.sqrt(((position - where)[:, :2] ** 2).sum(axis=1))
                self._strayed = self._strayed + error**2
                self._farthest = np.maximum(self._farthest, error)
                self._places += 1
        if self.platform.wheels:
            spin = truth.get("truth_wheel_speed")
            speed = estimate.wheel_speed if spin is None else spin.value[:, -1]
            momentum = np.abs(speed) * self._inertia
            self._momentum = np.maximum(self._momentum, momentum)
            full = np.max(momentum / self._limit, axis=1) >= 0.999
            if self._saturated is None:
                self._saturated = np.full(len(momentum), np.nan)
            self._saturated = np.where(full & np.isnan(self._saturated), time, self._saturated)
        if self._gyros is not None:
            self._gyros.collect(tick)

    def rows(self) -> dict[str, Any]:
        """Each metric, (n,) or (n, wheels), by name with its SI unit; absent: not applicable."""
        result: dict[str, Any] = {}
        if self._counted:
            result["tracking_error_rms_rad"] = np.sqrt(self._squares / self._counted)
            result["tracking_error_max_rad"] = self._worst
        if self._places:
            result["place_error_rms_m"] = np.sqrt(self._strayed / self._places)
            result["place_error_max_m"] = self._farthest
        if self.platform.base.kind != "hinge":
            result["tilt_max_rad"] = self._tilt
        if self._saturated is not None:
            result["wheel_momentum_max_N_m_s"] = self._momentum
            result["wheel_saturated_at_s"] = self._saturated
        if self._gyros is not None:
            result |= self._gyros.rows()
        return result


class GyroMargin:
    """Observer of a loop: momentum of control moment gyros, and how near they come to singular."""

    PERIOD = 0.5
    """Between two looks [s]."""
    EARLY = 3.0 * SINGULAR
    """Margin at which a warning is given."""
    PACE = 10.0
    """Over which the pace of the margin is taken [s]."""

    def __init__(self, platform: Platform, say: Callable[[str], None] | None) -> None:
        """Nothing was looked at yet; `say` as of `Metrics`."""
        self._array = Gyros.of(platform, "the momentum of gyros")
        self._say = say
        self._next = 0.0
        self._momentum: Array | float = 0.0
        self._least: Array | float = np.inf
        self._near: Array | None = None
        self._before: list[tuple[float, float]] = []

    def collect(self, tick: Tick) -> None:
        """One tick."""
        time, seen = tick.reading.time, tick.truth.get("truth_gimbal_angle")
        if not begun(time, self._next):
            return
        self._next = time + self.PERIOD
        estimate = tick.estimate
        if seen is not None:
            estimate = replace(estimate, gimbal_angle=seen.value[:, -1])
        momentum = np.linalg.norm(self._array.momentum(estimate), axis=1)
        margin = singular_margin(self._array, estimate)
        self._momentum = np.maximum(self._momentum, momentum)
        self._least = np.minimum(self._least, margin)
        if self._near is None:
            self._near = np.full(len(margin), np.nan)
        self._near = np.where((margin < SINGULAR) & np.isnan(self._near), time, self._near)
        if margin[0] < SINGULAR and not self._before:
            self._say = None  # it begins so, and that is known
        if self._say is not None:
            self._warn(time, float(margin[0]), float(momentum[0]), self._say)

    def _warn(
        self, time: float, margin: float, momentum: float, say: Callable[[str], None]
    ) -> None:
        """Once, as soon as the margin is below `EARLY` and falls."""
        self._before = [(t, m) for t, m in self._before if t >= time - self.PACE] + [(time, margin)]
        first, then = self._before[0]
        if not (margin < self.EARLY and then > margin):
            return
        left = (margin - SINGULAR) * (time - first) / (then - margin)
        when = f"at this pace in {left:.0f} s" if left > 0.0 else "by now"
        say(
            f"warning: at {time:.0f} s the gyros hold {momentum:.3g} N m s, and their margin to a "
            f"singular state is down to {margin:.2g}: {when} they can hardly give the commanded "
            "torque; bring the CM closer to the CR, or end the manoeuvre"
        )
        self._say = None

    def rows(self) -> dict[str, Any]:
        """Largest momentum, least margin, and since when that was below `SINGULAR`, (n,) each."""
        if self._near is None:
            return {}
        return {
            "gyro_momentum_max_N_m_s": self._momentum,
            "gyro_margin_min": self._least,
            "gyro_near_singular_at_s": self._near,
        }
