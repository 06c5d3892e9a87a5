"""J and m r of a platform from logs, with intervals and their identifiability.

Gimbals that do not go where they are told: followed as measured, not as commanded.
Friction, play or a late drive leave a gimbal elsewhere than its command has it. Whose fault that
is, diagnosis asks; who identifies the body needs to know where the gyros really point.

The rigid body nearest to what logs say: what noise took beyond the possible is given back.
A body of mass m, mass moment h and inertia J about a point is made of positive masses only if

    P = [[m, h^T], [h, tr(J) / 2 - J]]

has no negative eigenvalue: J is positive, its moments keep the triangle inequality, and h is not
longer than such a body has room for (P. M. Wensing, S. Kim and J.-J. E. Slotine, IEEE RA-L 3,
2018). Such P are a convex set, linear in J and h. The projection on it, in the metric of the
covariance, brings an estimate nearer to every body there is, so intervals around it cover no less.
P is kept possible by its Cholesky factor (C. Rucker and P. M. Wensing, IEEE RA-L 7, 2022), without
the logarithm on its diagonal: what is sought lies on the border, where an entry of it is 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from twin.conventions.time_base import check_times
from twin.errors import TwinError, UnknownName, UsageError
from twin.identification.excitation import (
    ROUNDS,
    Excitation,
    Scale,
    as_taken,
    change_of,
    common_scale,
    excitation_of,
    not_excited,
    scale_unknown,
    scaled_together,
    scales_of,
    unknown_scales,
)
from twin.identification.methods import PAPERS, Logs, Settings
from twin.identification.prediction_error import NORMAL, Fit, fit, fit_disturbed
from twin.identification.start import (
    along_what_rings,
    base_of,
    first_biases,
    first_theta,
    momentum_fit,
    rings,
)
from twin.model import Machine, carried_properties
from twin.platform import Platform, in_gravity_of, in_order_of, taken_as_at_rest
from twin.predict.base import ENTRIES, BaseParameters
from twin.predict.body import body_of
from twin.predict.forces import Perturbation, predicted_machine
from twin.predict.innovations import Problem, Unknowns
from twin.predict.logs import Scaled, check_possible, first_scaled, motion_of, sought, usable
from twin.predict.profiles import STREAM, from_mean, less_drive_faults, profile
from twin.predict.sensors import digits_of, noise_of
from twin.recording import Recording
from twin.recording.pauses import pieces_of
from twin.shown import Shown

Array = NDArray[np.float64]


ANGLE = "gimbal_angle"

WORTHWHILE = 25.0
"""A fault of a drive must explain so much of a gimbal's angle, in log-likelihood, before the
command is not believed. What an encoder's steps may round away speaks for no fault: a gimbal that
moves by less than a step seems to stand."""


def as_measured(recording: Recording, machine: Machine) -> tuple[Recording, tuple[str, ...]]:
    """A log without the gimbals' commands where their angles say otherwise, and a sentence then.

    Args:
        recording: as measured.
        machine: compiled, as stated.
    """
    gimbals = machine.platform.gimbals
    if not gimbals or STREAM not in recording or ANGLE not in recording:
        return recording, ()
    command, measured = recording[STREAM], recording[ANGLE]
    if not len(command) or not len(measured):
        return recording, ()
    path, _ = profile(machine, STREAM, command)
    digit = digits_of(measured, machine.platform, ANGLE)
    error = _beyond(measured.value - path.interpolated_at(measured.time), digit)
    unexplained = _beyond(less_drive_faults(machine, command, path, measured).value, digit)
    noise = noise_of(recording, machine.platform, ANGLE)
    explained = 0.5 * np.sum(np.square(error) - np.square(unexplained), axis=0) / np.square(noise)
    astray = explained > WORTHWHILE
    if not astray.any():
        return recording, ()
    names = ", ".join(gimbal.name for gimbal, far in zip(gimbals, astray, strict=True) if far)
    streams = {name: series for name, series in recording.streams.items() if name != STREAM}
    sentence = (
        f"{names} did not go where {STREAM} says (friction, play or a late drive): gimbals are "
        f"taken to stand where {ANGLE} has them"
    )
    return replace(recording, streams=streams), (sentence,)


def _beyond(error: Array, digit: Array) -> Array:
    """(m, k) what of an error (m, k) from its mean is more than rounding to a step (k,) makes."""
    error = from_mean(error)
    return np.sign(error) * np.maximum(np.abs(error) - digit, 0.0)


THINNEST = 1e-6
"""Of the mean eigenvalue of tr(J) / 2 - J: where the projection starts, inside the possible."""
ROUNDING = 1e-12
"""Of a covariance, as correlations: parts that are smaller are not known."""
NEGLIGIBLE = 1e-3
"""Standard deviations that an estimate is moved without a word."""
NOT_NOISE = 3.0
"""Standard deviations that noise carries an estimate no further than once in 700 logs."""


@dataclass(frozen=True)
class Nearest:
    """The nearest rigid body."""

    theta: Array
    """(p,)."""
    distance: float
    """How far the estimate was from it, in standard deviations; 0: it was one."""

    @property
    def sentence(self) -> str:
        """What to say of it; empty where nothing is."""
        if self.distance == 0.0:
            return ""
        said = (
            f"What fits best is {self.distance:.1f} standard deviations from any rigid body; the "
            "nearest one is given."
        )
        if self.distance <= NOT_NOISE:
            return said
        return f"{said} That is not noise: look at the mass, the wheels' inertia and the model."


def nearest_body(base: BaseParameters, theta: Array, covariance: Array) -> Nearest:
    """Project an estimate (p,) with its covariance (p, p) on the bodies that there are.

    What the machine carries is known; the rest of it, its bus, must be a body. On a hinge J keeps
    its stated proportions, so it is returned as it is.
    """
    machine = base.machine
    if machine.platform.base.kind != "ball":
        return Nearest(theta, 0.0)
    carried = carried_properties(machine.model, machine.base_body)
    mass = machine.platform.mass - carried.mass
    known = np.array([carried.inertia[i, j] for i, j in ENTRIES])
    entries = base.entries(theta) - np.concatenate([known, carried.center_of_mass_offset])
    moment, second = entries[6:], _second_moment(entries[:6])
    core = second - np.outer(moment, moment) / mass
    size, axes = np.linalg.eigh(core)
    floor = THINNEST * float(np.abs(size).mean())
    if size[0] >= 0.0:
        return Nearest(theta, 0.0)
    lower = np.linalg.cholesky((axes * np.maximum(size, floor)) @ axes.T)
    inside = np.tril_indices(3, -1)
    metric = _metric(covariance)
    count = len(base.joints)

    def change(x: Array) -> Array:
        factor = np.diag(x[:3])
        factor[inside] = x[3:6]
        body = factor @ factor.T + np.outer(x[6:9], x[6:9]) / mass
        inertia = np.trace(body) * np.eye(3) - body
        result = np.concatenate([[inertia[i, j] for i, j in ENTRIES], x[6:9]])
        return np.concatenate([result - entries, x[9:]])

    start = np.concatenate([np.diag(lower), lower[inside], moment, np.zeros(count)])
    best = least_squares(lambda x: metric @ change(np.asarray(x)), start)
    distance = float(np.sqrt(2.0 * best.cost))
    if distance < NEGLIGIBLE:
        return Nearest(theta, 0.0)
    return Nearest(theta + change(np.asarray(best.x)), distance)


def _metric(covariance: Array) -> Array:
    """M with M^T M = covariance^-1; of what a fit that did not settle left, too, where rounding
    may have spoilt a covariance of which little is known."""
    size = np.sqrt(np.abs(np.diag(covariance)))
    share, axes = np.linalg.eigh(covariance / np.outer(size, size))
    return (axes / np.sqrt(np.maximum(share, ROUNDING * share[-1]))).T / size


def _second_moment(inertia: Array) -> Array:
    """(3, 3) tr(J) / 2 - J of (6,) entries."""
    tensor = np.empty((3, 3))
    for value, (i, j) in zip(inertia, ENTRIES, strict=True):
        tensor[i, j] = tensor[j, i] = value
    return 0.5 * np.trace(tensor) * np.eye(3) - tensor


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
        """Whether the residual is noise."""
        return self.chi2_per_sample <= self.high

    @property
    def strays(self) -> bool:
        """Whether the residual is so much more than noise that no interval covers it."""
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
    unexplained: tuple[Misfit, ...] = ()
    """The same under the white torque that was fitted; `misfit` where none was."""
    fit: Fit | None = None
    """Of the prediction-error method."""
    scales: tuple[Scale, ...] = ()
    """Scales of the streams that state `scale = "fit"`."""
    not_used: tuple[str, ...] = ()
    """A sentence for each stream of which nothing was used."""
    not_rigid: str = ""
    """A sentence where what fits best is no rigid body; theta is the nearest one."""
    problem: Problem | None = field(default=None, repr=False)
    """What was fitted, of the prediction-error method."""

    @property
    def disturbance(self) -> float:
        """Of the white torque about each base axis that stands for what the model lacks
        [N m s^0.5]; 0 where it lacks nothing."""
        return 0.0 if self.fit is None else float(np.sqrt(self.fit.innovations.intensity))

    @property
    def doubt(self) -> str:
        """Why half widths are no 95 % intervals; empty where they are. A torque that stands for
        what the model lacks explains no misfit of one sensor or one clock."""
        total, *streams = self.unexplained or (None,)
        worst = max(
            (stream for stream in streams if stream.strays),
            key=lambda item: item.chi2_per_sample,
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
    """Input of every method."""

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
    problem, result, misfit, unexplained = _fitted(base, full, scaled, scales)
    factors = scales_of(result, scales, scaled)
    for _ in range(ROUNDS if scales else 0):
        if not all(scale.known for scale in factors):
            # nothing tells them: as guessed, so that the rest may be told under that guess
            problem, result, misfit, unexplained = _fitted(base, full, scaled, ())
            factors = as_taken(factors, scaled)
            break
        change, settled = change_of(result, factors)
        if settled:
            break
        scaled = [log.by({n: f for n, f in change.items() if n in log.factor}) for log in scaled]
        problem, result, misfit, unexplained = _fitted(base, full, scaled, scales, result.at.theta)
        factors = scales_of(result, scales, scaled)
    covariance, quantile = result.covariance()
    motions = [motion_of(log.recording, platform) for log in scaled]
    half = quantile * np.sqrt(np.diag(covariance))
    nearest = nearest_body(full, result.at.theta, covariance)
    return Identification(
        OURS,
        platform,
        tuple(log.recording for log in scaled),
        full,
        nearest.theta,
        covariance,
        quantile,
        excitation_of(motions, full, covariance, quantile),
        (*not_excited(full, result.at.theta, half), *scale_unknown(factors), *ground.unseen),
        misfit,
        unexplained,
        result,
        factors,
        ground.not_used,
        nearest.sentence,
        problem,
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
) -> tuple[Problem, Fit, tuple[Misfit, ...], tuple[Misfit, ...]]:
    """Fit the base by prediction error from `theta`, else from what the momentum says; from the
    machine as stated, where that start loses the motion; and where that does, too, from where a
    motion leads that may stray from the model."""
    logs = [log.recording for log in scaled]
    pairs = [(log, motion_of(log, base.machine.platform)) for log in logs]
    thetas = [base.as_stated] if theta is None else [theta]
    if theta is None:
        first = first_theta(plain, momentum_fit(pairs, plain))
        first_guess = np.concatenate([first, base.as_stated[len(first) :]])
        thetas = thetas if np.array_equal(first_guess, base.as_stated) else [first_guess, *thetas]
    bodies = [body_of(base.machine, log, motion) for log, motion in pairs]
    problem, biases = Problem(bodies, base, scales), [first_biases(body) for body in bodies]
    tries: list[tuple[Fit, Unknowns]] = []
    while thetas and not (tries and tries[-1][0].converged):
        start = problem.start(thetas.pop(0), biases)
        tries.append((fit(problem, start), start))
    result, start = min(tries, key=lambda item: item[0].innovations.cost)
    strayed = None
    if not result.converged and not _misfit(problem, result)[0].is_noise:
        strayed = fit_disturbed(problem, result, start)
        again = fit(problem, strayed.at) if strayed.converged else result
        result = again if again.converged else result
    if rings(base.machine):
        problem, result = along_what_rings(problem, result)
    misfit = _misfit(problem, result)
    # noise of coarse sensors hides a torque that the path does not
    disturbed = fit_disturbed(problem, result, start) if result.converged else (strayed or result)
    if strayed is not None and strayed.innovations.cost < disturbed.innovations.cost:
        disturbed = strayed
    unexplained = _misfit(problem, disturbed) if disturbed.innovations.intensity else misfit
    return problem, disturbed, misfit, unexplained


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


def _misfit(problem: Problem, result: Fit) -> tuple[Misfit, ...]:
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    variance: dict[str, float] = {}
    for body, rows in zip(problem.bodies, result.innovations.residuals_of_logs(), strict=True):
        for output, values in zip(body.outputs, body.cells.gather(rows), strict=True):
            if not output.scatters:
                continue
            name = output.stream
            squares[name] = squares.get(name, 0.0) + float(np.sum(np.square(values)))
            counts[name] = counts.get(name, 0) + values.size
            # An estimated noise goes with the samples that it comes from.
            unsure = 1.0 if output.stated else float(np.mean(1.0 / output.worth - 1.0))
            variance[name] = variance.get(name, 0.0) + 2.0 * values.size * unsure
    fitted = result.innovations.columns.shape[1] + sum(s.width for s in result.at.starts)
    total = sum(counts.values())
    parts = [("all", sum(squares.values()), total, sum(variance.values()))]
    parts += [(name, squares[name], counts[name], variance[name]) for name in squares]
    misfits: list[Misfit] = []
    for name, square, count, spread in parts:
        freedom = max(count - fitted * count / total, 1.0)
        half = NORMAL * float(np.sqrt(spread)) / freedom
        misfits.append(Misfit(name, square / freedom, 1.0 - half, 1.0 + half))
    return tuple(misfits)


def calibrated(recording: Recording, platform: Platform) -> Recording:
    """The log without samples that say nothing, its scales found; `repairs` says so.

    Raises:
        UsageError: a stream has `scale = "fit"` and the log does not tell the scale.
    """
    checked = usable(in_order_of(platform, recording), platform)
    if not sought(checked):
        return checked
    identification = identify([checked], platform)
    notes: list[str] = []
    for scale in identification.scales:
        if not scale.known:
            raise UsageError(
                f'{scale.stream} has `scale = "fit"`, and this log does not tell the scale; state '
                "it in log.toml"
            )
        notes.append(
            f"{scale.stream} was scaled by {scale.value:.3g} {scale.unit}, as the fit found it "
            f"({scale.low:.3g} to {scale.high:.3g})"
        )
    # the identification may have taken a log with pauses as several
    guess = first_scaled(checked, platform)
    scaled = guess.by(
        {s.stream: s.value / guess.factor[s.stream] for s in identification.scales}
    ).recording
    streams = {**checked.streams, **{s.stream: scaled[s.stream] for s in identification.scales}}
    facts = scaled.provenance
    known = {n: {**f, "fit_scale": False} for n, f in dict(facts["streams"]).items()}
    return replace(
        checked,
        streams=streams,
        provenance={**facts, "streams": known},
        repairs=(*checked.repairs, *notes),
    )


FORMS = ("torque", "momentum", "energy")
SHIFTS = (1, 2, 3)


def identify_by_all(
    recordings: Sequence[Recording],
    platform: Platform,
    settings: Settings | None = None,
    *,
    physical: bool = False,
) -> Mapping[str, Identification | TwinError]:
    """By every method, in each form and with each shift; where one cannot, why.

    Args:
        recordings: at least one, as for `identify`.
        platform: the machine, as stated.
        settings: the filter's corner and the forgetting.
        physical: give the nearest rigid bodies.

    Raises:
        TwinError: not even prediction-error can.
    """
    chosen, ground = settings or Settings(), ground_of(recordings, platform)
    result: dict[str, Identification | TwinError] = {}
    for method in METHODS:
        for variant in _variants(method, chosen):
            try:
                item = by_method(ground, method, variant, physical=physical)
            except TwinError as problem:
                if not result:
                    raise
                item = problem
            result[variant.named(method)] = item
    return result


def _variants(method: str, settings: Settings) -> list[Settings]:
    if method not in FORMS:
        return [settings]
    shifts = (0, *SHIFTS) if method == "momentum" else (0,)
    return [
        replace(settings, form=form, shift=shift)
        for shift in shifts
        for form in ("integrated", "natural")
        # without differences there is but one form
        if form == "integrated" or shift or method != "momentum"
    ]
