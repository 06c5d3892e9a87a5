"""Figures of merit of each run, gathered tick by tick, one row per run."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.metrics import Metrics, begun
from twin.platform import Platform
from twin.procedures import Notes, Phase
from twin.rotation import tilt, vertical_body
from twin.signals import Tick

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Metric:
    """One number a run."""

    unit: str
    words: str
    of: str = "run"
    """Procedure that has it: `run`, `balance`, or `both`."""
    needs: str = ""
    """`ball`, `hinge`, `turns` (no hinge), `travels`, `wheels` or `stages`: without these on the
    platform there is none."""
    worse: int = 1
    """1: a larger one is worse; -1: a smaller one; 0: neither."""


METRICS: dict[str, Metric] = {
    "tracking_error_rms": Metric("rad", "rms tracking error at the end", "run", "turns"),
    "tracking_error_max": Metric("rad", "largest tracking error", "run", "turns"),
    "place_error_rms": Metric("m", "rms distance from its place at the end", "run", "travels"),
    "place_error_max": Metric("m", "largest of these distances", "run", "travels"),
    "tilt_max": Metric("rad", "largest tilt", "both", "turns"),
    "tilt_rms": Metric("rad", "rms tilt at the end", "run", "turns"),
    "in_plane_rms": Metric(
        "1",
        "rms in-plane part of gravity's direction at the end, as estimated",
        "run",
        "turns",
    ),
    "rate_rms": Metric("rad/s", "rms rate at the end", "run", "turns"),
    "joint_angle_max": Metric("rad", "largest angle of the hinge", "run", "hinge"),
    "joint_rate_rms": Metric("rad/s", "rms rate of the hinge at the end", "run", "hinge"),
    "gravity_torque": Metric(
        "N m", "gravity torque at the worst attitude, at the end", "both", "ball"
    ),
    "gravity_torque_in_plane": Metric(
        "N m", "gravity torque on the level body, at the end", "both", "ball"
    ),
    "wheel_momentum_max": Metric("N m s", "largest momentum of a wheel", "run", "wheels"),
    "wheel_saturated_at": Metric("s", "time at which the first wheel is full", "run", "wheels", -1),
    "stage_travel": Metric("m", "path of all masses together", "both", "stages"),
    "balanced": Metric("1", "share balanced", "balance", worse=-1),
    "balanced_after": Metric("s", "time until balanced", "balance"),
    "identified": Metric("1", "identifications of the offset", "balance", worse=0),
    "residual_torque": Metric("N m", "residual torque as stated", "balance"),
    "residual_torque_low": Metric("N m", "lower end of its 95 % interval", "balance", worse=0),
    "residual_torque_high": Metric("N m", "upper end of its 95 % interval", "balance"),
    "residual_torque_observed": Metric("N m", "torque observed in free float", "balance"),
    "residual_chi2": Metric(
        "1", "chi2 per sample of the logs under the statement: 1 if only noise is left", "balance"
    ),
}
"""By name. `At the end`: in the last part of the run that the specification calls steady."""


def metric_names(platform: Platform, procedure: str) -> tuple[str, ...]:
    """Those that a procedure on a platform has."""
    has = {
        "": True,
        "ball": platform.base.kind == "ball",
        "hinge": platform.base.kind == "hinge",
        "turns": platform.base.kind != "hinge",
        "wheels": bool(platform.wheels),
        "stages": bool(platform.stages),
        "travels": platform.base.travels and platform.base.kind != "hinge",
    }
    return tuple(
        name
        for name, metric in METRICS.items()
        if metric.of in (procedure, "both") and has[metric.needs]
    )


class Merits:
    """Observer of a loop. What a run is worth does not change once its procedure has ended."""

    def __init__(self, platform: Platform, n: int, since: float, notes: Notes | None) -> None:
        """Start before the first tick.

        Args:
            platform: the machine.
            n: runs.
            since: from when on a run is steady [s].
            notes: of a balancing.
        """
        self._platform = platform
        self._since = since
        self._notes = notes
        self._tracking = Metrics(platform, settle=since)
        self._sums: dict[str, Array] = {}
        self._counted = 0
        self._travel = np.zeros(n)
        self._tilt = np.zeros(n)
        self._angle = np.zeros(n)
        self._offset = np.full((n, 3), np.nan)
        self._stood: Array | None = None

    def collect(self, tick: Tick) -> None:
        """One tick."""
        going = self._going(len(self._travel))
        truth = {name: samples.value[:, -1] for name, samples in tick.truth.items()}
        with np.errstate(all="ignore"):  # a run that was stopped may hold anything
            self._tracking.collect(tick)
            if "truth_stage_position" in truth:
                stands = truth["truth_stage_position"].copy()
                way = stands - (stands if self._stood is None else self._stood)
                self._travel = self._travel + going * np.abs(way).sum(axis=1)
                self._stood = stands
            steady = begun(tick.reading.time, self._since)
            self._counted += steady
            if self._platform.base.kind == "hinge":
                angle = np.abs(truth["truth_joint_angle"][:, 0])
                self._angle = np.maximum(self._angle, angle)
                if steady:
                    self._add("joint_rate_rms", truth["truth_joint_rate"][:, 0] ** 2)
                return
            if "truth_center_of_mass_offset" in truth:
                offset = truth["truth_center_of_mass_offset"]
                self._offset = np.where(going[:, None], offset, self._offset)
            lean = tilt(truth["truth_attitude"])
            self._tilt = np.where(going, np.maximum(self._tilt, lean), self._tilt)
            if steady:
                up = vertical_body(tick.estimate.attitude)
                self._add("tilt_rms", lean**2)
                self._add("in_plane_rms", up[:, 0] ** 2 + up[:, 1] ** 2)
                self._add("rate_rms", _square(truth["truth_rate"]))

    def rows(self) -> dict[str, Array]:
        """All metrics of the platform, (n,) each; NaN where a run has none."""
        result = {
            name: np.sqrt(total / max(self._counted, 1)) for name, total in self._sums.items()
        }
        result |= {"tilt_max": self._tilt, "joint_angle_max": self._angle}
        result["stage_travel"] = self._travel
        gravity, offset = self._platform.gravity, self._offset
        result["gravity_torque"] = gravity * np.sqrt(_square(offset))
        plane = offset[:, 0] ** 2 + offset[:, 1] ** 2
        result["gravity_torque_in_plane"] = gravity * np.sqrt(plane)
        tracked: dict[str, Any] = self._tracking.rows()
        for name, unit in (
            *(("tracking_error_rms", "rad"), ("tracking_error_max", "rad")),
            *(("place_error_rms", "m"), ("place_error_max", "m")),
        ):
            if f"{name}_{unit}" in tracked:
                result[name] = np.asarray(tracked[f"{name}_{unit}"])
        if self._platform.wheels:
            result["wheel_momentum_max"] = np.max(tracked["wheel_momentum_max_N_m_s"], axis=1)
            result["wheel_saturated_at"] = np.asarray(tracked["wheel_saturated_at_s"])
        if self._notes is not None:
            result |= _balanced(self._notes)
        return result

    def _going(self, n: int) -> NDArray[np.bool_]:
        if self._notes is None:
            return np.ones(n, dtype=np.bool_)
        return np.array([run.phase not in (Phase.done, Phase.stopped) for run in self._notes.runs])

    def _add(self, name: str, square: Array) -> None:
        self._sums[name] = square + self._sums.get(name, 0.0)


def _balanced(notes: Notes) -> dict[str, Array]:
    rows: dict[str, list[float]] = {name: [] for name, m in METRICS.items() if m.of == "balance"}
    for run in notes.runs:
        done = run.phase is Phase.done
        rows["balanced"].append(float(done))
        rows["balanced_after"].append(run.since if done else np.nan)
        rows["identified"].append(float(run.identified))
        stated = run.statement
        torque = None if stated is None else stated.residual_torque
        rows["residual_torque"].append(np.nan if torque is None else torque.value)
        rows["residual_torque_low"].append(np.nan if torque is None else torque.low)
        rows["residual_torque_high"].append(np.nan if torque is None else torque.high)
        rows["residual_torque_observed"].append(
            np.nan if stated is None else stated.residual_torque_observed
        )
        rows["residual_chi2"].append(np.nan if stated is None else stated.misfit.chi2_per_sample)
    return {name: np.array(values) for name, values in rows.items()}


def _square(vectors: Array) -> Array:
    """Squared length of each row, with the same bits in any company."""
    return vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2


def selected(rows: dict[str, Array], names: Sequence[str], n: int) -> dict[str, Array]:
    """The metrics of those names; NaN where nothing was counted."""
    return {name: rows.get(name, np.full(n, np.nan)) for name in names}
