"""The experiment that would tell tied causes apart best, of a small library that a lab can fly.

Each is simulated on the machine as the logs have it, its causes at their sizes. What its log would
add is known before any noise is drawn: the evidence by which the tied cause, at its best strengths
and beside a free base, falls behind the named one in the old logs and the new one together. A
repetition of the old logs is judged alike, so an experiment is worth what it has beyond that.
"""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.diagnosis.candidates import Candidate, candidate
from twin.diagnosis.cause import Cause
from twin.diagnosis.explanation import Explanation
from twin.diagnosis.screen import TIED, LinearScreen, Search, Trace
from twin.effects import able, with_effects
from twin.errors import ControllerError, TwinError
from twin.estimators import load_estimator, usual_estimator
from twin.flight import Flight
from twin.identification.start import first_biases
from twin.library import library
from twin.loop import Ended
from twin.metrics import Metrics
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Sensor, load_platform, variants_of
from twin.predict.body import Body, body_of
from twin.predict.columns import perturbations_of, strengths_of
from twin.predict.forces import predicted_machine
from twin.predict.innovations import Innovations, Problem
from twin.predict.kalman import EXACT
from twin.predict.logs import motion_of
from twin.recording import Recording
from twin.reference import Reference, parse_reference
from twin.rotation import from_euler_zyx
from twin.stream.recorder import MemoryRecorder

Angles = tuple[float, float, float]
TRACKERS = ("quaternion_pd", "cmg_pd")
"""Laws that follow any reference, the first that the machine can take."""
BALANCERS = ("mass_magnetic_pid", "mass_pid")
"""Laws that bring a machine without those back to level."""
MOTIONS = ("multisine:5", "multisine:15", "slew:10,-10,120@5")
"""What a tracker is to follow."""
TILTED: Angles = (5.0, 3.0, 0.0)
"""Where a table floats free from [deg]."""
SPINNING: Angles = (0.0, 0.0, 5.0)
"""And how fast it turns there [deg/s]."""
SWINGS = (30.0, 100.0)
"""Where a pendulum swings free from [deg]."""
NEAR = 0.95
"""Share of the way to its stop that a run may use."""
TO_FILE = "next.rrd"
Array = NDArray[np.float64]
Say = Callable[[str], None]
Ties = Mapping[str, Sequence[str]]
"""Labels of the causes that could stand in a named one's place, by its label."""
LONGEST = 60.0
"""Of the runs that are simulated [s]."""


