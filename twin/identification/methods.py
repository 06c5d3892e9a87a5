"""The methods of the papers by name, each as it stands there, beside our own.

Levenberg-Marquardt on the predicted trajectory: one run from the start of a log to its end.

Minimised are the readings' squared distances from the trajectory in units of their noise, over the
base, the sensors' biases and the first state. It takes wheels' torques and the model as exact, and
a machine that falls over loses the trajectory; the prediction error method starts anew, piece by
piece, and ties the pieces together. Source: G. Sharifi, M. Mirshams, H. Shahmohamadi Ousaloo, Mass
properties identification and automatic mass balancing system, 2019, eq. 12 to 16 (where the weight
is 1 / sigma^2, not 1 / sigma), here by MINPACK.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from twin.errors import TwinError, UsageError
from twin.identification.linear import (
    BLOCK,
    Equations,
    LinearEstimate,
    energy,
    equilibria,
    filtered,
    integrated,
    least_squares,
    natural,
    power,
    recursive,
    shifted,
)
from twin.identification.prediction_error import NORMAL
from twin.identification.start import first_biases, first_theta, momentum_fit
from twin.identification.track import Track, raw_motion, track_of
from twin.predict.base import BaseParameters
from twin.predict.body import Body
from twin.predict.logs import Motion, motion_of
from twin.predict.response import command_step
from twin.predict.sensors import StepGrid
from twin.recording import Recording

Array = NDArray[np.float64]


START = 1e-2
"""A typical change of a first state [rad, rad/s]."""
LOST = 1e6
"""Standard deviations that readings are off where a trajectory has no end."""
EVALUATIONS = 60
"""Trajectories, at most."""


def levenberg_marquardt(
    logs: Sequence[tuple[Recording, Motion]], base: BaseParameters, theta: Array
) -> LinearEstimate:
    """Fit logs together.

    Args:
        logs: each with its smoothed motion, which gives the first state to start from.
        base: the parameters sought.
        theta: (p,) where they start.

    Raises:
        UsageError: the trajectory from there loses the logs.
    """
    bodies = [_unsegmented(recording, motion, base) for recording, motion in logs]
    trajectories = _Trajectories(bodies, base, theta)
    start = np.zeros(len(trajectories.scale))
    if trajectories.at(start) is None:
        raise UsageError(
            "levenberg-marquardt starts from a trajectory that moves beyond all bounds; use "
            "prediction-error, or state a base in platform.toml that is nearer to the machine's"
        )
    estimate = optimize.least_squares(
        trajectories.residual, start, trajectories.slope, method="lm", max_nfev=EVALUATIONS
    )
    slope = trajectories.slope(estimate.x)
    freedom = max(np.count_nonzero(estimate.fun) - len(start), 1)
    # what is left is taken for white, and for as large as it is
    covariance = np.linalg.pinv(slope.T @ slope) * max(2.0 * estimate.cost / freedom, 1.0)
    p, scale = len(theta), base.scale
    return LinearEstimate(
        theta + estimate.x[:p] * scale, covariance[:p, :p] * np.outer(scale, scale), NORMAL
    )


class _Trajectories:
    """Of some logs, as functions of changes of the base, then of each log's first state and biases,
    all in units of their scale."""

    def __init__(self, bodies: Sequence[Body], base: BaseParameters, theta: Array) -> None:
        self.bodies, self.base, self.theta = bodies, base, theta
        self.biases = [first_biases(body) for body in bodies]
        scales = [
            np.concatenate([np.full(body.start.width, START), body.bias_scale]) for body in bodies
        ]
        self.scale = np.concatenate([base.scale, *scales])
        self._edges = np.cumsum([len(theta), *map(len, scales)])
        self._last: tuple[bytes, tuple[Array, Array] | None] = (b"", None)

    def residual(self, x: Array) -> Array:
        """Of all readings, in units of their noise."""
        result = self.at(x)
        return np.full(len(self._rows), LOST) if result is None else result[0]

    def slope(self, x: Array) -> Array:
        """d residual / d x."""
        result = self.at(x)
        assert result is not None, "a step to nowhere was taken"
        return result[1]

    def at(self, x: Array) -> tuple[Array, Array] | None:
        """Residual and slope; None where the trajectory has no end."""
        if self._last[0] != x.tobytes():
            self._last = (x.tobytes(), self._predicted(x * self.scale))
            if self._last[1] is not None:
                self._rows = self._last[1][0]
        return self._last[1]

    def _predicted(self, change: Array) -> tuple[Array, Array] | None:
        p = len(self.theta)
        residuals, slopes = list[Array](), list[Array]()
        pairs = zip(self._edges, self._edges[1:], strict=False)
        for body, bias, (begin, end) in zip(self.bodies, self.biases, pairs, strict=True):
            width = body.start.width
            shift, more = np.split(change[begin:end], [width])
            try:
                exact = body.linearise(
                    self.base, self.theta + change[:p], bias + more, body.start.moved(shift)
                )
            except TwinError:
                return None
            linear = exact.linear
            columns = np.zeros((linear.residual.size, len(change)))
            columns[:, :p] = linear.shared[0, :, :p]
            columns[:, begin : begin + width] = linear.state[0]
            columns[:, begin + width : end] = linear.shared[0, :, p:]
            residuals.append(linear.residual[0])
            slopes.append(columns * self.scale)
        return np.concatenate(residuals), np.concatenate(slopes)


def _unsegmented(recording: Recording, motion: Motion, base: BaseParameters) -> Body:
    """The predictor of a log as one segment."""
    machine = base.machine
    step = command_step(machine, recording)
    begin, end = float(motion.time[0]), float(motion.time[-1])
    return Body(machine, recording, motion, StepGrid(begin, step, round((end - begin) / step), 1))


FEWEST = 4
"""Blocks of time for each parameter."""

Form = Literal["integrated", "natural"]


@dataclass(frozen=True)
class Settings:
    """What the papers leave to choose."""

    form: Form = "integrated"
    """Of torque, momentum and energy."""
    shift: int = 0
    """Of momentum: samples between the two ends of a difference; 0: no differences, the constant is
    fitted, which is ours."""
    corner: float = 0.5
    """Of filtered [rad/s]."""
    forgetting: float = 0.99
    """Of recursive, what a step of 0.2 s leaves of the weight of what came before."""

    def __post_init__(self) -> None:
        if self.shift < 0:
            raise UsageError(f"a shift is a number of samples, 0 or more, not {self.shift}")
        if not self.corner > 0.0:
            raise UsageError(f"the filter's corner must be above 0 rad/s, not {self.corner:g}")
        if not 0.0 < self.forgetting <= 1.0:
            raise UsageError(f"a forgetting is above 0 and at most 1, not {self.forgetting:g}")

    def named(self, method: str) -> str:
        """A method with what was chosen of it: `momentum, integrated, shift 1`."""
        form = f"{method}, {self.form}"
        return {
            "torque": form,
            "momentum": f"{form}, shift {self.shift}" if self.shift else method,
            "energy": form,
            "filtered": f"{method} at {self.corner:g} rad/s",
            "recursive": f"{method}, forgetting {self.forgetting:g}",
        }.get(method, method)


class Logs:
    """Some logs of one machine, as smoothed and as read."""

    def __init__(self, logs: Sequence[Recording], base: BaseParameters) -> None:
        self.recordings, self.base = logs, base

    @cached_property
    def smoothed(self) -> list[tuple[Recording, Motion]]:
        """Each with its smoothed motion."""
        platform = self.base.machine.platform
        return [(log, motion_of(log, platform)) for log in self.recordings]

    @cached_property
    def tracks(self) -> list[Track]:
        """Of each, as it was read."""
        kind = self.base.machine.platform.base.kind
        return [
            track_of(self.base.machine, log, raw_motion(log, kind), raw=True)
            for log in self.recordings
        ]

    @cached_property
    def calm(self) -> list[Track]:
        """Of each, as smoothed."""
        return [track_of(self.base.machine, log, motion) for log, motion in self.smoothed]


Method = Callable[[Logs, Settings], LinearEstimate]


def _solved(equations: Sequence[Equations], logs: Logs) -> LinearEstimate:
    """Its blocks so short that there are several for each parameter."""
    pairs = zip(equations, logs.tracks, strict=True)
    seconds = sum(float(equation.time[-1] - equation.time[0]) for equation in equations)
    return least_squares(
        [item.about(track.axis) for item, track in pairs],
        logs.base,
        block=min(BLOCK, seconds / (FEWEST * len(logs.base.scale))),
    )


def _form(track: Track, settings: Settings) -> Equations:
    return natural(track) if settings.form == "natural" else integrated(track)


def _torque(logs: Logs, settings: Settings) -> LinearEstimate:
    return _solved([_form(track, settings) for track in logs.tracks], logs)


def _momentum(logs: Logs, settings: Settings) -> LinearEstimate:
    if settings.shift == 0:
        return momentum_fit(logs.smoothed, logs.base)
    return _solved(
        [shifted(_form(t, settings), t.attitude, settings.shift) for t in logs.tracks], logs
    )


def _energy(logs: Logs, settings: Settings) -> LinearEstimate:
    form = power if settings.form == "natural" else energy
    return _solved([form(track) for track in logs.tracks], logs)


def _filtered(logs: Logs, settings: Settings) -> LinearEstimate:
    return _solved([filtered(track, settings.corner) for track in logs.tracks], logs)


def _integrated(logs: Logs, settings: Settings) -> LinearEstimate:
    return _solved([integrated(track) for track in logs.tracks], logs)


def _recursive(logs: Logs, settings: Settings) -> LinearEstimate:
    return recursive(logs.tracks, logs.base, settings.forgetting)


def _equilibria(logs: Logs, settings: Settings) -> LinearEstimate:
    return equilibria(logs.calm, logs.base)


def _levenberg_marquardt(logs: Logs, settings: Settings) -> LinearEstimate:
    first = first_theta(logs.base, momentum_fit(logs.smoothed, logs.base))
    return levenberg_marquardt(logs.smoothed, logs.base, first)


def _ekf(logs: Logs, settings: Settings) -> LinearEstimate:
    from twin.identification.kalman import ekf

    return ekf(list(zip(logs.recordings, logs.tracks, strict=True)), logs.base)


def _ukf(logs: Logs, settings: Settings) -> LinearEstimate:
    from twin.identification.kalman import ukf

    return ukf(list(zip(logs.recordings, logs.tracks, strict=True)), logs.base)


PAPERS: Mapping[str, Method] = {
    "momentum": _momentum,
    "torque": _torque,
    "energy": _energy,
    "filtered": _filtered,
    "integrated": _integrated,
    "recursive": _recursive,
    "levenberg-marquardt": _levenberg_marquardt,
    "ekf": _ekf,
    "ukf": _ukf,
    "equilibria": _equilibria,
}
"""By name."""
