"""Isolability before a flight: sizes that a planned experiment detects, causes that it confuses.

The planned run is simulated on the machine as stated, with its sensors' noise and rates, and
recorded. The catalogue's columns of that recording, whitened and with the base (J, m r), the
sensors' constant errors and the initial states projected out, are those of a diagnosis
(`twin.diagnosis.screen`). In them a cause of size s gains s^2 times its Fisher information, and its
evidence is that gain less its price. So the size that reaches a given evidence, and the evidence by
which another cause in its place is behind, are known before anything is flown. Both are of the
linearised model, at noise-free measurements.

R. Isermann, Fault-Diagnosis Systems (2006), chapter 17, has isolability as the angle between
signatures; here the angle is taken in the metric of the noise, and each cause pays for its freedom.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import Candidate, candidates_of
from twin.diagnosis.experiment import TRACKERS, SimulatedRun, excitations
from twin.diagnosis.explanation import Explanation
from twin.diagnosis.screen import TIED, LinearScreen, Search
from twin.effects.effect import Parameter
from twin.errors import TwinError, UnknownName, UsageError
from twin.model import compile_model
from twin.platform import Platform, Sensor, in_gravity_of, load_platform
from twin.predict.logs import usable
from twin.recording import Recording
from twin.shown import Shown

Array = NDArray[np.float64]
Say = Callable[[str], None]
EVIDENCE = 60.0
"""Evidence at which a cause counts as detectable."""
DURATION = 60.0
"""Of an experiment unless stated [s]."""
USUAL_AMPLITUDE = 5.0
"""Of the multisine that is flown unless a reference is named [deg],"""
WITHIN = 0.5
"""or this share of the way to the machine's stop, where that is less."""
LARGEST = 1e6
"""Multiple of its usual size beyond which a cause counts as undetectable."""
NEIGHBOURS = 4
"""Rivals of a cause for which the size is sought that separates it from them."""
ADDED: Mapping[str, tuple[int, float, float]] = {
    "gyro": (3, 100.0, 1e-3),
    "attitude": (3, 50.0, 1e-3),
    "inclinometer": (2, 20.0, 2e-4),
    "accelerometer": (3, 100.0, 1e-2),
    "magnetometer": (3, 20.0, 1e-7),
}
"""Sensors that a lab may add: columns of the noise, rate [Hz] and noise, 1 sigma a sample (SI)."""
MEASURED = frozenset(
    ["gyro", "attitude", "inclinometer", "accelerometer", "magnetometer", "position"]
    + ["velocity", "heading", "heading_rate", "wheel_speed", "gimbal_angle"]
    + [
        "gimbal_rate",
        "stage_position",
        "joint_angle",
        "joint_rate",
        "magnetic_field",
        "gas_pressure",
    ]
)
"""Streams that `sensors` selects among; commands are always logged."""


@dataclass(frozen=True)
class CauseIsolation:
    """What an experiment shows of one cause."""

    label: str
    parameters: tuple[str, ...]
    """(k,) names of its amplitudes,"""
    units: tuple[str, ...]
    """and their units."""
    usual: Array
    """(k,) usual sizes."""
    detectable: float
    """Size of each amplitude, in usual sizes, at which all of them together have the evidence that
    counts as detected; inf where no size within the effect's bounds does."""
    each: Array
    """(k,) the same of each amplitude alone, in its unit."""
    separable: float
    """Size from which no other cause stays within a tie of it, in usual sizes; inf where none
    does."""
    ties: tuple[str, ...]
    """Causes that could stand in its place at the detectable size."""

    @property
    def size(self) -> Array:
        """(k,) detectable size of each amplitude, in its unit."""
        return self.detectable * self.usual


@dataclass(frozen=True)
class Alternative:
    """Another experiment, compared with the planned one."""

    words: str
    """What differs: a sensor that is added or left out, or another motion."""
    kind: str
    """`with` or `without` a sensor, or another `motion`."""
    detected: int
    """Causes that it detects within their bounds."""
    ties: int
    """Pairs that it ties, among the causes that the planned experiment detects."""
    ratio: float
    """Median ratio of the detectable sizes to those of the planned experiment."""
    separates: tuple[tuple[str, str], ...]
    """Pairs that the planned experiment ties and this one does not."""
    lost: tuple[str, ...]
    """Causes that the planned experiment detects and this one does not."""


