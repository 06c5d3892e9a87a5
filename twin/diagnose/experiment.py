"""The experiment that would tell tied causes apart best, of a few that a lab can fly.

Each is simulated on the machine as the logs have it, its causes at their sizes. What its log would
add is known before any noise is drawn: the evidence by which the tied cause, at its best strengths
and beside a free base, falls behind the named one in the old logs and the new one together. A
repetition of the old logs is judged alike, so an experiment is worth what it has beyond that.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.candidates import Candidate, candidate
from twin.diagnose.cause import Cause
from twin.diagnose.excitation import Excitation, excitations
from twin.diagnose.explanation import Explanation
from twin.diagnose.search import TIED, Search
from twin.diagnose.weighing import Trace, Weighing
from twin.effects import able, with_effects
from twin.errors import TwinError
from twin.identify.start import first_biases
from twin.platform import Platform, Sensor
from twin.predict.body import Body, body_of
from twin.predict.effects.columns import perturbations_of, strengths_of
from twin.predict.effects.machine import predicted_machine
from twin.predict.log.motion import motion_of
from twin.predict.whitening.innovations import Innovations, Problem
from twin.predict.whitening.noise import EXACT
from twin.recording import Recording

Array = NDArray[np.float64]
Say = Callable[[str], None]
Ties = Mapping[str, Sequence[str]]
"""Labels of the causes that could stand in a named one's place, by its label."""

LONGEST = 60.0
"""Of the runs that are simulated [s]."""


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
class Sensitivity:
    """What a log's whitened innovations depend on."""

    base: Array
    """(m, p) shared by all logs."""
    own: Array
    """(m, b) of this log alone."""
    causes: Array
    """(m, k) those named first, then those that are tied with them; shared."""


def next_experiment(
    platform: Platform,
    now: Explanation,
    causes: Sequence[Cause],
    asked: Sequence[Candidate],
    say: Say,
) -> Experiment | None:
    """The experiment that splits the ties best, by the cause that stays nearest.

    Args:
        platform: the machine as stated.
        now: what explains the logs.
        causes: of it, with their ties.
        asked: what stands for a tied cause.
        say: told what is being simulated.

    Returns:
        None without ties, or where nothing can be foretold: no model follows the logs, laws without
        a name take part, or nothing excites the machine.
    """
    # what only scatters has no column, and no ties
    own = {effect.label for effect in now.effects}
    named = [cause for cause in causes if cause.effect.label in own]
    ties = {cause.effect.label: [tie.label for tie in cause.ties] for cause in named}
    tied = {label for labels in ties.values() for label in labels}
    if not tied or now.laws or not now.follows:
        return None
    rivals = [one for one in asked if one.label in tied]
    traces = [*now.traces, *(one.trace for one in rivals)]
    log = sensitivity(now, rivals)
    length = max(body.recording.stop - body.recording.start for body in now.bodies)
    best: tuple[Excitation, Mapping[str, float]] | None = None
    for excitation in excitations(platform, float(np.floor(min(length, LONGEST)))):
        say(f"the next experiment: {excitation.words}")
        try:
            more = _foretold(excitation, now, rivals)
        except TwinError:
            continue
        if more is None:
            continue
        splits = behind([log, more], now.amplitudes, traces, ties)
        if best is None or min(splits.values()) > min(best[1].values()):
            best = excitation, splits
    if best is None:
        return None
    repeated = behind([log, log], now.amplitudes, traces, ties)
    unsure = tuple(label for label, rivals in ties.items() if rivals)
    return Experiment(best[0].command, best[0].duration, unsure, best[1], repeated)


def behind(
    logs: Sequence[Sensitivity], strengths: Array, traces: Sequence[Trace], ties: Ties
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
    search = Search(Weighing(residual, _base(logs), causes, traces), range(len(traces)))
    labels = [trace.label for trace in traces]
    own = tuple(labels.index(label) for label in ties)
    found: dict[str, float] = {}
    for index, rivals in zip(own, ties.values(), strict=True):
        rest = tuple(other for other in own if other != index)
        # of a rival that no log shows, all that the cause explains is left
        nearest = dict.fromkeys(rivals, search.evidence(own) - search.evidence(rest))
        for other, evidence in search.instead(own, index):
            if labels[other] in nearest:
                near = min(evidence, nearest[labels[other]])
                nearest[labels[other]] = max(near, 0.0)
        for label, size in nearest.items():
            found[label] = min(size, found.get(label, np.inf))
    return found


def _base(logs: Sequence[Sensitivity]) -> Array:
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


def sensitivity(now: Explanation, rivals: Sequence[Candidate]) -> Sensitivity:
    """Of an explanation's logs, to its own causes and to rivals, in as few rows as tell it."""
    parts = [part for one in rivals for part in one.perturbations]
    columns = now.rows_with(parts).columns
    small = np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)
    p, causes = len(now.at.theta), len(now.amplitudes) + len(parts)
    edge = columns.shape[1] - causes
    return Sensitivity(small[:, :p], small[:, p:edge], small[:, edge:])


def _foretold(
    excitation: Excitation, now: Explanation, rivals: Sequence[Candidate]
) -> Sensitivity | None:
    """What an experiment's log would depend on; None where the machine hits its limits in it, or
    is one that cannot have all of the causes.

    Raises:
        TwinError: no such machine, or its log cannot be predicted.
    """
    platform = excitation.platform
    log = excitation.flown(_as_found(platform, now))
    if log is None:
        return None
    body_log = _as_logged(log, now.bodies)
    body = body_of(predicted_machine(platform), body_log, motion_of(body_log, platform))
    parts = [
        part
        for effect, free in zip(now.effects, now.free, strict=True)
        for part, one in zip(perturbations_of(effect, platform), free.tolist(), strict=True)
        if one
    ]
    size = [strengths_of(effect)[free] for effect, free in zip(now.effects, now.free, strict=True)]
    problem = Problem([body], now.base, parts)
    start = problem.start(now.at.theta, [first_biases(body)], np.concatenate(size))
    noise = now.now.noise if isinstance(now.now, Innovations) else EXACT
    there = replace(now, bodies=(body,), problem=problem, now=problem.innovations(start, noise))
    same = [candidate(one.effect, platform) for one in rivals]
    if [len(one.perturbations) for one in same] != [len(one.perturbations) for one in rivals]:
        return None
    return sensitivity(there, same)


def _as_found(platform: Platform, now: Explanation) -> Platform:
    """A machine with base, causes and noise as the logs have them."""
    xx, yy, zz, xy, xz, yz, *offset = now.base.entries(now.at.theta).tolist()
    found = replace(
        platform,
        inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        center_of_mass_offset=np.array(offset),
        sensors={name: _as_measured(s, now.bodies) for name, s in platform.sensors.items()},
    )
    for effect in now.effects:
        found = able(found, effect)
    return with_effects(found, now.effects)


def _as_measured(sensor: Sensor, bodies: Sequence[Body]) -> Sensor:
    """A sensor with the noise and rate that the logs have."""
    for body in bodies:
        for output in body.outputs:
            rate = body.recording[output.stream].rate
            if output.stream == sensor.stream and rate > 0.0:
                return replace(sensor, noise=output.noise, rate=rate)
    return sensor


def _as_logged(recording: Recording, bodies: Sequence[Body]) -> Recording:
    """Only what the logs hold too: a lab measures what it measured."""
    held = {name for body in bodies for name in body.recording}
    streams = {name: series for name, series in recording.streams.items() if name in held}
    return replace(recording, streams=streams)
