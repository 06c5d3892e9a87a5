"""Levenberg-Marquardt on the predicted trajectory: one run from the start of a log to its end.

Minimised are the readings' squared distances from the trajectory in units of their noise, over the
base, the sensors' biases and the first state. It takes wheels' torques and the model as exact, and
a machine that falls over loses the trajectory; the prediction error method starts anew, piece by
piece, and ties the pieces together. Source: G. Sharifi, M. Mirshams, H. Shahmohamadi Ousaloo, Mass
properties identification and automatic mass balancing system, 2019, eq. 12 to 16 (where the weight
is 1 / sigma^2, not 1 / sigma), here by MINPACK.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.errors import TwinError, UsageError
from twin.identification.linear.least_squares import Estimate
from twin.identification.prediction_error import NORMAL
from twin.identification.start import first_biases
from twin.predict.base import BaseParameters
from twin.predict.body import Body
from twin.predict.logs import Motion
from twin.predict.response import command_step
from twin.predict.sensors import Grid
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
) -> Estimate:
    """Fit logs together.

    Args:
        logs: each with its smoothed motion, which gives the first state to start from.
        base: the parameters sought.
        theta: (p,) where they start.

    Raises:
        UsageError: the trajectory from there loses the logs.
    """
    bodies = [_in_one(recording, motion, base) for recording, motion in logs]
    trajectories = _Trajectories(bodies, base, theta)
    start = np.zeros(len(trajectories.scale))
    if trajectories.at(start) is None:
        raise UsageError(
            "levenberg-marquardt starts from a trajectory that moves beyond all bounds; use "
            "prediction-error, or state a base in platform.toml that is nearer to the machine's"
        )
    found = least_squares(
        trajectories.residual, start, trajectories.slope, method="lm", max_nfev=EVALUATIONS
    )
    slope = trajectories.slope(found.x)
    freedom = max(np.count_nonzero(found.fun) - len(start), 1)
    # what is left is taken for white, and for as large as it is
    covariance = np.linalg.pinv(slope.T @ slope) * max(2.0 * found.cost / freedom, 1.0)
    p, scale = len(theta), base.scale
    return Estimate(
        theta + found.x[:p] * scale, covariance[:p, :p] * np.outer(scale, scale), NORMAL
    )


class _Trajectories:
    """Of some logs, as functions of changes of the base, then of each log's first state and biases,
    all in units of their scale."""

    def __init__(self, bodies: Sequence[Body], base: BaseParameters, theta: Array) -> None:
        self.bodies, self.base, self.theta = bodies, base, theta
        self.biases = [first_biases(body) for body in bodies]
        own = [
            np.concatenate([np.full(body.start.width, START), body.bias_scale]) for body in bodies
        ]
        self.scale = np.concatenate([base.scale, *own])
        self._edges = np.cumsum([len(theta), *map(len, own)])
        self._last: tuple[bytes, tuple[Array, Array] | None] = (b"", None)

    def residual(self, x: Array) -> Array:
        """Of all readings, in units of their noise."""
        now = self.at(x)
        return np.full(len(self._rows), LOST) if now is None else now[0]

    def slope(self, x: Array) -> Array:
        """d residual / d x."""
        now = self.at(x)
        assert now is not None, "a step to nowhere was taken"
        return now[1]

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


def _in_one(recording: Recording, motion: Motion, base: BaseParameters) -> Body:
    """The predictor of a log as one segment."""
    machine = base.machine
    step = command_step(machine, recording)
    begin, end = float(motion.time[0]), float(motion.time[-1])
    return Body(machine, recording, motion, Grid(begin, step, round((end - begin) / step), 1))
