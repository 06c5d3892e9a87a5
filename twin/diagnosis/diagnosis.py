"""Diagnosis: what a platform's model gets wrong about logs, the causes, their evidence and gain."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.comparison.explanation import HORIZONS, FreeRun, free_run
from twin.conventions import ConventionFinding
from twin.diagnosis.baseline import baseline_of, check_logs, check_seen, read_rightly
from twin.diagnosis.candidates import Candidate, Candidates, candidates_of
from twin.diagnosis.cause import (
    Cause,
    Equation,
    Tried,
    causes_of,
    equation_of,
    late_rate,
    scatter_causes,
    tried_of,
)
from twin.diagnosis.engine import Engine, SearchState, likeliest
from twin.diagnosis.experiment import Experiment, next_experiment
from twin.diagnosis.explanation import CROWD, Explanation
from twin.diagnosis.pushes import PushInterval, but_for, pushed, pushed_look, pushes_of
from twin.diagnosis.residual_test import HeldOut, ResidualTest, held_out, residual_test
from twin.effects import Effect, with_effects
from twin.errors import UsageError
from twin.noise import NoiseFinding, noise_findings
from twin.platform import Platform, in_gravity_of
from twin.predict.kalman import EXACT, NoiseProcess
from twin.predict.logs import usable
from twin.predict.rollouts import BeyondBounds
from twin.recording import Recording
from twin.recording.pauses import pieces_of
from twin.shown import Shown

DRAUGHT = 3e-4
"""Largest rms torque of a room's draughts on a platform [N m]: 1 mN at 0.3 m."""
STRAYING = {
    "attitude": 0.01,
    "joint_angle": 0.01,
    "inclinometer": 0.01,
    "heading": 0.01,
    "heading_rate": 1e-3,
    "position": 1e-3,
    "velocity": 1e-3,
    "gyro": 1e-3,
    "joint_rate": 1e-3,
    "accelerometer": 0.05,
    "magnetometer": 1e-6,
}
"""Largest rms of the slow error of a calibrated sensor (SI): a vertical reference of half a degree,
a gyro bias of 200 deg/h, an accelerometer bias of 5 mg."""
Say = Callable[[str], None]
UNEXPLAINED = 1e-4
"""Probability of a residual below which it is not noise."""
IN_PART = 0.5
"""Share of the baseline's misfit that causes must explain for *explained in part*, where noise
processes are larger than rooms and sensors have."""
ROUGH = 1.5
"""Chi-square a sample above which the logs are predicted in independent segments: no set of causes
makes the motion follow the model."""
LOST = 30.0
"""Chi-square a sample of the baseline above which independent segments come first."""
STRAYS = 2.0
"""Half widths of the 95 % band of a true model's chi-square beyond which held-out time is
missed."""


def ordinary(noise: NoiseProcess) -> bool:
    """Whether all noise processes are within what such rooms and sensors have."""
    torque = 0.0 if noise.torque is None else noise.torque.rms
    return torque <= DRAUGHT and all(
        item.rms <= STRAYING.get(stream, np.inf) for stream, item in noise.errors
    )


def carried(baseline: Explanation, explanation: Explanation) -> float:
    """Share of the baseline's misfit that the causes explain.

    The misfit is the excess of the squared residual over noise. In a continuous motion, noise
    processes take the rest of it. Of independent segments the error of a typical free run counts
    too, and the larger share is taken: hands that push in a few segments dominate the squares, and
    a controller that holds a machine upright hides from free runs what it works against.
    """
    if not (baseline.follows and explanation.follows):
        run = free_run(HORIZONS[0], baseline.account, explanation.account)
        in_runs = 0.0 if run is None else _share(*run.along)
        return max(in_runs, _share(_excess(baseline), _excess(explanation)))
    with_causes = explanation.problem.whiten(explanation.at, explanation.prediction.exact, EXACT)
    left = with_causes.residual + with_causes.columns @ with_causes.step()
    excess = float(np.sum(np.square(baseline.prediction.residual))) - baseline.samples
    return _share(max(excess, 1.0), float(left @ left) - explanation.samples)


def _share(before: float, after: float) -> float:
    """Share of a misfit that is gone."""
    return float(np.clip(1.0 - after / max(before, 1e-9), 0.0, 1.0))


