"""Optimal experiments: the motion within a machine's limits that tells most of what is asked.

The motion is a multisine of roll, pitch and yaw (or, of a machine that no law turns at will, the
attitude and rate that it is let go from). Each trial is simulated with the machine's law, actuators
and sensors; the predictor's whitened columns of the recording, with J, m r, constant errors of
sensors and initial states free, give the Fisher information, and the criterion

- `inertia`: the mean logarithm of the standard deviations of the moments and products of inertia;
- one cause: that of its amplitudes, base free (D_s-optimality);
- two causes: the evidence by which the other one in its place is behind, the lesser of both, the
  base free (T-optimality).

A. C. Atkinson and V. V. Fedorov, The design of experiments for discriminating between two rival
models, Biometrika 62 (1975). The search is SciPy's differential evolution; limits are a penalty.
The forecast is then held against flights with other noise, each fitted anew.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import differential_evolution

from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import Candidate, candidate
from twin.diagnosis.experiment import TRACKERS, SimulatedRun
from twin.diagnosis.explanation import Explanation
from twin.diagnosis.screen import LinearScreen, Search, price
from twin.effects import Effect, able, effect_named, with_effects
from twin.effects.effect import targets
from twin.errors import TwinError, UsageError
from twin.experiments.isolation import EVIDENCE, planned_run
from twin.files import check_writable
from twin.identification.prediction_error import NORMAL, fit
from twin.identification.start import base_of, first_biases
from twin.manoeuvre import AttitudeTable
from twin.platform import Platform, in_gravity_of, load_platform
from twin.predict.body import body_of
from twin.predict.columns import amplitudes
from twin.predict.forces import predicted_machine
from twin.predict.innovations import Innovations, Problem
from twin.predict.logs import motion_of, usable
from twin.recording import Recording
from twin.reference import Tabulated
from twin.rotation import from_euler_zyx
from twin.shown import Shown

Array = NDArray[np.float64]
Say = Callable[[str], None]
MARGIN = 0.8
"""Share of a limit (stop, rate, momentum, torque) that a proposed motion may use."""
RATE = np.radians(30.0)
"""Body rate at which the guard of a machine on its bench ends a flight [rad/s]."""
YAW = np.radians(90.0)
"""Largest yaw that is tried [rad]."""
TONES = np.sqrt([1.0, 5.0, 10.0])
"""Frequencies of an axis, over its lowest: no two have a rational ratio."""
WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Shares of its amplitude."""
FASTEST = 0.15
"""Highest of the lowest frequencies [Hz]."""
SPACING = 0.1
"""Of the rows of a reference file [s]."""
SMOOTHED = 1.0
"""Over which commands are averaged before they are held against their limits [s]."""
STARTS = np.radians(5.0)
"""Largest rate that a machine is let go with [rad/s]."""
SMALLER = 4
"""Times that a trial is made smaller, at most."""
REFUSED = 1e3
"""Criterion of a trial that meets a limit, before its excess is added."""


def multisine(numbers: Array, duration: float) -> Tabulated:
    """A motion from rest to rest.

    Args:
        numbers: (9,) amplitudes of roll, pitch and yaw [rad], logarithms of their lowest
            frequencies [Hz], phases of their lowest tones [rad].
        duration: [s].
    """
    time = np.asarray(np.arange(round(duration / SPACING) + 1) * SPACING, dtype=np.float64)
    ramp = min(10.0, duration / 6.0)
    share = _smooth(time / ramp) * _smooth((duration - time) / ramp)
    amplitude, lowest, phase = numbers[:3], np.exp(numbers[3:6]), numbers[6:]
    turns = time[:, None, None] * lowest[:, None] * TONES
    shifts = phase[:, None] + np.pi * np.arange(3.0) ** 2 / 3.0
    angles = share[:, None] * amplitude * (np.sin(2.0 * np.pi * turns + shifts) @ WEIGHTS)
    roll, pitch, yaw = angles.T
    return Tabulated(AttitudeTable(time, _continuous(from_euler_zyx(yaw, pitch, roll))))


def _smooth(share: Array) -> Array:
    """Quintic step from 0 to 1."""
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10.0 + u * (6.0 * u - 15.0))


def _continuous(attitude: Array) -> Array:
    """Quaternions (m, 4) without jumps of sign."""
    flips = np.sum(attitude[1:] * attitude[:-1], axis=1) < 0.0
    return attitude * np.concatenate([[1.0], np.cumprod(np.where(flips, -1.0, 1.0))])[:, None]


