"""The baseline of a diagnosis: logs checked and their conventions corrected, the base fitted."""

from collections.abc import Sequence

import numpy as np

from twin.conventions import ConventionFinding, check_conventions, corrected
from twin.diagnosis.explanation import Explanation, explain
from twin.errors import TwinError, UsageError
from twin.identification.excitation import BLIND
from twin.identification.identification import calibrated
from twin.identification.prediction_error import NORMAL, Fit, fit_disturbed
from twin.identification.start import (
    along_what_rings,
    base_of,
    first_biases,
    first_theta,
    momentum_fit,
    rings,
)
from twin.platform import Platform
from twin.predict.base import BaseParameters
from twin.predict.body import Body, body_of
from twin.predict.forces import predicted_machine
from twin.predict.innovations import Innovations, Problem
from twin.predict.logs import OF_PARTS, check_possible, motion_of, within_range
from twin.recording import Recording

ENOUGH = 60
"""Measured values that logs must hold for each unknown. With fewer, noise and motion are too
uncertain to test causes along them."""
SIZE_UNKNOWN = 0.04
"""Standard deviation of a moment of inertia, of what is stated, above which logs do not tell it."""


def check_logs(recordings: Sequence[Recording], platform: Platform) -> None:
    """Check logs before a fit.

    Raises:
        UsageError: a log is of a machine with other or far smaller parts, a sensor of its motion
            was off or at the end of a range that nobody stated, or streams share no time.
    """
    for whole in recordings:
        recording, said = within_range(whole, platform)
        empty = [name for name, series in recording.items() if not len(series)]
        if empty:
            why = "".join(f"{sentence}; " for sentence in said)
            raise UsageError(
                f"{recording.source}: {why}nothing is left of {', '.join(empty)}: look at its "
                "unit, or at the range in platform.toml"
                if said
                else f"{recording.source}: {', '.join(empty)} holds no rows; record it again, or "
                "leave the stream out"
            )
        _check_parts(recording, platform)
        check_possible(recording, platform)


def check_numbers(bodies: Sequence[Body], base: BaseParameters) -> None:
    """Check that logs hold enough measured values for the unknowns.

    Raises:
        UsageError: they hold fewer than `ENOUGH` for each.
    """
    held = sum(body.samples for body in bodies)
    sought = len(base.names) + sum(len(body.bias_scale) + body.start.width for body in bodies)
    if held < ENOUGH * sought:
        lasts = sum(float(body.motion.time[-1] - body.motion.time[0]) for body in bodies)
        raise UsageError(
            f"the logs are too short: they hold {held} numbers of what {base.machine.platform.name}"
            f" did, for {sought} unknowns (base, biases and start); record {ENOUGH * sought} or "
            f"more: {lasts * ENOUGH * sought / held:.0f} s at these rates, or faster"
        )


def check_seen(baseline: Explanation) -> None:
    """Check that logs of a healthy model determine its inertia.

    Raises:
        UsageError: no moment of inertia is determined, so that no torque could be seen either.
    """
    names, scale = baseline.base.names, baseline.base.scale
    half = NORMAL * np.sqrt(np.diag(baseline.covariance))[: len(names)]
    moments = [i for i, name in enumerate(names) if name in ("J", "Jxx", "Jyy", "Jzz")]
    if moments and all(half[i] > BLIND * scale[i] for i in moments):
        platform = baseline.base.machine.platform.name
        raise UsageError(
            f"these logs show no more than the sensors' noise: {platform} hardly moves in them, or "
            f"not for long enough to tell {', '.join(names[i] for i in moments)} to half of what "
            "is stated, and what a cause would do could not be seen either; that is no verdict on "
            "the model: record a run in which the machine turns about all its axes, with what "
            "drives it"
        )


def _check_parts(recording: Recording, platform: Platform) -> None:
    for parts, streams in OF_PARTS.items():
        if getattr(platform, parts):
            continue
        for name in streams:
            if name in recording and bool(np.any(recording[name].value)):
                raise UsageError(
                    f"{recording.source} has {name}, but {platform.name} has no {parts}: name "
                    "the log's own machine, or add the parts to its folder"
                )


