"""Comparison of a log with a platform's model, and with a model that is fitted to other logs."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from twin import rotation
from twin.comparison.account import Account, coloured, follow, is_noise, loosen
from twin.comparison.explanation import HORIZONS, TIED, FreeRun, Side, Strength, free_run, side
from twin.comparison.symptoms import Symptom, SymptomDomain, symptoms_of
from twin.conventions import ConventionFinding, check_conventions, corrected
from twin.identification.prediction_error import fit, likeliest_noise
from twin.identification.start import (
    along_what_rings,
    base_of,
    first_biases,
    first_theta,
    momentum_fit,
    rings,
)
from twin.noise import NoiseFinding, noise_findings
from twin.platform import Platform, in_gravity_of, in_order_of
from twin.predict.base import ENTRIES, BaseParameters, hinge_axis
from twin.predict.body import Body, body_of
from twin.predict.forces import predicted_machine
from twin.predict.innovations import Problem, Unexplained, unexplained_torque
from twin.predict.logs import check_possible, motion_of, usable
from twin.recording import Recording
from twin.recording.pauses import longest_of
from twin.shown import Shown

Array = NDArray[np.float64]
MOVED = 1e-3
"""Sliding masses that move further [m] make the energy's balance more than this."""
Say = Callable[[str], None]


@dataclass(frozen=True)
class MomentumBalance:
    """Of one log, on the grid of its smoothed motion."""

    time: Array
    """(m,) [s]."""
    momentum: Array | None
    """(m,) about the vertical, body and wheels [N m s]; None for a hinge and on a floor."""
    energy: Array | None
    """(m,) less the work of the motors [J]; None where sliding masses moved."""


def balance(account: Account) -> MomentumBalance:
    """Balance a log's measured motion with the base and the biases of an account."""
    body, base = account.problem.bodies[0], account.problem.base
    machine, motion = body.machine, body.motion
    platform, time = machine.platform, motion.time
    if platform.base.kind == "planar":
        return MomentumBalance(time, None, None)
    entries = base.entries(account.theta)
    inertia = np.zeros((3, 3))
    for value, (i, j) in zip(entries[:6], ENTRIES, strict=True):
        inertia[i, j] = inertia[j, i] = value
    hinge = platform.base.kind == "hinge"
    axis = hinge_axis(machine) if hinge else np.zeros(3)
    attitude = rotation.from_rotation_vector(motion.position * axis) if hinge else motion.position
    bias = np.zeros(3)
    sensors = account.at.biases[0][: len(body.bias_names)]
    for name, value in zip(body.bias_names, sensors, strict=True):
        if name.startswith("gyro "):
            bias["xyz".index(name[-1])] = value
    rate = motion.rate * axis if hinge else motion.rate - bias
    vertical = rotation.vertical_body(attitude)
    position, velocity, _ = body.inputs.joint_states(time)
    stage = position[:, machine.stage_qpos]
    still = not stage.size or float(np.ptp(stage, axis=0).max()) < MOVED
    spin = velocity[:, machine.wheel_dof]
    rotor = np.array([wheel.inertia for wheel in platform.wheels])
    axes = np.array([wheel.axis for wheel in platform.wheels]).reshape(-1, 3)
    momentum = rate @ inertia + (spin * rotor) @ axes
    edges = np.append(time, 2.0 * time[-1] - time[-2])
    torque = body.inputs.commanded(edges, motion)
    power = np.sum(torque[:, machine.wheel_dof] * spin, axis=1)
    if hinge:
        power = power + (torque[:, machine.base_dof] * motion.rate)[:, 0]
    work = np.asarray(cumulative_trapezoid(power, time, initial=0.0), dtype=np.float64)
    kinetic = 0.5 * np.sum(rate * (rate @ inertia), axis=1)
    kinetic = kinetic + np.sum(spin * rotor * (rate @ axes.T), axis=1)
    kinetic = kinetic + 0.5 * np.square(spin) @ rotor
    height = platform.gravity * vertical @ entries[6:]
    driven = bool(np.any(torque)) or not platform.wheels
    about = None if hinge else np.sum(vertical * momentum, axis=1)
    return MomentumBalance(time, about, kinetic + height - work if still and driven else None)