@dataclass(frozen=True)
class ExcitedNumber:
    """One number that the experiment determines."""

    name: str
    unit: str
    half: float
    """Half width of its forecast 95 % interval,"""
    usual: float
    """and of that of the machine's usual experiment of the same length."""


@dataclass(frozen=True)
class Design(Shown):
    """A proposed experiment and its forecast."""

    run: SimulatedRun
    """As it is flown; `motion` is the reference."""
    wanted: tuple[str, ...]
    """`inertia`, or labels of causes."""
    numbers: tuple[ExcitedNumber, ...]
    """Of J, or of the amplitudes of one cause."""
    behind: Mapping[str, tuple[float, float]]
    """Of two causes: evidence by which the other one is behind where one is the truth, forecast
    here and for the usual experiment."""
    sizes: Mapping[str, Array]
    """Their sizes, in the effects' units: those with an evidence of 60 in the usual experiment."""
    used: Mapping[str, float]
    """Share of each limit that the simulated flight uses."""
    scatter: float
    """Rms error of the noisy flights over the forecast standard deviation; NaN where not asked."""
    observed: Mapping[str, tuple[float, float]]
    """Of two causes: mean evidence by which the other one is behind in noisy flights, and its
    standard deviation."""
    flights: int
    """Noisy flights behind `scatter` and `observed`."""
    evaluations: int
    file: Path | None = None

    @property
    def narrower(self) -> float:
        """Geometric mean of the factors by which intervals are narrower than the usual ones; of
        two causes the factor on the lesser evidence."""
        if self.behind:
            new, old = (min(pair[i] for pair in self.behind.values()) for i in (0, 1))
            return new / max(old, 1e-9)
        wanted = [n for n in self.numbers if self.wanted != ("inertia",) or n.name[0] == "J"]
        ratios = [number.usual / number.half for number in wanted]
        return float(np.exp(np.mean(np.log(ratios))))


def excite(
    platform: str | Path | Platform,
    wanted: str,
    *,
    duration: float = 60.0,
    evaluations: int = 90,
    flights: int = 8,
    out: str | Path | None = None,
    seed: int = 0,
    say: Say = lambda _: None,
) -> Design:
    """The motion within a machine's limits that tells most of what is asked.

    Args:
        platform: the machine.
        wanted: `inertia`, an effect of the catalogue (`NAME[:TARGET]`), or two of them with a comma
            between, which the experiment is to distinguish.
        duration: [s].
        evaluations: simulated trials.
        flights: with other noise, which the forecast is held against; 0: none.
        out: write the reference into this .csv file.
        seed: of the search and of the noise.
        say: takes each step.

    Raises:
        UnknownName: no such effect or target.
        UsageError: what is asked is not observable, or no trial keeps within the limits.
    """
    machine = platform if isinstance(platform, Platform) else load_platform(str(platform))
    _check(duration, evaluations, flights)
    path = None if out is None else Path(out)
    if path is not None:
        check_writable(path, ".csv")
    usual = planned_run(machine, duration)
    follows = usual.controller in TRACKERS
    if path is not None and not follows:
        raise UsageError(
            f"no shipped law makes {machine.name} follow a reference, so there is none to write: "
            "leave the file out; what is proposed is how to let it go"
        )
    causes = _causes(machine, wanted)
    study = _Study(machine, usual, causes, seed)
    say(f"the usual experiment: {usual.words}")
    before = study.outcome(usual, margin=1.0)
    if before is None:
        raise UsageError(f"{usual.words} for {duration:g} s meets a limit: {study.obstacle}")
    study.size(before)
    space = _Tracked(machine, usual, duration) if follows else _LetGo(machine, usual)
    best = _searched(study, space, evaluations, seed, say)
    after = study.outcome(best)
    assert after is not None
    say(f"{flights} flights with noise")
    scatter, observed = study.verified(best, after, flights, say)
    if path is not None:
        assert isinstance(best.motion, Tabulated)
        best.motion.table.save(path)
        best = replace(best, reference=str(path))
    return Design(
        best,
        tuple(item.label for item in causes) or ("inertia",),
        study.numbers(after, before),
        study.pair(after, before),
        {item.label: study.strengths[item.label] for item in causes if len(causes) == 2},
        after.used,
        scatter,
        observed,
        flights,
        evaluations,
        path,
    )