def _excess(explanation: Explanation) -> float:
    """Squared residual of its samples beyond that of noise, in units of the noise."""
    of_samples = explanation.prediction.cluster >= 0
    squares = float(np.sum(np.square(explanation.prediction.residual[of_samples])))
    return squares - explanation.samples


@dataclass(frozen=True)
class Diagnosis(Shown):
    """A platform's model held against logs."""

    platform: Platform
    recordings: tuple[Recording, ...]
    """With the corrections of `conventions`."""
    conventions: tuple[ConventionFinding, ...]
    noise: tuple[NoiseFinding, ...]
    baseline: Explanation
    """The model without causes."""
    explained: Explanation
    """The model with all causes."""
    causes: tuple[Cause, ...]
    tried: tuple[Tried, ...]
    """By falling evidence."""
    asked: tuple[Candidate, ...]
    """The candidates, at their usual shapes."""
    not_asked: Mapping[str, str]
    """Why an effect is no candidate, or has no estimate, by label."""
    equation: Equation | None
    residual_test: ResidualTest
    held_out: HeldOut
    free_runs: Mapping[float, FreeRun | None]
    """By horizon [s]; None where the logs are too short."""
    next_experiment: Experiment | None
    """The run that would separate tied causes best; None without ties or a prediction."""
    pushes: tuple[PushInterval, ...] = ()
    """Disturbances from outside, whose time is excluded from all else."""

    @property
    def intervals_hold(self) -> bool:
        """Whether the intervals of causes and base are 95 % intervals: not where the residual
        contains something that no cause explains."""
        return not _unexplained(self.baseline, self.explained, self.residual_test, self.held_out)

    @property
    def wander(self) -> NoiseProcess:
        """Noise processes, fitted together with the causes."""
        return self.explained.noise

    @cached_property
    def carried(self) -> float:
        """Share of the baseline's misfit that the causes explain (`carried`)."""
        return carried(self.baseline, self.explained)

    @property
    def _mostly(self) -> bool:
        """Whether, on a floor, a few causes of the catalogue explain most of the baseline's misfit
        and improve the prediction of held-out time, beside disturbances that wander: of a machine
        that nothing holds these are large, and rarely quite such processes."""
        few = bool(self.causes) and not self.explained.laws and not crowded(self.explained.effects)
        glides = self.explained.base.machine.platform.base.kind == "planar"
        lasting = glides and few and not ordinary(self.wander)
        return lasting and self.carried > IN_PART and self.held_out.log_likelihood > 0.0

    @property
    def verdict(self) -> str:
        """healthy, explained, explained in part, ambiguous or unexplained."""
        if not self.explained.follows:
            in_part = _in_part(self.baseline, self.explained) and self.held_out.log_likelihood > 0.0
            return "explained in part" if in_part and not self.pushes else "unexplained"
        if not (self.pushes or self.intervals_hold) and self._mostly:
            return "explained in part"
        if self.pushes or not self.intervals_hold:
            return "unexplained"
        if not ordinary(self.wander):
            in_part = self.causes and self.carried > IN_PART
            return "explained in part" if in_part else "unexplained"
        if not self.causes:
            return "healthy"
        return "ambiguous" if any(cause.ties for cause in self.causes) else "explained"


