"""The gain of a diagnosis on a log that took no part in it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.compare.free_run import HORIZONS, FreeRun, free_run
from twin.conventions import ConventionFinding
from twin.diagnose.diagnosis import Diagnosis
from twin.diagnose.explanation import Explanation
from twin.diagnose.reading import read_rightly
from twin.identify.prediction_error import fit
from twin.identify.start import first_biases
from twin.platform import Platform
from twin.predict.body import Body, body_of
from twin.predict.effects.columns import perturbations_of, strengths_of
from twin.predict.effects.machine import predicted_machine
from twin.predict.effects.perturbation import Perturbation
from twin.predict.effects.reference import references_of
from twin.predict.effects.retrace import retraced
from twin.predict.log.motion import motion_of
from twin.predict.log.usable import usable
from twin.predict.whitening.apart import fit_apart
from twin.predict.whitening.innovations import Problem
from twin.recording import Recording
from twin.recording.pauses import longest_of


@dataclass(frozen=True)
class Validation:
    """Base, effects and laws as they were found; only biases and initial states are this log's."""

    log_likelihood: float
    """Gained by causes and laws [nats]."""
    before: float
    """Chi-square of the innovations a sample, with the base that was found without any cause."""
    after: float
    free_runs: Mapping[float, FreeRun | None]
    conventions: tuple[ConventionFinding, ...]
    """What the log was misread by."""
    repairs: tuple[str, ...]
    """Of it, and which part of it was looked at."""


def validate(diagnosis: Diagnosis, recording: Recording) -> Validation:
    """Predict another log of the same machine with what was found; of one with pauses the longest
    part.

    Raises:
        UsageError: the log lacks the streams that the prediction needs.
    """
    used = usable(recording, diagnosis.platform)
    log, conventions = read_rightly(longest_of(used), diagnosis.platform)
    before, after = (
        _held(one, log, diagnosis.platform) for one in (diagnosis.plain, diagnosis.explained)
    )
    samples = before.bodies[0].samples
    return Validation(
        # by one scatter: where both models lose the motion, each has its own
        0.5 * (before.now.cost - after.now.cost) / after.account.inflation,
        _chi2(before) / samples,
        _chi2(after) / samples,
        {horizon: free_run(horizon, before.account, after.account) for horizon in HORIZONS},
        conventions,
        log.repairs,
    )


def _chi2(found: Explanation) -> float:
    """Of what is left, in units of the noise."""
    left = [values for log in found.account.left for values in log]
    return sum(float(np.sum(np.square(values))) for values in left)


def _held(found: Explanation, log: Recording, platform: Platform) -> Explanation:
    """An explanation on another log."""
    body = body_of(predicted_machine(platform), log, motion_of(log, platform))
    parts = [perturbations_of(effect, platform) for effect in found.effects]
    more = [part for effect in parts for part in effect]
    more += [law.perturbation for law in found.laws]
    strengths = [strengths_of(effect) for effect in found.effects]
    laws = found.at.strengths[found.layout.of_laws]
    problem = _posed(found, body, more)
    rests = np.zeros(len(problem.perturbations) - len(more))
    start = problem.start(
        found.at.theta, [first_biases(body)], np.concatenate([rests, *strengths, laws])
    )
    if found.follows:
        first = fit(problem, start)
        # once more along the motion that it gives the log, free of the sensors' noise
        body = retraced(problem, first.innovations, 0)
        problem = _posed(found, body, more)
        second = fit(problem, first.at)
        now, converged = second.innovations, second.converged
    else:
        now, converged = fit_apart(problem, start), True
    return Explanation(
        (body,),
        found.base,
        found.effects,
        tuple(np.ones(len(effect), dtype=bool) for effect in parts),
        found.laws,
        problem,
        now,
        converged,
        most=tuple(0.0 for _ in parts),
    )


def _posed(found: Explanation, body: Body, more: Sequence[Perturbation]) -> Problem:
    """What was found is held; where this log's springs rest is not."""
    rests = [part for effect in found.effects for part in references_of(effect, [body])]
    return Problem([body], found.base, [*rests, *more], held=True, strengths_held=True)