def _check(duration: float, evaluations: int, flights: int) -> None:
    if not duration >= 10.0:
        raise UsageError(f"duration is {duration:g} s; give 10 or more")
    if evaluations < 10:
        raise UsageError(f"evaluations is {evaluations}; give 10 or more")
    if flights < 0:
        raise UsageError(f"flights is {flights}; give 0 or more")


def _causes(platform: Platform, wanted: str) -> tuple[Candidate, ...]:
    """Candidates of the effects that are named; none for the inertia."""
    if wanted == "inertia":
        return ()
    labels = wanted.split(",")
    if len(labels) > 2 or len(set(labels)) < len(labels):
        raise UsageError(
            f"{wanted!r} names {len(labels)} things; give inertia, one effect, or two other ones"
        )
    result: list[Candidate] = []
    for label in labels:
        name, _, target = label.partition(":")
        kind = effect_named(name)
        possible = targets(kind.takes, platform) if kind.takes else ()
        if target not in possible and (target or possible):
            known = ", ".join(f"{name}:{item}" for item in possible) or name
            raise UsageError(f"{label!r} is no effect of {platform.name}; it has {known}")
        item = candidate(kind.typical(target).absent(), platform)
        if not item.perturbations:
            raise UsageError(f"{label} changes no expected value, so no motion shows it better")
        result.append(item)
    return tuple(result)


@dataclass(frozen=True)
class _Tracked:
    """Multisines that a law follows."""

    platform: Platform
    usual: SimulatedRun
    duration: float

    sizes: int = 3
    """Numbers that are amplitudes; they come first."""

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Of the numbers of `multisine`."""
        tilt = MARGIN * min(float(self.platform.stop_angle), np.radians(45.0))
        slowest = np.log(1.0 / self.duration)
        return [
            (0.05 * tilt, tilt),
            (0.05 * tilt, tilt),
            (0.02 * YAW, YAW),
            *[(slowest, np.log(FASTEST))] * 3,
            *[(0.0, 2.0 * np.pi)] * 3,
        ]

    def run(self, numbers: Array) -> SimulatedRun:
        """The run of some numbers, smaller where wheels could not give its torque."""
        motion = multisine(numbers, self.duration)
        share = self._torque(motion)
        if share > 0.9 * MARGIN:
            smaller = np.concatenate([numbers[:3] * 0.9 * MARGIN / share, numbers[3:]])
            motion = multisine(smaller, self.duration)
        return replace(self.usual, reference="", motion=motion)

    def _torque(self, motion: Tabulated) -> float:
        """Share of the wheels' torque that a motion takes; 0 of wheels in gimbals."""
        platform = self.platform
        if not platform.wheels or platform.gimbals:
            return 0.0
        target = motion.at(motion.table.time)
        rate, inertia = target.rate_body, platform.inertia
        torque = target.acceleration_body @ inertia + np.cross(rate, rate @ inertia)
        axes = np.stack([wheel.axis for wheel in platform.wheels])
        limit = np.array([wheel.torque_limit for wheel in platform.wheels])
        return float(np.max(np.abs(torque @ np.linalg.pinv(axes)) / limit))