@dataclass(frozen=True)
class Comparison(Shown):
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
    balance: MomentumBalance

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
    def reported(self) -> Side:
        """The side whose laws are told first: the best one, unless it found none."""
        return self.best if self.best.strengths else self.as_built

    @property
    def where(self) -> tuple[tuple[SymptomDomain, ...], tuple[SymptomDomain, ...]]:
        """Where the discrepancy lives, and where it could live as well by this log.

        Where the laws live that were found, and what ties with them; without any law, what stands
        out most on its own.
        """
        if self.reported.strengths:
            ties = [tie for strength in self.reported.strengths for tie in strength.ties]
            domains = _domains(strength.symptom for strength in self.reported.strengths)
            return domains, tuple(d for d in _domains(ties) if d not in domains)
        out = [score for score in self.best.scores if score.stands_out]
        limit = max((score.evidence - score.needed for score in out), default=0.0) - TIED
        first, *others = _domains(s.symptom for s in out if s.evidence - s.needed > limit) or (
            None,
        )
        return ((first,), tuple(others)) if first else ((), ())


def _domains(symptoms: Iterable[Symptom]) -> tuple[SymptomDomain, ...]:
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
        beside = [symptom for symptom in symptoms if not symptom.of_scale]
        refitted = side(body, base, beside, theta, biases, held=False)
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
    result = fit(problem, problem.start(base.as_stated, [first_biases(body)]))
    return along_what_rings(problem, result)[0].bodies[0]


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


def missing_torque(comparison: Comparison, mean: float) -> Unexplained:
    """A white torque of the likeliest intensity, smoothed beside the best base without its laws.

    Args:
        comparison: whose best model's base is taken.
        mean: over which the torque is averaged [s]; what chatters faster is no matter of a law.
    """
    side = comparison.best if comparison.best.strengths else comparison.as_built
    account = side.explained
    problem = Problem([comparison.body], comparison.base, held=True)
    at = problem.start(account.theta, account.at.biases)
    unexplained = unexplained_torque(problem, likeliest_noise(problem, problem.innovations(at)), 0)
    count = max(round(mean / float(unexplained.time[1] - unexplained.time[0])), 1)
    whole = len(unexplained.time) // count * count

    def averaged(values: Array) -> Array:
        return values[:whole].reshape(-1, count, *values.shape[1:]).mean(axis=1)

    return Unexplained(
        averaged(unexplained.time), averaged(unexplained.rate), averaged(unexplained.torque)
    )


@dataclass(frozen=True)
class Transfer:
    """The first log's model on another log."""

    comparison: Comparison
    """Of the other log on its own."""
    plain: Account
    """The first log's base, no symptom."""
    explained: Account
    """The first log's base and symptoms."""
    strengths: tuple[Strength, ...]
    """Of the first log."""


def transfer(fitted: Comparison, other: Comparison) -> Transfer:
    """Predict another log with the base and the symptoms of a fitted one."""
    source = fitted.best
    return Transfer(
        other,
        _held(fitted, other, source.plain, with_symptoms=False),
        _held(fitted, other, source.explained, with_symptoms=True),
        source.strengths,
    )


def _held(
    fitted: Comparison, other: Comparison, account: Account, *, with_symptoms: bool
) -> Account:
    theta = other.base.theta(fitted.base.entries(account.theta))
    joints = len(fitted.base.joints)
    if joints and fitted.base.names[-joints:] == other.base.names[-joints:]:
        theta[-joints:] = account.theta[-joints:]
    problem = Problem([other.body], other.base, held=True)
    biases = other.best.plain.at.biases
    start = problem.start(theta, biases)
    if with_symptoms and account.chosen:
        more = [p for symptom in account.chosen for p in symptom.perturbations]
        problem = Problem([other.body], other.base, more, held=True, strengths_held=True)
        start = replace(start, strengths=np.array(account.strengths))
    followed = follow(problem, account.chosen, start) if other.best.plain.follows else None
    if followed is not None and followed.follows:
        return followed
    return loosen(problem, account.chosen, start)
