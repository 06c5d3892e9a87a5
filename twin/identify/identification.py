"""Logs and a platform in; J, m r, their intervals, and what the logs cannot tell out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError, UnknownName, UsageError
from twin.identify.excitation import common_scale, not_excited
from twin.identify.momentum import MomentumFit, gyro_bias, momentum_fit
from twin.identify.prediction_error import NORMAL, Fit, fit, fit_disturbed
from twin.model import compile_model
from twin.platform import Platform
from twin.predict.base import BaseParameters, base_parameters
from twin.predict.body import Body, body_of
from twin.predict.innovations import Problem
from twin.predict.motion import motion_of
from twin.recording import Recording

Array = NDArray[np.float64]

Method = Literal["prediction-error", "momentum"]
METHODS: tuple[str, ...] = get_args(Method)

SURE = 0.2
"""Of a parameter's scale: half an interval with which the momentum's answer is worth starting from.
"""


@dataclass(frozen=True)
class Misfit:
    """Mean squared innovation, of all streams or of one."""

    name: str
    chi2_per_sample: float
    low: float
    high: float
    """A true model stays between these 95 times in 100, the noise known as well as it is."""

    @property
    def is_noise(self) -> bool:
        """Whether no more is left than noise."""
        return self.chi2_per_sample <= self.high


@dataclass(frozen=True)
class Identification:
    """What logs say of the base of a platform."""

    method: str
    platform: Platform
    recordings: tuple[Recording, ...]
    base: BaseParameters
    theta: Array
    """(p,)."""
    covariance: Array
    """(p, p)."""
    quantile: float
    """Half a 95 % interval is this many standard deviations."""
    not_excited: tuple[str, ...]
    """A sentence each."""
    misfit: tuple[Misfit, ...] = ()
    """Of a motion that follows the model exactly: of all innovations, then stream by stream; empty
    for a method that has none."""
    fit: Fit | None = None
    """Of the prediction-error method."""

    @property
    def disturbance(self) -> float:
        """Of the white torque about each base axis that stands for what the model lacks
        [N m s^0.5]; 0 where it lacks nothing."""
        return 0.0 if self.fit is None else float(np.sqrt(self.fit.innovations.intensity))

    @property
    def half_widths(self) -> Array:
        """(p,) half the 95 % intervals."""
        return self.quantile * np.sqrt(np.diag(self.covariance))

    def document(self) -> Mapping[str, Any]:
        """For `--json`."""
        document: dict[str, Any] = {
            "method": self.method,
            "base": self.base.table(self.theta, self.covariance, self.quantile),
            "not_excited": list(self.not_excited),
        }
        if self.misfit:
            document["chi2_per_sample"] = {
                part.name: {"value": part.chi2_per_sample, "band": [part.low, part.high]}
                for part in self.misfit
            }
            document["disturbance"] = self.disturbance
        return document


def identify(
    recordings: Sequence[Recording], platform: Platform, method: str = "prediction-error"
) -> Identification:
    """Identify the base of a platform from logs, all together.

    Args:
        recordings: at least one; a simulation's true states are not looked at.
        platform: the machine, as stated.
        method: `prediction-error` or `momentum`.

    Raises:
        UsageError: no logs, or a log without the streams that are needed.
        UnknownName: no such method.
        TwinError: what the logs say is no rigid body.
    """
    if method not in METHODS:
        raise UnknownName("method", method, METHODS)
    if not recordings:
        raise UsageError("no log is given")
    logs = [recording.without_truth() for recording in recordings]
    machine = compile_model(platform)
    base = base_parameters(machine)
    motions = [motion_of(log, platform) for log in logs]
    pairs = list(zip(logs, motions, strict=True))
    first = momentum_fit(pairs, base)
    unseen = common_scale(machine, logs)
    if method == "momentum":
        half = first.quantile * np.sqrt(np.diag(first.covariance))
        return Identification(
            method,
            platform,
            tuple(logs),
            base,
            first.theta,
            first.covariance,
            first.quantile,
            (*not_excited(base, half), *unseen),
        )
    bodies = [body_of(machine, log, motion) for log, motion in pairs]
    problem = Problem(bodies, base)
    biases = [_biases(body) for body in bodies]
    start = problem.start(_start(base, first), biases)
    found = fit(problem, start)
    misfit = _misfit(problem, found)
    if not misfit[0].is_noise:
        found = fit_disturbed(problem, found, start)
    covariance, quantile = found.covariance()
    half = quantile * np.sqrt(np.diag(covariance))
    return Identification(
        method,
        platform,
        tuple(logs),
        base,
        found.at.theta,
        covariance,
        quantile,
        (*not_excited(base, half), *unseen),
        misfit,
        found,
    )


def _start(base: BaseParameters, first: MomentumFit) -> Array:
    """The momentum's answer where it is sure, if some rigid body has it, else as stated."""
    half = first.quantile * np.sqrt(np.diag(first.covariance))
    known = half < SURE * base.scale
    theta = np.where(known, first.theta, base.as_stated)
    try:
        base.model(theta)
    except TwinError:
        return base.as_stated
    return theta


def _biases(body: Body) -> Array:
    """(b,) first guess of the sensors' constant errors."""
    guess = gyro_bias(body.recording)
    return np.concatenate(
        [
            guess[o.bias > 0.0] if o.stream == "gyro" else np.zeros(np.count_nonzero(o.bias))
            for o in body.outputs
        ]
    )


def _misfit(problem: Problem, found: Fit) -> tuple[Misfit, ...]:
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    variance: dict[str, float] = {}
    for body, rows in zip(problem.bodies, found.innovations.left(), strict=True):
        for output, values in zip(body.outputs, body.gather(rows), strict=True):
            name = output.stream
            squares[name] = squares.get(name, 0.0) + float(np.sum(np.square(values)))
            counts[name] = counts.get(name, 0) + values.size
            # An estimated noise goes with the samples that it comes from.
            unsure = 1.0 if output.stated else float(np.mean(1.0 / output.worth - 1.0))
            variance[name] = variance.get(name, 0.0) + 2.0 * values.size * unsure
    fitted = found.innovations.columns.shape[1] + sum(s.width for s in found.at.starts)
    total = sum(counts.values())
    parts = [("all", sum(squares.values()), total, sum(variance.values()))]
    parts += [(name, squares[name], counts[name], variance[name]) for name in squares]
    misfits: list[Misfit] = []
    for name, square, count, spread in parts:
        freedom = max(count - fitted * count / total, 1.0)
        half = NORMAL * float(np.sqrt(spread)) / freedom
        misfits.append(Misfit(name, square / freedom, 1.0 - half, 1.0 + half))
    return tuple(misfits)
