"""A model held against a log: as built and refitted, what it misses, where and why."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.compare.balance import Balance, balance
from twin.compare.explanation import Side, side
from twin.compare.free_run import HORIZONS, FreeRun, free_run
from twin.compare.misfit import coloured, is_noise
from twin.compare.selection import TIED
from twin.compare.symptoms import Domain, Symptom, symptoms_of
from twin.conventions import ConventionFinding, check_conventions, corrected
from twin.identify.momentum import momentum_fit
from twin.identify.prediction_error import fit
from twin.identify.ringing import along_what_rings, rings
from twin.identify.start import base_of, first_biases, first_theta
from twin.noise import NoiseFinding, noise_findings
from twin.platform import Platform, in_gravity_of, in_order_of
from twin.predict.body import Body, body_of
from twin.predict.effects.machine import predicted_machine
from twin.predict.log.motion import motion_of
from twin.predict.log.possible import check_possible
from twin.predict.log.usable import usable
from twin.predict.parameters.base import BaseParameters
from twin.predict.whitening.innovations import Problem
from twin.recording import Recording
from twin.recording.pauses import longest_of

Array = NDArray[np.float64]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Comparison:
    """A platform's model held against one log."""

    platform: Platform
    recording: Recording
    """As it was compared: read rightly."""
    conventions: tuple[ConventionFinding, ...]
    """Streams that had been read wrongly; corrected where one reading only is possible."""
    noise: tuple[NoiseFinding, ...]
    body: Body
    base: BaseParameters
    as_built: Side
    refitted: Side | None
    """None where the base was to stay as built."""
    free_runs: Mapping[float, FreeRun | None]
    """By horizon [s]; None where the log is too short."""
    balance: Balance

    @property
    def best(self) -> Side:
        """Refitted, unless that was not asked for."""
        return self.refitted or self.as_built

    @property
    def healthy(self) -> bool:
        """Whether the best model without any symptom leaves nothing but white noise."""
        return self.best.healthy and not coloured(self.best.plain.misfits)

    @property
    def verdict(self) -> str:
        """healthy; explained: the laws found leave no more than noise; or unexplained."""
        if self.healthy:
            return "healthy"
        explained = self.best.strengths and is_noise(self.best.explained.misfits)
        return "explained" if explained else "unexplained"

    @property
    def found(self) -> Side:
        """The side whose laws are told first: the best one, unless it found none."""
        return self.best if self.best.strengths else self.as_built

    @property
    def where(self) -> tuple[tuple[Domain, ...], tuple[Domain, ...]]:
        """Where the discrepancy lives, and where it could live as well by this log.

        Where the laws live that were found, and what ties with them; without any law, what stands
        out most on its own.
        """
        if self.found.strengths:
            ties = [tie for strength in self.found.strengths for tie in strength.ties]
            own = _domains(strength.symptom for strength in self.found.strengths)
            return own, tuple(d for d in _domains(ties) if d not in own)
        out = [score for score in self.best.scores if score.stands_out]
        limit = max((score.evidence - score.needed for score in out), default=0.0) - TIED
        first, *others = _domains(s.symptom for s in out if s.evidence - s.needed > limit) or (
            None,
        )
        return ((first,), tuple(others)) if first else ((), ())


def _domains(symptoms: Iterable[Symptom]) -> tuple[Domain, ...]:
    return tuple(dict.fromkeys(symptom.domain for symptom in symptoms))


def compare(
    recording: Recording,
    platform: Platform,
    *,
    as_built: bool = False,
    say: Say = lambda _: None,
) -> Comparison:
    """Hold a platform's model against a log.

    Args:
        recording: a measured log, or a run.
        platform: the machine it was measured on.
        as_built: leave the base as platform.toml states it; only initial states are fitted.
        say: told what is being done.

    Raises:
        UsageError: the log lacks the streams that the prediction needs, they share no time, or it
            leans beyond the machine's stop.
    """
    platform = in_gravity_of([recording], platform)
    recording = in_order_of(platform, recording.without_truth())
    check_possible(recording, platform)
    recording = longest_of(usable(recording, platform))
    say("conventions and noise")
    conventions = tuple(check_conventions(recording, platform))
    recording = corrected(recording, list(conventions))
    noise = tuple(noise_findings(recording, platform))
    body, plain, base = prepare(recording, platform)
    symptoms, biases = symptoms_of([body]), first_biases(body)
    refitted = None
    if not as_built:
        say("the base refitted")
        first = first_theta(plain, momentum_fit([(recording, body.motion)], plain))
        theta = np.concatenate([first, base.as_stated[len(first) :]])
        refitted = side(body, base, symptoms, theta, biases, held=False)
    say("the model as built")
    content = refitted is not None and refitted.healthy
    built = side(body, base, symptoms, base.as_stated, biases, held=True, content=content)
    best = refitted or built
    say("free runs")
    runs = {horizon: free_run(horizon, built.plain, best.explained) for horizon in HORIZONS}
    return Comparison(
        platform,
        recording,
        conventions,
        noise,
        body,
        base,
        built,
        refitted,
        runs,
        balance(best.explained),
    )


def _along(body: Body, base: BaseParameters) -> Body:
    """The log along a motion in which rings what is stated to."""
    problem = Problem([body], base)
    found = fit(problem, problem.start(base.as_stated, [first_biases(body)]))
    return along_what_rings(problem, found)[0].bodies[0]


def prepare(
    recording: Recording, platform: Platform
) -> tuple[Body, BaseParameters, BaseParameters]:
    """A recording's predictor; its base, and with what its joints take of the motion."""
    machine = predicted_machine(platform)
    body = body_of(machine, recording, motion_of(recording, platform))
    plain, base = base_of(machine, [recording])
    return _along(body, base) if rings(machine) else body, plain, base


def name_of(comparison: Comparison) -> str:
    """The log's own name."""
    return log_name(comparison.recording)


def log_name(recording: Recording) -> str:
    """A log's own name: that of its folder or file."""
    return recording.source.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]