@dataclass(frozen=True)
class SimulatedRun:
    """One run of `twin run`."""

    platform: Platform
    """The machine as its files state it, or a variant that differs in its field."""
    controller: str
    duration: float
    """[s]."""
    reference: str = "hold"
    attitude: Angles = (0.0, 0.0, 0.0)
    """At the start [deg]."""
    rate: Angles = (0.0, 0.0, 0.0)
    """Likewise [deg/s]."""
    motion: Reference | None = None
    """Followed in place of `reference`, which is then the file that holds it."""

    @property
    def command(self) -> str:
        """The line that flies it."""
        words = ["twin", "run", _name(self.platform), "--controller", self.controller]
        if self.controller != "free_float":
            words += ["--reference", self.reference]
        for key, angles in (("--attitude", self.attitude), ("--rate", self.rate)):
            if any(angles):
                words += [key, *(f"{angle:g}" for angle in angles)]
        words += ["--duration", f"{self.duration:g}", "--plant", "sim", "--rrd", TO_FILE]
        return shlex.join(words)

    @property
    def words(self) -> str:
        """Its name for people: `quaternion_pd following multisine:5`."""
        if self.controller == "free_float":
            return f"{_name(self.platform)} floating free"
        return f"{self.controller} following {self.reference}"

    def flown(self, machine: Platform, *, seed: int = 0) -> Recording | None:
        """What a machine like `platform` would record; None where it hits a stop or its limits.

        Raises:
            TwinError: the machine cannot fly it.
        """
        log, obstacle = self.attempt(machine, seed=seed)
        return None if obstacle else log.without_truth()

    def attempt(self, machine: Platform, *, seed: int = 0) -> tuple[Recording, str]:
        """The recording with its truth, and which limit the flight meets; empty where none.

        Raises:
            TwinError: the machine cannot fly it.
        """
        law = load_controller(self.controller)
        roll, pitch, yaw = np.radians(self.attitude)
        rate = np.radians(self.rate)
        initial = InitialState(
            attitude=from_euler_zyx(yaw, pitch, roll),
            rate_body=rate,
            joint_angle=float(roll),
            joint_rate=float(rate[0]),
        )
        memory, metrics = MemoryRecorder(machine), Metrics(machine)
        with SimulatedPlant(machine, seed=seed, initial=initial) as plant:
            flight = Flight(
                plant,
                load_estimator(usual_estimator(machine)),
                law,
                self.motion or parse_reference(self.reference),
                self.duration,
                initial,
            )
            outcome = flight.fly(SimulatedClock(), [memory, metrics])
        result, log = metrics.rows(), memory.recording()
        if outcome.ended is not Ended.done:
            return log, outcome.reason or f"the flight {outcome.ended.value}"
        if np.any(np.isfinite(result.get("wheel_saturated_at_s", np.nan))):
            return log, "a wheel saturates"
        if "truth_attitude" in log and machine.base.kind != "hinge":
            lean = float(machine.lean(log["truth_attitude"].value).max())
            if lean > NEAR * machine.stop_angle:
                return log, f"it leans to {np.degrees(lean):.1f} deg, close to its stop"
        return log, ""


def excitations(platform: Platform, duration: float) -> list[SimulatedRun]:
    """The library for a machine; empty where nothing excites it."""
    if platform.base.kind == "free" or platform.base.falls:
        return []
    if platform.base.kind == "hinge":
        swings = [(angle, 0.0, 0.0) for angle in SWINGS]
        return [SimulatedRun(platform, "free_float", duration, attitude=swing) for swing in swings]
    runs: list[SimulatedRun] = []
    tracker = _first_able(TRACKERS, platform)
    balancer = _first_able(BALANCERS, platform)
    if tracker:
        runs += [SimulatedRun(platform, tracker, duration, motion) for motion in MOTIONS]
    elif balancer:
        runs.append(SimulatedRun(platform, balancer, duration, attitude=TILTED))
    free = SimulatedRun(platform, "free_float", duration, attitude=TILTED, rate=SPINNING)
    runs.append(free)
    runs += [replace(free, platform=other) for other in _other_fields(platform)]
    return runs


def _first_able(laws: tuple[str, ...], platform: Platform) -> str:
    """The first law that drives a machine; empty where none does."""
    for name in laws:
        try:
            load_controller(name).init(platform, 1)
        except ControllerError:
            continue
        return name
    return ""


def _other_fields(platform: Platform) -> list[Platform]:
    """Variants of a machine in another magnetic field, its mass properties the same."""
    others = [load_platform(f"{platform.folder}:{name}") for name in variants_of(platform.folder)]
    return [
        other
        for other in others
        if not np.array_equal(other.magnetic_field, platform.magnetic_field)
        and np.array_equal(other.inertia, platform.inertia)
        and np.array_equal(other.center_of_mass_offset, platform.center_of_mass_offset)
    ]


def _name(platform: Platform) -> str:
    """A machine as a command line names it."""
    if platform.folder.resolve() == (library("models") / platform.folder.name).resolve():
        stem = platform.folder.name
    else:
        stem = str(platform.folder)
    _, _, variant = platform.name.partition(":")
    return f"{stem}:{variant}" if variant else stem


