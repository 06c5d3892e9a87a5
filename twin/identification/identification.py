"""Logs and a platform in; J, m r, their intervals, and what the logs cannot tell out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.conventions.time_base import check_times
from twin.errors import UnknownName, UsageError
from twin.identification.excitation import (
    Excitation,
    common_scale,
    excitation_of,
    not_excited,
    scale_unknown,
)
from twin.identification.gimbals import as_measured
from twin.identification.methods import PAPERS, Logs, Settings
from twin.identification.momentum import momentum_fit
from twin.identification.physical import nearest_body
from twin.identification.prediction_error import NORMAL, Fit, fit, fit_disturbed
from twin.identification.ringing import along_what_rings, rings
from twin.identification.scale import (
    ROUNDS,
    Scale,
    as_taken,
    change_of,
    scaled_together,
    scales_of,
    unknown_scales,
)
from twin.identification.start import base_of, first_biases, first_theta
from twin.platform import Platform, in_gravity_of, in_order_of, taken_as_at_rest
from twin.predict.base import BaseParameters
from twin.predict.body import body_of
from twin.predict.forces import Perturbation, predicted_machine
from twin.predict.innovations import Problem, Unknowns
from twin.predict.logs import Scaled, check_possible, motion_of, usable
from twin.recording import Recording
from twin.recording.pauses import pieces_of
from twin.shown import Shown

Array = NDArray[np.float64]

OURS = "prediction-error"
METHODS = (OURS, *PAPERS)

STRAYS = 4.0
"""Standard deviations of its mean square by which a stream leaves more than noise for certain: by
chance one in thirty thousand does."""

PERFECT = 1e-9
"""1 sigma, in parts of a parameter's scale, below which no log knows anything."""


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

    @property
    def strays(self) -> bool:
        """Whether so much more than noise is left that no interval knows of it."""
        sigma = (self.high - 1.0) / NORMAL
        return self.chi2_per_sample > 1.0 + STRAYS * sigma


@dataclass(frozen=True)
class Identification(Shown):
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
    excitation: Excitation
    not_excited: tuple[str, ...]
    """A sentence each."""
    misfit: tuple[Misfit, ...] = ()
    """Of a motion that follows the model exactly: of all innovations, then stream by stream; empty
    for a method that has none."""
    left: tuple[Misfit, ...] = ()
    """The same under the white torque that was fitted; `misfit` where none was."""
    fit: Fit | None = None
    """Of the prediction-error method."""
    scales: tuple[Scale, ...] = ()
    """Of the streams whose log.toml asks for them."""
    not_used: tuple[str, ...] = ()
    """A sentence for each stream of which nothing was used."""
    not_rigid: str = ""
    """A sentence where what fits best is no rigid body; theta is the nearest one."""

    @property
    def disturbance(self) -> float:
        """Of the white torque about each base axis that stands for what the model lacks
        [N m s^0.5]; 0 where it lacks nothing."""
        return 0.0 if self.fit is None else float(np.sqrt(self.fit.innovations.intensity))

    @property
    def doubt(self) -> str:
        """Why half widths are no 95 % intervals; empty where they are. A torque that stands for
        what the model lacks explains no misfit of one sensor or one clock."""
        total, *streams = self.left or (None,)
        worst = max(
            (one for one in streams if one.strays),
            key=lambda one: one.chi2_per_sample,
            default=None,
        )
        if worst is not None:
            times = np.sqrt(worst.chi2_per_sample)
            return (
                f"whatever torque is taken, {times:.2g} times the noise of {worst.name} is left, "
                "as where streams contradict each other: look for a late clock, a scale, or a "
                "sensor that drifts or was moved"
            )
        if total is not None and total.strays:
            return f"{np.sqrt(total.chi2_per_sample):.2g} times the noise is left"
        if self.fit is not None and not self.fit.converged:
            return "the fit has not settled"
        return ""

    @property
    def half_widths(self) -> Array:
        """(p,) half the 95 % intervals, where there is no `doubt`."""
        return self.quantile * np.sqrt(np.diag(self.covariance))

    def document(self) -> Mapping[str, Any]:
        """For `--json`."""
        document: dict[str, Any] = {
            "method": self.method,
            "base": self.base.table(self.theta, self.covariance, self.quantile),
            "excitation": self.excitation.document(),
            "not_excited": list(self.not_excited),
            "not_rigid": self.not_rigid or None,
            "taken_as_at_rest": list(taken_as_at_rest(self.recordings, self.platform)),
        }
        if self.base.joints:
            document["joints"] = self._joints()
        if self.scales:
            document["scales"] = {scale.stream: scale.document() for scale in self.scales}
        if self.misfit:
            document["chi2_per_sample"] = {
                part.name: {"value": part.chi2_per_sample, "band": [part.low, part.high]}
                for part in self.misfit
            }
            document["disturbance"] = self.disturbance
            document["intervals_hold"] = not self.doubt
            document["doubt"] = self.doubt or None
        return document

    def _joints(self) -> Mapping[str, Any]:
        first = len(self.theta) - len(self.base.joints)
        return {
            joint.name: {"value": v, "low": v - half, "high": v + half, "unit": joint.unit}
            for joint, v, half in zip(
                self.base.joints,
                self.theta[first:].tolist(),
                self.half_widths[first:].tolist(),
                strict=True,
            )
        }