def diagnose(
    recordings: Sequence[Recording],
    platform: Platform,
    *,
    own: Sequence[type[Effect]] = (),
    say: Say = lambda _: None,
) -> Diagnosis:
    """Find the causes of what a platform's model gets wrong about logs.

    Args:
        recordings: at least one; the true states of a simulation are not used.
        platform: the machine, as stated.
        own: kinds of effects that are candidates beside those of the catalogue.
        say: receives the name of each step.

    Raises:
        UsageError: no logs, one without the streams that the prediction needs, or too little in
            them for a verdict.
    """
    if not recordings:
        raise UsageError("no log is given")
    platform = in_gravity_of(recordings, platform)
    check_logs(recordings, platform)
    say("conventions and noise")
    used = [usable(recording, platform) for recording in recordings]
    pieces = [piece for recording in used for piece in pieces_of(recording)]
    read = [read_rightly(piece, platform) for piece in pieces]
    logs = [log for log, _ in read]
    noise = tuple(finding for log in logs for finding in noise_findings(log, platform))
    say("the base")
    findings = tuple(finding for _, result in read for finding in result)
    try:
        baseline = baseline_of(logs, platform)
        late = late_rate(logs) if residual_test(baseline).chi2 > LOST else None
        if late is not None:
            baseline = baseline_of(logs, with_effects(platform, (late.effect,)))
        reasoned, pushes = _explained(baseline, logs, own, say)
    except BeyondBounds as problem:
        doubts = [finding.sentence for finding in findings if finding.ambiguous]
        sign = "look at the signs and units of its commands, or compare it: twin compare LOG"
        raise UsageError(
            f"{', '.join(log.source for log in logs)}: {problem}, whatever its base is: "
            f"{' '.join(doubts) or sign}"
        ) from None
    baseline, candidates, state = reasoned.baseline, reasoned.candidates, reasoned.state
    explanation = state.explanation
    causes = (
        *([] if late is None else [late]),
        *causes_of(explanation, state.search, state.others, unexplained=reasoned.unexplained),
        *scatter_causes(explanation, unexplained=reasoned.unexplained),
    )
    experiment = next_experiment(platform, explanation, causes, state.candidates, say)
    tried = tried_of(state.search, explanation.own, state.candidates)
    say("free runs")
    diagnosis = Diagnosis(
        platform,
        tuple(logs),
        findings,
        noise,
        baseline,
        explanation,
        causes,
        tried,
        candidates.asked,
        {**_unasked(candidates, causes), **_silent(candidates, state, causes, tried)},
        equation_of(explanation, state.nameless),
        state.residual_test,
        reasoned.held,
        {horizon: free_run(horizon, baseline.account, explanation.account) for horizon in HORIZONS},
        experiment,
        pushes,
    )
    if diagnosis.verdict == "healthy":
        check_seen(baseline)
    return diagnosis


@dataclass(frozen=True)
class _Reasoned:
    """The result of a search."""

    baseline: Explanation
    candidates: Candidates
    state: SearchState
    held: HeldOut

    @property
    def unexplained(self) -> bool:
        return _unexplained(
            self.baseline, self.state.explanation, self.state.residual_test, self.held
        )


def _reasoned(
    baseline: Explanation, logs: Sequence[Recording], own: Sequence[type[Effect]], say: Say
) -> _Reasoned:
    candidates = candidates_of(baseline.bodies, own)
    engine = Engine(candidates.asked, say)
    # columns along a motion that is far from the logs mean little
    lost = baseline.follows and residual_test(baseline).chi2 > LOST
    start, strays = baseline, False
    if lost and baseline.base.machine.platform.base.kind == "planar":
        # nothing holds a machine on a floor where it is: the least force leads it away, and
        # disturbances that wander bring the motion back to the logs
        start = baseline.wandering()
        strays = residual_test(start).chi2 < ROUGH
    state = None if lost and not strays else engine.explained(start)
    rough = state is None or state.residual_test.chi2 > ROUGH
    if state is None or rough or not (ordinary(state.explanation.noise) or strays):
        say("the base, by segments")
        machine = baseline.base.machine.platform
        segments = baseline_of(logs, machine, follows=False, base=baseline.base)
        by_segments = engine.explained(segments)
        whole = engine.onward(baseline, by_segments)
        in_part = _in_part(segments, by_segments.explanation)
        if (
            whole is not None
            and whole.residual_test.chance > UNEXPLAINED
            and ordinary(whole.explanation.noise)
        ):
            state = whole
        elif (by_segments.explanation.effects and not by_segments.residual_test.doubtful) or (
            # neither the baseline nor these causes follow the whole logs
            state is None and whole is None and in_part
        ):
            baseline, state = segments, by_segments
        else:
            state = state or engine.explained(baseline)
            lasting = not ordinary(state.explanation.noise) and in_part
            if state.residual_test.chi2 > ROUGH or lasting:
                baseline, state = segments, by_segments
    return _Reasoned(baseline, candidates, state, held_out(state.explanation))