def read_rightly(
    recording: Recording, platform: Platform
) -> tuple[Recording, tuple[ConventionFinding, ...]]:
    """A part of a log with its conventions corrected, and the findings.

    A late clock is not corrected: it is a candidate, and is fitted with the others.
    """
    log = calibrated(recording.without_truth(), platform)
    result = tuple(
        convention
        for convention in check_conventions(log, platform)
        if convention.kind != "clock_lag"
    )
    return corrected(log, list(result)), result


def baseline_of(
    logs: Sequence[Recording],
    platform: Platform,
    *,
    follows: bool = True,
    base: BaseParameters | None = None,
) -> Explanation:
    """Fit the base alone.

    Where the logs tell no moment of inertia of a ball to `SIZE_UNKNOWN`, as where nothing of known
    size drives it, its largest one is held as stated: J, m r and every torque share a factor.

    Args:
        logs: checked, and their conventions corrected.
        platform: the machine, as stated.
        follows: whether the motion is continuous; else segments are independent.
        base: what is fitted; None: what these logs tell.
    """
    machine = predicted_machine(platform)
    bodies = [body_of(machine, log, motion_of(log, platform)) for log in logs]
    if base is None:
        _, base = base_of(machine, logs)
        largest = _of_unknown_size(bodies, base)
        base = base if largest is None else base.without(largest)
    check_numbers(bodies, base)
    return _fitted(bodies, base, follows=follows)


def _of_unknown_size(bodies: Sequence[Body], base: BaseParameters) -> int | None:
    """Place of the largest moment of inertia of a ball whose logs would tell none of them, were the
    machine as stated; None of any other, and where platform.toml says how well J is known."""
    platform = base.machine.platform
    if platform.base.kind != "ball" or base.held_moment or platform.inertia_sd is not None:
        return None
    problem = Problem(bodies, base)
    start = problem.start(base.as_stated, [first_biases(body) for body in bodies])
    moments = [base.names.index(name) for name in ("Jxx", "Jyy", "Jzz")]
    try:
        spread = np.sqrt(np.diag(problem.innovations(start).covariance))[moments]
    except (TwinError, np.linalg.LinAlgError):
        return None
    known = spread < SIZE_UNKNOWN * base.as_stated[moments]
    return None if known.any() else max(moments, key=lambda i: base.as_stated[i])


def _fitted(bodies: Sequence[Body], base: BaseParameters, *, follows: bool) -> Explanation:
    """A fit of a base."""
    machine, without_joints = base.machine, base.of_body
    pairs = [(body.recording, body.motion) for body in bodies]
    first = first_theta(without_joints, momentum_fit(pairs, without_joints))
    theta = np.concatenate([first, base.as_stated[len(first) :]])
    problem = Problem(bodies, base)
    biases = [first_biases(body) for body in bodies]
    start = problem.start(theta, biases)
    result = explain(bodies, base, (), start, follows=follows)
    if not isinstance(result.prediction, Innovations):
        return result
    if not result.converged:
        # the momentum fit may be further off than the machine as stated
        start_as_stated = problem.start(base.as_stated, biases)
        again = explain(bodies, base, (), start_as_stated, follows=follows)
        result = min(result, again, key=lambda item: item.cost)
    if not result.converged and isinstance(result.prediction, Innovations):
        # a white torque lets the fit converge from a bad start
        near = fit_disturbed(problem, Fit(result.prediction, converged=False), start)
        again = explain(bodies, base, (), near.at, follows=follows)
        result = min(result, again, key=lambda item: item.cost)
    if rings(machine) and isinstance(result.prediction, Innovations):
        settled = Fit(result.prediction, converged=result.converged)
        bodies = along_what_rings(result.problem, settled)[0].bodies
        result = explain(bodies, base, (), result.at, follows=follows)
    left = result.account.left
    known = [body.with_noise_of(parts) for body, parts in zip(bodies, left, strict=True)]
    if all(new is body for new, body in zip(known, bodies, strict=True)):
        return result
    return explain(known, base, (), result.at, follows=follows)