def identify(
    recordings: Sequence[Recording],
    platform: Platform,
    method: str = OURS,
    settings: Settings | None = None,
    *,
    physical: bool = False,
) -> Identification:
    """Identify the base of a platform from logs, all together.

    Args:
        recordings: at least one; a simulation's true states are not looked at.
        platform: the machine, as stated.
        method: `prediction-error`, or one of the papers'.
        settings: of the papers' methods.
        physical: give the nearest rigid body; prediction-error does so without being asked.

    Raises:
        UsageError: no logs, or a log without the streams that are needed.
        UnknownName: no such method.
        TwinError: what the logs say is no rigid body.
    """
    if method not in METHODS:
        raise UnknownName("method", method, METHODS)
    return by_method(ground_of(recordings, platform), method, settings, physical=physical)


@dataclass(frozen=True)
class Ground:
    """What every method begins with."""

    scaled: list[Scaled]
    """The logs, with first guesses of scales that nobody stated."""
    scales: tuple[Perturbation, ...]
    """Of those, to be fitted."""
    logs: Logs
    full: BaseParameters
    """With what the MJCF states of joints; `logs.base` is J and m r alone."""
    unseen: tuple[str, ...]
    """Sentences on what no motion in them shows."""
    not_used: tuple[str, ...]
    """Sentences on streams that were left out."""


def ground_of(recordings: Sequence[Recording], platform: Platform) -> Ground:
    """Of some logs of a machine, as for `identify`."""
    if not recordings:
        raise UsageError("no log is given")
    platform = in_gravity_of(recordings, platform)
    machine = predicted_machine(platform)
    for recording in recordings:
        check_times(recording, platform)
        check_possible(recording, platform)
    used = [usable(recording, platform) for recording in recordings]
    pieces = [piece for recording in used for piece in pieces_of(recording)]
    ordered = [in_order_of(platform, recording.without_truth()) for recording in pieces]
    for recording in ordered:
        check_possible(recording, platform)
    turned = [as_measured(recording, machine) for recording in ordered]
    scaled = scaled_together([log for log, _ in turned], platform)
    logs = [log.recording for log in scaled]
    base, full = base_of(machine, logs)
    return Ground(
        scaled,
        unknown_scales(logs),
        Logs(logs, base),
        full,
        tuple(common_scale(machine, logs)),
        tuple(sentence for _, said in turned for sentence in said),
    )


def by_method(
    ground: Ground, method: str, settings: Settings | None = None, *, physical: bool = False
) -> Identification:
    """Identify by one of `METHODS`; see `identify`."""
    if method == OURS:
        return _by_prediction_error(ground)
    return _by_paper(ground, method, settings or Settings(), physical=physical)


def _by_prediction_error(ground: Ground) -> Identification:
    base, full, scaled, scales = ground.logs.base, ground.full, ground.scaled, ground.scales
    platform = base.machine.platform
    found, misfit, left = _fitted(base, full, scaled, scales)
    told = scales_of(found, scales, scaled)
    for _ in range(ROUNDS if scales else 0):
        if not all(scale.known for scale in told):
            # nothing tells them: as guessed, so that the rest may be told under that guess
            found, misfit, left = _fitted(base, full, scaled, ())
            told = as_taken(told, scaled)
            break
        change, settled = change_of(found, told)
        if settled:
            break
        scaled = [log.by({n: f for n, f in change.items() if n in log.factor}) for log in scaled]
        found, misfit, left = _fitted(base, full, scaled, scales, found.at.theta)
        told = scales_of(found, scales, scaled)
    covariance, quantile = found.covariance()
    motions = [motion_of(log.recording, platform) for log in scaled]
    half = quantile * np.sqrt(np.diag(covariance))
    nearest = nearest_body(full, found.at.theta, covariance)
    return Identification(
        OURS,
        platform,
        tuple(log.recording for log in scaled),
        full,
        nearest.theta,
        covariance,
        quantile,
        excitation_of(motions, full, covariance, quantile),
        (*not_excited(full, found.at.theta, half), *scale_unknown(told), *ground.unseen),
        misfit,
        left,
        found,
        told,
        ground.not_used,
        nearest.sentence,
    )