@dataclass(frozen=True)
class Experiment:
    """The best of those that were simulated."""

    command: str
    """The line that flies it, simulated."""
    duration: float
    """[s]."""
    named: tuple[str, ...]
    """Labels of the causes that have ties."""
    splits: Mapping[str, float]
    """Evidence by which a tied cause is expected to be behind then, by its label."""
    repeated: Mapping[str, float]
    """The same, had the logs been made once more instead."""
    needed: float = TIED
    """Evidence that would do."""

    @property
    def split(self) -> float:
        """Of the cause that stays nearest."""
        return min(self.splits.values())

    @property
    def enough(self) -> bool:
        """Whether it splits every tie."""
        return self.split >= self.needed


@dataclass(frozen=True)
class ExperimentSensitivity:
    """What a log's whitened innovations depend on."""

    base: Array
    """(m, p) shared by all logs."""
    own: Array
    """(m, b) of this log alone."""
    causes: Array
    """(m, k) those named first, then those that are tied with them; shared."""


def next_experiment(
    platform: Platform,
    explanation: Explanation,
    causes: Sequence[Cause],
    candidates: Sequence[Candidate],
    say: Say,
) -> Experiment | None:
    """The experiment that splits the ties best, by the cause that stays nearest.

    Args:
        platform: the machine as stated.
        now: what explains the logs.
        causes: of it, with their ties.
        candidates: what stands for a tied cause.
        say: told what is being simulated.

    Returns:
        None without ties, or where nothing can be foretold: no model follows the logs, laws without
        a name take part, or nothing excites the machine.
    """
    # what only scatters has no column, and no ties
    own = {effect.label for effect in explanation.effects}
    named = [cause for cause in causes if cause.effect.label in own]
    ties = {cause.effect.label: [tie.label for tie in cause.ties] for cause in named}
    tied = {label for labels in ties.values() for label in labels}
    if not tied or explanation.laws or not explanation.follows:
        return None
    rivals = [item for item in candidates if item.label in tied]
    traces = [*explanation.traces, *(rival.trace for rival in rivals)]
    log = sensitivity(explanation, rivals)
    length = max(body.recording.stop - body.recording.start for body in explanation.bodies)
    best: tuple[SimulatedRun, Mapping[str, float]] | None = None
    for excitation in excitations(platform, float(np.floor(min(length, LONGEST)))):
        say(f"the next experiment: {excitation.words}")
        try:
            more = _foretold(excitation, explanation, rivals)
        except TwinError:
            continue
        if more is None:
            continue
        splits = behind([log, more], explanation.amplitudes, traces, ties)
        if best is None or min(splits.values()) > min(best[1].values()):
            best = excitation, splits
    if best is None:
        return None
    repeated = behind([log, log], explanation.amplitudes, traces, ties)
    unsure = tuple(label for label, rivals in ties.items() if rivals)
    return Experiment(best[0].command, best[0].duration, unsure, best[1], repeated)


def behind(
    logs: Sequence[ExperimentSensitivity], strengths: Array, traces: Sequence[Trace], ties: Ties
) -> dict[str, float]:
    """Evidence by which logs together, free of noise, would leave each tied cause behind.

    Args:
        logs: of them.
        strengths: (a,) of the named causes, whose columns come first.
        traces: of all causes, the named ones first.
        ties: which could stand in whose place; a cause that could in two, counts where it is
            nearest.
    """
    causes = np.concatenate([log.causes for log in logs])
    residual = -causes[:, : len(strengths)] @ strengths
    search = Search(LinearScreen(residual, _base(logs), causes, traces), range(len(traces)))
    labels = [trace.label for trace in traces]
    own = tuple(labels.index(label) for label in ties)
    result: dict[str, float] = {}
    for index, rivals in zip(own, ties.values(), strict=True):
        rest = tuple(other for other in own if other != index)
        # of a rival that no log shows, all that the cause explains is left
        nearest = dict.fromkeys(rivals, search.evidence(own) - search.evidence(rest))
        for other, evidence in search.instead(own, index):
            if labels[other] in nearest:
                near = min(evidence, nearest[labels[other]])
                nearest[labels[other]] = max(near, 0.0)
        for label, size in nearest.items():
            result[label] = min(size, result.get(label, np.inf))
    return result