@dataclass(frozen=True)
class Isolation(Shown):
    """Which causes a planned experiment detects and distinguishes."""

    run: SimulatedRun
    streams: tuple[str, ...]
    """Measured."""
    evidence: float
    """At which a cause counts as detectable."""
    causes: tuple[CauseIsolation, ...]
    """In the catalogue's order."""
    behind: Array
    """(n, n) evidence by which the cause of a column is behind that of a row, in its place, where
    that of the row is the truth at its detectable size; NaN where it is not detectable."""
    not_asked: Mapping[str, str]
    """Why another effect is no candidate, by label."""
    base: Mapping[str, tuple[float, str]]
    """Half widths of the 95 % intervals of J and m r, and their units."""
    alternatives: tuple[Alternative, ...]
    """By falling use: ties that they split, then the ratio of sizes."""

    @property
    def ties(self) -> tuple[tuple[str, str], ...]:
        """Pairs of causes that the experiment ties, either one being the truth."""
        return _pairs(self.causes)


def isolate(
    platform: str | Path | Platform,
    *,
    reference: str | None = None,
    controller: str | None = None,
    sensors: Sequence[str] | None = None,
    duration: float = DURATION,
    evidence: float = EVIDENCE,
    advise: bool = True,
    seed: int = 0,
    say: Say = lambda _: None,
) -> Isolation:
    """Which causes a planned experiment detects, and which of them it confuses.

    Args:
        platform: the machine.
        reference: what its law follows, as of `fly`; None: the machine's usual excitation.
        controller: the law; None: the first tracker that the machine can take.
        sensors: streams that are measured; None: all that the machine states.
        duration: [s].
        evidence: at which a cause counts as detectable.
        advise: compare other motions, and sensors added and left out.
        seed: of the sensors' noise.
        say: takes the name of each step.

    Raises:
        UnknownName: a stream that no sensor of the machine has.
        UsageError: nothing excites the machine, or a flight that meets a limit of it.
    """
    if not duration >= 1.0:
        raise UsageError(f"duration is {duration:g} s; give 1 or more")
    if not evidence > 0.0:
        raise UsageError(f"evidence is {evidence:g}; give a number above 0")
    machine = platform if isinstance(platform, Platform) else load_platform(str(platform))
    run = planned_run(machine, duration, reference=reference, controller=controller)
    streams = _selected(machine, sensors)
    say(f"fly {run.words}")
    log = _flown(run, machine, seed)
    say("weigh the catalogue")
    screen = _Screen.of(_with_streams(log, streams), machine)
    causes, behind = screen.causes(evidence)
    alternatives: list[Alternative] = []
    if advise:
        alternatives = _alternatives(run, machine, log, streams, causes, evidence, seed, say)
    return Isolation(
        run,
        streams,
        evidence,
        causes,
        behind,
        screen.not_asked,
        screen.base,
        tuple(alternatives),
    )


def planned_run(
    platform: Platform,
    duration: float,
    *,
    reference: str | None = None,
    controller: str | None = None,
) -> SimulatedRun:
    """The run that an experiment flies.

    Raises:
        UsageError: nothing excites the machine, or no law of it follows a reference.
    """
    if _glides(platform):
        run = SimulatedRun(platform, controller or "thruster_doublets", duration)
        return run if reference is None else replace(run, reference=reference)
    library = excitations(platform, duration)
    if not library:
        raise UsageError(
            f"{platform.name} has no bearing, and is thrown: no experiment can be planned for it"
        )
    run = library[0]
    if run.controller in TRACKERS:
        widest = min(USUAL_AMPLITUDE, WITHIN * float(np.degrees(platform.stop_angle)))
        run = replace(run, reference=f"multisine:{widest:.3g}")
    if controller is not None:
        run = replace(run, controller=controller)
    elif reference is not None and run.controller not in TRACKERS:
        raise UsageError(
            f"no shipped law makes {platform.name} follow a reference; leave --reference out: "
            f"its experiment is `{run.command}`, or name a law with --controller"
        )
    return run if reference is None else replace(run, reference=reference)


def _glides(platform: Platform) -> bool:
    """Whether a machine glides on a floor, its bearing locked."""
    return platform.base.joint in platform.base.locked


def _selected(platform: Platform, sensors: Sequence[str] | None) -> tuple[str, ...]:
    stated = tuple(name for name, sensor in platform.sensors.items() if sensor.stream in MEASURED)
    if sensors is None:
        return stated
    for name in sensors:
        if name not in stated:
            raise UnknownName(f"sensor of {platform.name}", name, stated)
    if not sensors:
        raise UsageError("no sensor is named; give some of " + ", ".join(stated))
    return tuple(sensors)


def _flown(run: SimulatedRun, platform: Platform, seed: int) -> Recording:
    log, obstacle = run.attempt(platform, seed=seed)
    if obstacle:
        raise UsageError(
            f"{run.words} for {run.duration:g} s meets a limit of {platform.name}: {obstacle}; "
            "take a smaller or shorter motion"
        )
    return log.without_truth()


def _with_streams(log: Recording, streams: Sequence[str]) -> Recording:
    """A log with some of the measured streams, and all commands."""
    held = {
        name: series
        for name, series in log.streams.items()
        if name in streams or name.startswith("command_")
    }
    return replace(log, streams=held)