def _by_paper(ground: Ground, method: str, settings: Settings, *, physical: bool) -> Identification:
    logs, base = ground.logs, ground.logs.base
    _refuse_guesses(logs.recordings, method, base.machine.platform, ground.scales)
    first = PAPERS[method](logs, settings)
    # a method that knows some combination perfectly does not
    spread = first.covariance + np.diag(np.square(PERFECT * base.scale))
    nearest = nearest_body(base, first.theta, spread) if physical else None
    return Identification(
        settings.named(method),
        base.machine.platform,
        tuple(logs.recordings),
        base,
        first.theta if nearest is None else nearest.theta,
        first.covariance,
        first.quantile,
        excitation_of([m for _, m in logs.smoothed], base, first.covariance, first.quantile),
        (*not_excited(base, first.theta, first.half_widths), *ground.unseen),
        not_used=ground.not_used,
        not_rigid="" if nearest is None else nearest.sentence,
    )


def _fitted(
    plain: BaseParameters,
    base: BaseParameters,
    scaled: Sequence[Scaled],
    scales: Sequence[Perturbation],
    theta: Array | None = None,
) -> tuple[Fit, tuple[Misfit, ...], tuple[Misfit, ...]]:
    """Fit the base by prediction error from `theta`, else from what the momentum says; from the
    machine as stated, where that start loses the motion; and where that does, too, from where a
    motion leads that may stray from the model."""
    logs = [log.recording for log in scaled]
    pairs = [(log, motion_of(log, base.machine.platform)) for log in logs]
    thetas = [base.as_stated] if theta is None else [theta]
    if theta is None:
        first = first_theta(plain, momentum_fit(pairs, plain))
        told = np.concatenate([first, base.as_stated[len(first) :]])
        thetas = thetas if np.array_equal(told, base.as_stated) else [told, *thetas]
    bodies = [body_of(base.machine, log, motion) for log, motion in pairs]
    problem, biases = Problem(bodies, base, scales), [first_biases(body) for body in bodies]
    tries: list[tuple[Fit, Unknowns]] = []
    while thetas and not (tries and tries[-1][0].converged):
        start = problem.start(thetas.pop(0), biases)
        tries.append((fit(problem, start), start))
    found, start = min(tries, key=lambda one: one[0].innovations.cost)
    strayed = None
    if not found.converged and not _misfit(problem, found)[0].is_noise:
        strayed = fit_disturbed(problem, found, start)
        again = fit(problem, strayed.at) if strayed.converged else found
        found = again if again.converged else found
    if rings(base.machine):
        problem, found = along_what_rings(problem, found)
    misfit = _misfit(problem, found)
    # noise of coarse sensors hides a torque that the path does not
    disturbed = fit_disturbed(problem, found, start) if found.converged else (strayed or found)
    if strayed is not None and strayed.innovations.cost < disturbed.innovations.cost:
        disturbed = strayed
    left = _misfit(problem, disturbed) if disturbed.innovations.intensity else misfit
    return disturbed, misfit, left


def _refuse_guesses(
    recordings: Sequence[Recording],
    method: str,
    platform: Platform,
    scales: Sequence[Perturbation],
) -> None:
    """The papers' methods know J and m r only where everything else is measured."""
    if scales:
        raise UsageError(
            f'{scales[0].stream} has `scale = "fit"`, which the method {method} cannot fit; '
            f"use {OURS}, or state the scale"
        )
    if platform.wheels and any("wheel_speed" not in recording for recording in recordings):
        raise UsageError(
            f"a log has no wheel_speed, without which the method {method} knows no wheel's "
            f"momentum; use {OURS}"
        )


def _misfit(problem: Problem, found: Fit) -> tuple[Misfit, ...]:
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    variance: dict[str, float] = {}
    for body, rows in zip(problem.bodies, found.innovations.left(), strict=True):
        for output, values in zip(body.outputs, body.cells.gather(rows), strict=True):
            if not output.scatters:
                continue
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