def _explained(
    baseline: Explanation, logs: Sequence[Recording], own: Sequence[type[Effect]], say: Say
) -> tuple[_Reasoned, tuple[PushInterval, ...]]:
    """Search over whole logs, or over logs without the time of disturbances from outside.

    Disturbances are excluded where nothing explains the whole logs and something explains the rest.
    Where the rest follows the baseline, the whole logs are not searched.
    """
    machine = baseline.base.machine.platform
    pushes = () if _is_noise(baseline) else _pushes(logs, machine, own, say)
    if not pushes:
        return _reasoned(baseline, logs, own, say), ()
    rest = but_for(pushes, logs)
    bare = baseline_of(rest, machine)
    whole = None if _is_noise(bare) else _reasoned(baseline, logs, own, say)
    if whole is not None and not whole.unexplained:
        return whole, ()
    result = _reasoned(bare, rest, own, say)
    if not result.unexplained:
        return result, pushes
    return whole or _reasoned(baseline, logs, own, say), ()


def _in_part(baseline: Explanation, explanation: Explanation) -> bool:
    """Whether a few causes explain most of the baseline's misfit."""
    few = bool(explanation.effects) and not explanation.laws and not crowded(explanation.effects)
    return few and carried(baseline, explanation) > IN_PART


def _is_noise(baseline: Explanation) -> bool:
    return baseline.follows and residual_test(baseline).chance > UNEXPLAINED


def _pushes(
    logs: Sequence[Recording], platform: Platform, own: Sequence[type[Effect]], say: Say
) -> tuple[PushInterval, ...]:
    """Disturbances without which logs follow the model, and that none of the likeliest causes
    explains."""
    say("pushes from outside")
    pushes = pushes_of(logs, platform)
    if not pushes or not but_for(pushes, logs):
        return ()
    segments = pushed_look(logs, platform)
    if segments is None:
        return pushes
    causes = likeliest(segments, candidates_of(segments.bodies, own).asked)
    return () if any(not pushed(cause) for cause in causes) else pushes


def _unexplained(
    baseline: Explanation, explanation: Explanation, left: ResidualTest, held: HeldOut
) -> bool:
    """Whether the logs contain something that no cause of the catalogue explains."""
    if (
        explanation.laws
        or left.chance < UNEXPLAINED
        or not (explanation.follows or _in_part(baseline, explanation))
    ):
        return True
    return (
        crowded(explanation.effects) or foretells_nothing(explanation.effects, held) or strays(held)
    )


def foretells_nothing(effects: Sequence[Effect], held: HeldOut) -> bool:
    """Whether causes do not improve the prediction of held-out time.

    Causes that only the stated base distinguishes from a change of the base need not: a constant
    error is a log's own, and another base gives the same motion.
    """
    lasting = any(not effect.exact for effect in effects)
    return lasting and held.log_likelihood <= 0.0


def strays(held: HeldOut) -> bool:
    """Whether the error on held-out time is larger than that of a true model."""
    return held.after > 1.0 + STRAYS * (held.high - 1.0)


def crowded(effects: Sequence[Effect]) -> bool:
    """Whether there are so many kinds of causes that one unnamed cause is likelier."""
    return len({effect.name for effect in effects}) > CROWD


def _unasked(candidates: Candidates, causes: Sequence[Cause]) -> dict[str, str]:
    """Why effects are no candidates, by label; not of those that the scatter of a sensor shows."""
    result = {cause.effect.label for cause in causes}
    return {label: why for label, why in candidates.not_asked.items() if label not in result}


def _silent(
    candidates: Candidates, state: SearchState, causes: Sequence[Cause], tried: Sequence[Tried]
) -> dict[str, str]:
    """Why candidates are neither among the causes nor among those tried, by label."""
    reported = {cause.effect.label for cause in causes} | {item.label for item in tried}
    screen = state.search.screen
    felt: dict[str, bool] = {}
    for index, trace in enumerate(screen.traces):
        felt[trace.label] = felt.get(trace.label, False) or screen.observable(index)
    why = {
        True: "not observable: a change of the base does the same",
        False: "not observable: what it acts on does not move in these logs",
        None: "not possible in the size that these logs ask for",
    }
    winds = (
        "nothing is left that repeats with the angle"
        if state.explanation.follows
        else "not asked: segments of their own see too little of a turn"
    )
    silent = {item.label: item.effect for item in candidates.asked if item.label not in reported}
    return {
        label: winds if effect.winds else why[felt.get(label)] for label, effect in silent.items()
    }