@dataclass(frozen=True)
class _Screen:
    """Columns of the catalogue for one log."""

    candidates: tuple[Candidate, ...]
    screen: LinearScreen
    not_asked: Mapping[str, str]
    base: Mapping[str, tuple[float, str]]

    @classmethod
    def of(cls, log: Recording, platform: Platform) -> "_Screen":
        machine = in_gravity_of([log], platform)
        baseline = baseline_of([usable(log, machine)], machine)
        known = candidates_of(baseline.bodies)
        return cls(
            known.asked, baseline.screen(known.asked), known.not_asked, half_widths(baseline)
        )

    def causes(
        self, evidence: float, *, brief: bool = False
    ) -> tuple[tuple[CauseIsolation, ...], Array]:
        """Of each label, the shape that is detected worst; and the matrix.

        Args:
            evidence: at which a cause counts as detectable.
            brief: leave out the sizes of single components and those that separate (NaN).
        """
        first: dict[str, tuple[int, float]] = {}
        for index, item in enumerate(self.candidates):
            size = self._detectable(index, item, evidence)
            if item.label not in first or size > first[item.label][1]:
                first[item.label] = index, size
        labels = list(first)
        behind = np.full((len(labels), len(labels)), np.nan)
        result: list[CauseIsolation] = []
        for row, (label, (index, size)) in enumerate(first.items()):
            item, ties, separable = self.candidates[index], tuple[str, ...](), np.inf
            if np.isfinite(size):
                lost = self._behind(index, size)
                behind[row] = [lost.get(other, np.nan) for other in labels]
                behind[row, row] = 0.0
                ties = tuple(other for other, value in lost.items() if value < TIED)
                separable = np.nan if brief else self._separable(index, size, lost)
            usual = _usual(item)
            alone = np.full(len(usual), np.nan) if brief else self._alone(index, item, evidence)
            names, units = _amplitudes(item)
            result.append(CauseIsolation(label, names, units, usual, size, alone, separable, ties))
        return tuple(result), behind

    def _alone(self, index: int, item: Candidate, evidence: float) -> Array:
        """(k,) detectable size of each amplitude alone, in its unit."""
        axes = np.eye(len(item.low))
        return _usual(item) * [self._detectable(index, item, evidence, axis) for axis in axes]

    def _search(
        self, index: int, size: float, along: Array | None = None, candidates: Sequence[int] = ()
    ) -> Search:
        """For noise-free logs in which a cause of a size, in usual sizes, is the truth."""
        item = self.candidates[index]
        direction = np.ones(len(item.low)) if along is None else along
        strengths = size * _usual(item) * direction
        silent = self.screen.showing(self.screen.signature(index, strengths))
        return Search(silent, candidates or self.identifiable, limit=0.0)

    @cached_property
    def identifiable(self) -> tuple[int, ...]:
        """Candidates that the base does not reproduce."""
        return tuple(i for i in range(len(self.candidates)) if self.screen.identifiable(i))

    def _detectable(
        self, index: int, item: Candidate, evidence: float, along: Array | None = None
    ) -> float:
        """Size of a cause, in usual sizes, of a given evidence; inf where none within bounds."""
        if not self.screen.identifiable(index):
            return np.inf
        direction = np.ones(len(item.low)) if along is None else along
        used = direction > 0.0
        largest = min(LARGEST, float(np.min(item.high[used] / _usual(item)[used])))

        def excess(logarithm: float) -> float:
            size = float(np.exp(logarithm))
            return self._search(index, size, along, [index]).evidence((index,)) - evidence

        low, high = np.log(1e-9), np.log(largest)
        if excess(high) < 0.0:
            # far beyond its usual size, the prior of its size outweighs what it gains
            tries = np.linspace(np.log(1e-3), high, 40)
            reached = [x for x in tries.tolist() if excess(x) >= 0.0]
            if not reached:
                return np.inf
            high = reached[0]
        return float(np.exp(brentq(excess, low, high, xtol=1e-3)))

    def _behind(self, index: int, size: float) -> dict[str, float]:
        """Evidence by which each other cause is behind, by label."""
        search = self._search(index, size)
        result: dict[str, float] = {}
        for other, lost in search.instead((index,), index):
            label = self.candidates[other].label
            result.setdefault(label, max(float(lost), 0.0))
        return result

    def _separable(self, index: int, size: float, lost: Mapping[str, float]) -> float:
        """Size from which its nearest rivals are more than a tie behind, in usual sizes."""
        nearest = [label for label, value in lost.items() if value < TIED][:NEIGHBOURS]
        rivals = [i for i in self.identifiable if self.candidates[i].label in nearest]
        if not nearest:
            return size
        item = self.candidates[index]
        largest = min(LARGEST, float(np.min(item.high / _usual(item))))
        if largest <= size:
            return np.inf

        def excess(logarithm: float) -> float:
            search = self._search(index, float(np.exp(logarithm)), candidates=[index])
            nearest = max(search.evidence((other,)) for other in rivals)
            return search.evidence((index,)) - nearest - TIED

        low, high = np.log(size), np.log(largest)
        if excess(high) < 0.0:
            return np.inf
        return float(np.exp(brentq(excess, low, high, xtol=1e-2)))