@dataclass(frozen=True)
class _LetGo:
    """Attitudes and rates that a machine is let go from."""

    platform: Platform
    usual: SimulatedRun
    sizes: int = 5
    """All numbers are amplitudes."""

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Of roll and pitch [rad], then of the rates [rad/s]."""
        hinge = self.platform.base.kind == "hinge"
        stop = float(self.platform.stop_angle)
        tilt = np.pi if not np.isfinite(stop) else MARGIN * stop
        return [(-tilt, tilt)] * (1 if hinge else 2) + [(-STARTS, STARTS)] * (1 if hinge else 3)

    def run(self, numbers: Array) -> SimulatedRun:
        """The run of some numbers."""
        angles = np.degrees(numbers)
        tilts = 1 if self.platform.base.kind == "hinge" else 2
        attitude, rate = np.zeros(3), np.zeros(3)
        attitude[:tilts] = angles[:tilts]
        rate[: len(angles) - tilts] = angles[tilts:]
        attitude, rate = np.round(attitude, 2), np.round(rate, 2)
        return replace(
            self.usual,
            attitude=(float(attitude[0]), float(attitude[1]), 0.0),
            rate=(float(rate[0]), float(rate[1]), float(rate[2])),
        )


Space = _Tracked | _LetGo


def _searched(study: "_Study", space: Space, evaluations: int, seed: int, say: Say) -> SimulatedRun:
    """The best run of so many simulated trials.

    A trial that meets a limit is made smaller, in proportion, until it keeps within all of them:
    the best experiments use their limits, and a search that threw these away would find few.
    """
    bounds = np.array(space.bounds)
    rng = np.random.default_rng(seed)
    members = max(min(2 * len(bounds), evaluations // 5), 5)
    best: tuple[float, SimulatedRun] | None = None
    trials = 0

    def criterion(numbers: Array) -> float:
        nonlocal best, trials
        value, run = REFUSED, space.run(numbers)
        for _ in range(SMALLER):
            trials += 1
            value = study.criterion(run)
            if value < REFUSED:
                break
            excess = value - REFUSED
            # a command that is clipped says nothing of what was wished
            factor = 0.4 if excess > 0.99 else 0.95 * MARGIN / excess
            numbers = np.concatenate([factor * numbers[: space.sizes], numbers[space.sizes :]])
            run = space.run(numbers)
        if value < REFUSED and (best is None or value < best[0]):
            best = value, run
        shown = "none within the limits" if best is None else f"{best[0]:.4g}"
        say(f"trial {trials}, the best so far: {shown}")
        return value

    first = bounds[:, 0] + rng.random((members, len(bounds))) * (bounds[:, 1] - bounds[:, 0])
    generations = max(round(evaluations / members) - 1, 1)
    differential_evolution(
        criterion,
        bounds,
        init=first,
        maxiter=generations,
        mutation=(0.4, 0.9),
        recombination=0.8,
        polish=False,
        tol=0.0,
        seed=np.random.default_rng(seed + 1),
    )
    if best is None:
        raise UsageError(
            f"no motion of {trials} keeps within the limits of {study.platform.name}; the last "
            f"one: {study.obstacle}. Ask for more with --evaluations, or a longer --duration"
        )
    return best[1]


@dataclass(frozen=True)
class _Outcome:
    """What one simulated run tells."""

    covariance: Array
    """(p, p) of the base."""
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Array
    screen: LinearScreen | None
    """Of the causes, if any."""
    used: Mapping[str, float]


@dataclass
class _Study:
    """Trials of one machine for one purpose."""

    platform: Platform
    usual: SimulatedRun
    causes: tuple[Candidate, ...]
    seed: int
    strengths: dict[str, Array] = field(default_factory=dict[str, Array])
    """(k,) size of each cause that is taken for the truth."""
    obstacle: str = ""
    """What the last trial met."""

    def outcome(self, run: SimulatedRun, *, margin: float = MARGIN) -> _Outcome | None:
        """What a run tells; None where it meets that share of a limit."""
        value = self._tried(run, margin)
        return value if isinstance(value, _Outcome) else None

    def criterion(self, run: SimulatedRun) -> float:
        """What is minimised."""
        value = self._tried(run)
        if not isinstance(value, _Outcome):
            return REFUSED + value
        if value.screen is None:
            moments = [i for i, name in enumerate(value.names) if name.startswith("J")]
            spread = np.sqrt(np.diag(value.covariance))[moments] / value.scale[moments]
            return float(np.mean(np.log(spread)))
        if len(self.causes) == 1:
            shown = np.sqrt(_information(value.screen, 0))
            return float(-np.mean(np.log(np.maximum(shown * self.strengths_of(0), 1e-12))))
        return -min(self._lost(value.screen, truth) for truth in (0, 1))

    def strengths_of(self, index: int) -> Array:
        """(k,) size of a cause: usual, or that of the truth."""
        usual = self.causes[index].trace.usual
        assert usual is not None
        return self.strengths.get(self.causes[index].label, usual)

    def size(self, before: _Outcome) -> None:
        """Give each of two causes the size that the usual experiment detects."""
        if before.screen is None or len(self.causes) < 2:
            return
        for index, item in enumerate(self.causes):
            usual = item.trace.usual
            assert usual is not None
            gain = float(np.sum(np.square(before.screen.signature(index, usual))))
            if gain <= 0.0:
                raise UsageError(
                    f"{item.label} does what a change of J or m r does in {self.usual.words}; "
                    "these causes cannot be compared there"
                )
            wanted = EVIDENCE
            for _ in range(20):  # evidence is the gain less its price
                wanted = EVIDENCE + price(wanted, before.screen.information(index))
            multiple = min(np.sqrt(wanted / gain), float(np.min(item.high / usual)))
            self.strengths[item.label] = multiple * usual

    def _lost(self, screen: LinearScreen, truth: int) -> float:
        """Evidence by which the other cause is behind."""
        signal = screen.signature(truth, self.strengths_of(truth))
        search = Search(screen.showing(signal), (0, 1), limit=0.0)
        return search.evidence((truth,)) - search.evidence((1 - truth,))

    def _tried(self, run: SimulatedRun, margin: float = MARGIN) -> "_Outcome | float":
        try:
            log, self.obstacle = run.attempt(self.platform, seed=self.seed)
        except TwinError as problem:
            self.obstacle = str(problem)
            return 10.0
        used = limits_used(log, self.platform)
        worst = max(used, key=lambda name: used[name], default="")
        if worst and used[worst] > margin + 1e-3:
            self.obstacle = self.obstacle or f"{used[worst]:.0%} of its {worst}"
        if self.obstacle:
            return max(used.get(worst, 1.0), 1.0)
        try:
            linear = linearised(log.without_truth(), self.platform)
        except TwinError as problem:
            self.obstacle = str(problem)
            return 10.0
        base = linear.base
        p = len(base.names)
        assert isinstance(linear.prediction, Innovations)
        return _Outcome(
            linear.prediction.covariance[:p, :p],
            base.names,
            base.units,
            base.scale,
            linear.screen(self.causes) if self.causes else None,
            used,
        )

    def numbers(self, after: _Outcome, before: _Outcome) -> tuple[ExcitedNumber, ...]:
        """Half widths of what is asked."""
        if len(self.causes) == 2:
            return ()
        if not self.causes:
            halves, old = (NORMAL * np.sqrt(np.diag(o.covariance)) for o in (after, before))
            return tuple(
                ExcitedNumber(name, unit, float(half), float(other))
                for name, unit, half, other in zip(
                    after.names, after.units, halves, old, strict=True
                )
            )
        item = self.causes[0]
        assert after.screen is not None
        assert before.screen is not None
        free = amplitudes(item.effect)
        names = [n for n, size in zip(item.effect.names, free, strict=True) if size]
        units = [k.unit for k in item.effect.parameters() for _ in range(k.size) if k.amplitude]
        new, old = (_deviations(o.screen) for o in (after, before) if o.screen is not None)
        return tuple(
            ExcitedNumber(f"{item.label} {name}", unit, NORMAL * a, NORMAL * b)
            for name, unit, a, b in zip(names, units, new.tolist(), old.tolist(), strict=True)
        )

    def pair(self, after: _Outcome, before: _Outcome) -> dict[str, tuple[float, float]]:
        """Of two causes, evidence of the other one behind."""
        if len(self.causes) != 2 or after.screen is None or before.screen is None:
            return {}
        return {
            item.label: (self._lost(after.screen, i), self._lost(before.screen, i))
            for i, item in enumerate(self.causes)
        }

    def verified(
        self, run: SimulatedRun, forecast: _Outcome, flights: int, say: Say
    ) -> tuple[float, dict[str, tuple[float, float]]]:
        """The run with other noise, fitted: error over forecast deviation; or evidence."""
        if not flights:
            return np.nan, {}
        errors: list[Array] = []
        behind: dict[str, list[float]] = {item.label: [] for item in self.causes}
        for number in range(flights):
            say(f"flight {number + 1} of {flights}")
            seed = self.seed + 1 + number
            if not self.causes:
                errors.append(self._base_error(run, forecast, seed))
            elif len(self.causes) == 1:
                screen = self._flown(run, 0, seed)
                strengths = np.concatenate(screen.weigh([0]).strengths)
                errors.append((strengths - self.strengths_of(0)) / _deviations(screen))
            else:
                for truth, item in enumerate(self.causes):
                    search = Search(self._flown(run, truth, seed), (0, 1), limit=0.0)
                    lost = search.evidence((truth,)) - search.evidence((1 - truth,))
                    behind[item.label].append(lost)
        scatter = float(np.sqrt(np.mean(np.square(errors)))) if errors else np.nan
        observed = {
            label: (float(np.mean(values)), float(np.std(values)))
            for label, values in behind.items()
            if values
        }
        return scatter, observed

    def _base_error(self, run: SimulatedRun, forecast: _Outcome, seed: int) -> Array:
        """(6,) errors of J over their forecast deviations."""
        log, obstacle = run.attempt(self.platform, seed=seed)
        if obstacle:
            raise UsageError(f"the proposed motion meets a limit with other noise: {obstacle}")
        linear = linearised(log.without_truth(), self.platform)
        result = fit(linear.problem, linear.at)
        p = len(linear.base.names)
        moments = [i for i, name in enumerate(linear.base.names) if name.startswith("J")]
        error = result.at.theta - linear.base.as_stated
        return (error / np.sqrt(np.diag(forecast.covariance))[:p])[moments]

    def _flown(self, run: SimulatedRun, truth: int, seed: int) -> LinearScreen:
        """The screen of a noisy flight with one cause in it."""
        effect = self._effect(truth)
        machine = with_effects(able(self.platform, effect), (effect,))
        log, obstacle = run.attempt(machine, seed=seed)
        if obstacle:
            raise UsageError(f"the proposed motion with {effect.words()} meets a limit: {obstacle}")
        return baseline_of([log.without_truth()], self.platform).screen(self.causes)

    def _effect(self, index: int) -> Effect:
        """A cause at its size."""
        effect = self.causes[index].effect
        values = effect.values.copy()
        values[amplitudes(effect)] = self.strengths_of(index)
        return effect.with_values(values)


def _information(screen: LinearScreen, index: int) -> Array:
    """(k,) Fisher information along the principal directions of a cause; 0 where the base does what
    it does."""
    count = len(screen.size_of(index))
    shown = np.zeros(count)
    known = screen.information(index)[:count]
    shown[: len(known)] = known
    return shown


def _deviations(screen: LinearScreen) -> Array:
    """(k,) standard deviations of the amplitudes of the first cause, base free."""
    count = len(screen.size_of(0))
    columns = np.stack([screen.signature(0, axis) for axis in np.eye(count)], axis=1)
    return np.sqrt(np.diag(np.linalg.pinv(columns.T @ columns)))


def linearised(log: Recording, platform: Platform) -> Explanation:
    """A log's prediction by the machine as stated, without a fit of its base.

    Raises:
        TwinError: it cannot be predicted.
    """
    machine = in_gravity_of([log], platform)
    read = usable(log, machine)
    compiled = predicted_machine(machine)
    body = body_of(compiled, read, motion_of(read, machine))
    _, base = base_of(compiled, [read])
    problem = Problem([body], base)
    start = problem.start(base.as_stated, [first_biases(body)])
    return Explanation(
        (body,), base, (), (), (), problem, problem.innovations(start), converged=True, most=()
    )


def limits_used(log: Recording, platform: Platform) -> dict[str, float]:
    """Share of each limit that a simulated flight uses: its largest value over the limit; of
    commands the largest mean over `SMOOTHED`.

    Args:
        log: with its truth.
        platform: the machine.
    """
    result: dict[str, float] = {}
    if "truth_attitude" in log and np.isfinite(platform.stop_angle):
        lean = platform.lean(log["truth_attitude"].value)
        result["tilt"] = float(np.max(lean)) / float(platform.stop_angle)
    if "truth_rate" in log and platform.base.kind != "hinge":
        rate = np.linalg.norm(log["truth_rate"].value, axis=1)
        result["rate"] = float(np.max(rate)) / RATE
    wheels = platform.wheels
    if wheels and "truth_wheel_speed" in log:
        most = np.array([wheel.speed_limit for wheel in wheels])
        speed = np.abs(log["truth_wheel_speed"].value)
        if not platform.gimbals:
            result["wheel momentum"] = float(np.max(speed / most))
    of: Sequence[tuple[str, str, list[float]]] = (
        ("wheel torque", "command_wheel_torque", [wheel.torque_limit for wheel in wheels]),
        ("gimbal rate", "command_gimbal_rate", [gimbal.rate for gimbal in platform.gimbals]),
    )
    for name, stream, limits in of:
        if stream in log and limits and np.any(log[stream].value):
            # the noise of the law's estimate is in every command, and no motion avoids it
            rows = max(round(SMOOTHED * log[stream].rate), 1)
            mean = uniform_filter1d(log[stream].value, rows, axis=0, mode="nearest")
            result[name] = float(np.max(np.abs(mean) / np.array(limits)))
    return result