def _base(logs: Sequence[ExperimentSensitivity]) -> Array:
    """What is free in every log, the shared part first, then each log's own."""
    shared = np.concatenate([log.base for log in logs])
    parts = [shared]
    first = 0
    for log in logs:
        own = np.zeros((len(shared), log.own.shape[1]))
        own[first : first + len(log.own)] = log.own
        parts.append(own)
        first += len(log.own)
    return np.hstack(parts)


def sensitivity(explanation: Explanation, rivals: Sequence[Candidate]) -> ExperimentSensitivity:
    """Of an explanation's logs, to its own causes and to rivals, in as few rows as tell it."""
    parts = [part for rival in rivals for part in rival.perturbations]
    columns = explanation.rows_with(parts).columns
    small = np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)
    p, causes = len(explanation.at.theta), len(explanation.amplitudes) + len(parts)
    edge = columns.shape[1] - causes
    return ExperimentSensitivity(small[:, :p], small[:, p:edge], small[:, edge:])


def _foretold(
    excitation: SimulatedRun, explanation: Explanation, rivals: Sequence[Candidate]
) -> ExperimentSensitivity | None:
    """What an experiment's log would depend on; None where the machine hits its limits in it, or
    is one that cannot have all of the causes.

    Raises:
        TwinError: no such machine, or its log cannot be predicted.
    """
    platform = excitation.platform
    log = excitation.flown(_as_found(platform, explanation))
    if log is None:
        return None
    body_log = _as_logged(log, explanation.bodies)
    body = body_of(predicted_machine(platform), body_log, motion_of(body_log, platform))
    parts = [
        part
        for effect, free in zip(explanation.effects, explanation.free, strict=True)
        for part, item in zip(perturbations_of(effect, platform), free.tolist(), strict=True)
        if item
    ]
    size = [
        strengths_of(effect)[free]
        for effect, free in zip(explanation.effects, explanation.free, strict=True)
    ]
    problem = Problem([body], explanation.base, parts)
    start = problem.start(explanation.at.theta, [first_biases(body)], np.concatenate(size))
    noise = (
        explanation.prediction.noise if isinstance(explanation.prediction, Innovations) else EXACT
    )
    there = replace(
        explanation, bodies=(body,), problem=problem, prediction=problem.innovations(start, noise)
    )
    same = [candidate(rival.effect, platform) for rival in rivals]
    if [len(item.perturbations) for item in same] != [len(rival.perturbations) for rival in rivals]:
        return None
    return sensitivity(there, same)


def _as_found(platform: Platform, explanation: Explanation) -> Platform:
    """A machine with base, causes and noise as the logs have them."""
    xx, yy, zz, xy, xz, yz, *offset = explanation.base.entries(explanation.at.theta).tolist()
    result = replace(
        platform,
        inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        center_of_mass_offset=np.array(offset),
        sensors={
            name: _as_measured(sensor, explanation.bodies, 1.0 / platform.step)
            for name, sensor in platform.sensors.items()
        },
    )
    for effect in explanation.effects:
        result = able(result, effect)
    return with_effects(result, explanation.effects)


def _as_measured(sensor: Sensor, bodies: Sequence[Body], fastest: float) -> Sensor:
    """A sensor with the noise and rate that the logs have; of a log with more samples than physics
    steps [Hz], one a step that is as good."""
    for body in bodies:
        for output in body.outputs:
            rate = body.recording[output.stream].rate
            if output.stream == sensor.stream and rate > 0.0:
                shown = min(rate, fastest)
                return replace(sensor, noise=output.noise * np.sqrt(shown / rate), rate=shown)
    return sensor


def _as_logged(recording: Recording, bodies: Sequence[Body]) -> Recording:
    """Only what the logs hold too: a lab measures what it measured."""
    held = {name for body in bodies for name in body.recording}
    streams = {name: series for name, series in recording.streams.items() if name in held}
    return replace(recording, streams=streams)