def half_widths(baseline: Explanation) -> dict[str, tuple[float, str]]:
    """Half widths of the 95 % intervals of the base, and their units."""
    spread = 1.96 * np.sqrt(np.diag(baseline.covariance))[: len(baseline.base.names)]
    return {
        name: (float(half), unit)
        for name, half, unit in zip(baseline.base.names, spread, baseline.base.units, strict=True)
    }


def _usual(item: Candidate) -> Array:
    """(k,) usual size of each amplitude."""
    usual = item.trace.usual
    assert usual is not None
    return usual


def _amplitudes(item: Candidate) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of a candidate's amplitudes."""
    known: list[Parameter] = [entry for entry in item.effect.parameters() if entry.amplitude]
    names = tuple(name for entry in known for name in entry.names)
    return names, tuple(entry.unit for entry in known for _ in entry.names)


def _pairs(causes: Sequence[CauseIsolation]) -> tuple[tuple[str, str], ...]:
    pairs = {
        (min(item.label, other), max(item.label, other)) for item in causes for other in item.ties
    }
    return tuple(sorted(pairs))


def _alternatives(
    run: SimulatedRun,
    platform: Platform,
    log: Recording,
    streams: tuple[str, ...],
    causes: tuple[CauseIsolation, ...],
    evidence: float,
    seed: int,
    say: Say,
) -> list[Alternative]:
    """Other motions and sensors, compared with the planned experiment."""
    result: list[Alternative] = []

    def compare(words: str, kind: str, other: Recording, machine: Platform) -> None:
        say(words)
        try:
            theirs, _ = _Screen.of(other, machine).causes(evidence, brief=True)
        except TwinError:  # the motion is not observable without this stream
            return
        result.append(_compared(words, kind, causes, theirs))

    for name in streams:
        if len(streams) > 1:
            rest = tuple(other for other in streams if other != name)
            compare(f"without {name}", "without", _with_streams(log, rest), platform)
    if platform.base.kind == "ball" and not _glides(platform):
        for name, (columns, rate, noise) in ADDED.items():
            if name in platform.sensors:
                continue
            site = _site(platform) if name in ("inclinometer", "accelerometer") else ""
            if site is None:
                continue
            sensor = Sensor(name, rate, np.full(columns, noise), np.zeros(columns), site=site)
            richer = replace(platform, sensors={**platform.sensors, name: sensor})
            try:
                more, obstacle = run.attempt(richer, seed=seed)
            except TwinError:
                continue
            if not obstacle:
                words = f"with {name} ({rate:g} Hz, noise {noise:g})"
                compare(words, "with", _with_streams(more, (*streams, name)), richer)
    motions = [] if _glides(platform) else excitations(platform, run.duration)
    for other in motions:
        if other == run:
            continue
        try:
            flown, obstacle = other.attempt(other.platform, seed=seed)
        except TwinError:
            continue
        if not obstacle:
            compare(other.words, "motion", _with_streams(flown, streams), other.platform)
    return sorted(result, key=lambda item: (item.ties + len(item.lost), item.ratio))


def _site(platform: Platform) -> str | None:
    """A site of the MJCF at which an added sensor feels specific force; None where it has none."""
    model = compile_model(platform).model
    return model.site(0).name if model.nsite else None


def _compared(
    words: str,
    kind: str,
    causes: Sequence[CauseIsolation],
    theirs: Sequence[CauseIsolation],
) -> Alternative:
    by_label = {item.label: item for item in theirs}
    shown = [item for item in causes if np.isfinite(item.detectable)]
    ratios = [
        by_label[item.label].detectable / item.detectable
        for item in shown
        if item.label in by_label
    ]
    before = set(_pairs(causes))
    detected = {item.label for item in shown}
    after = {pair for pair in _pairs(theirs) if set(pair) <= detected}
    known = {item.label for item in theirs if np.isfinite(item.detectable)}
    split = sorted(pair for pair in before - after if set(pair) <= known)
    return Alternative(
        words,
        kind,
        sum(np.isfinite(item.detectable) for item in theirs),
        len(after),
        float(np.median(ratios)) if ratios else np.inf,
        tuple(split),
        tuple(sorted(detected - known)),
    )
