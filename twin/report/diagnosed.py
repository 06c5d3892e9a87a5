"""A diagnosis in sentences, with the next experiment."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin.comparison.explanation import FreeRun
from twin.diagnosis import Diagnosis
from twin.diagnosis.cause import Cause, Equation
from twin.diagnosis.diagnosis import crowded, foretells_nothing, ordinary, strays
from twin.diagnosis.experiment import Experiment
from twin.diagnosis.extension import Validation
from twin.diagnosis.laws import TORQUE
from twin.diagnosis.pushes import PushInterval
from twin.diagnosis.residual_test import ResidualTest
from twin.identification.excitation import not_excited
from twin.identification.prediction_error import NORMAL
from twin.platform import beyond_stated, taken_as_at_rest
from twin.predict.columns import amplitudes
from twin.report.words import MEANINGFUL, NO_INTERVALS, pair, quiet_sentences
from twin.signals import stream_named
from twin.units import as_precise, fitting, listed, printed, three_digits

LAG = "clock_lag"


def common_clock_sentences(diagnosis: Diagnosis) -> list[str]:
    """Which clock it is, theirs or that of all else; nothing where the lags differ."""
    late = [cause for cause in diagnosis.causes if cause.effect.name == LAG]
    if len(late) < 2 or not _equal(late):
        return []
    streams = [cause.effect.target for cause in late]
    lag = float(np.mean([cause.effect.values[0] for cause in late]))
    others = sorted(_in_use(diagnosis) - set(streams))
    if not others:
        return []
    way, other = ("late", "early") if lag > 0.0 else ("early", "late")
    size = printed(abs(lag), "s")
    return [
        f"{listed(streams)} are {way} by the same time, {size}: rather than {len(streams)} clocks "
        f"it is one that is off, theirs, or that of {listed(others)}, {other} by {size}."
    ]


def _equal(late: Sequence[Cause]) -> bool:
    """Whether their intervals have a time in common."""
    lags = np.array([cause.effect.values[0] for cause in late])
    halves = np.array([cause.half_widths[0] for cause in late])
    return bool((lags - halves).max() <= (lags + halves).min())


def _in_use(diagnosis: Diagnosis) -> set[str]:
    """What the logs are predicted with, and what of, that changes: else no clock shows."""
    return {
        name
        for body in diagnosis.explained.bodies
        for name in (*body.inputs.used, *(output.stream for output in body.outputs))
        if name in body.recording and np.ptp(body.recording[name].value, axis=0).any()
    }


_FRICTION = (
    "let it turn fast and run down to rest, for the laws differ in how the torque falls with rate"
)
_CLOCK = "mark one event in both streams, or log for longer: a drift grows and a lag does not"

OUT_OF_REACH = {
    "residual_dipole": "turn, reverse or switch off the magnetic field, which moves the dipole's "
    "torque and no other",
    "bearing_swirl_torque": "change the pressure of the air, which changes the bearing's own "
    "torque and no other",
    "bearing_viscous_friction": _FRICTION,
    "bearing_coulomb_friction": _FRICTION,
    "aerodynamic_drag": _FRICTION,
    "harness_stiffness": "take the cable off",
    "room_draft": "shield the machine from the room's air",
    "clock_lag": _CLOCK,
    "clock_drift": _CLOCK,
    "sensor_lag": "move it fast and slowly by turns: a filter delays the fast motion otherwise",
    "gyro_scale_factor": "turn it by an angle that is known otherwise",
    "attitude_misalignment": "turn it about one axis at a time before a reference outside of it",
    "attitude_reference_tilt": "set a level before what measures the attitude, or turn the machine "
    "by half a turn about the vertical: what is fixed in the room stays",
    "wheel_misalignment": "spin up one wheel at a time, the others at rest",
    "wheel_inertia_error": "mount a body of known inertia",
}
"""What no run of the library does, by the cause that it sets apart."""


def experiment_sentence(experiment: Experiment) -> str:
    """What to do next, what it should bring, and beside what."""
    nearest, split = _smallest(experiment.splits)
    _, again = _smallest(experiment.repeated)
    bar = f"where {experiment.needed:g} suffices"
    if experiment.enough:
        return (
            f"To distinguish them, fly on the machine the run that this command simulates: "
            f"{experiment.command}. With its log added to these, the evidence of {nearest}, the "
            f"nearest, should be {split:.1f} lower, {bar}; the same logs repeated would make it "
            f"{again:.1f}."
        )
    if again >= experiment.needed:
        return (
            f"To distinguish them, repeat the same logs: the evidence of each should then be lower "
            f"by at least {again:.1f}, {bar}; no other run that was tried does as well "
            f"({split:.1f})."
        )
    close = [label for label, size in experiment.splits.items() if size < experiment.needed]
    ways = dict.fromkeys(_way(experiment, label) for label in close)
    said = "; ".join(way for way in ways if way)
    return (
        f"No run that was tried distinguishes them: with the best, {experiment.command}, the "
        f"evidence of {nearest} would be {split:.1f} lower, {bar}; with the same logs repeated "
        f"{again:.1f}." + (f" What could distinguish them: {said}." if said else "")
    )


def experiment_document(experiment: Experiment) -> dict[str, Any]:
    """For `--json`; the command is null where no run splits the ties."""
    return {
        "command": experiment.command if experiment.enough else None,
        "splits": dict(experiment.splits),
        "repeated": dict(experiment.repeated),
        "sentence": experiment_sentence(experiment),
    }


def _smallest(sizes: Mapping[str, float]) -> tuple[str, float]:
    return min(sizes.items(), key=lambda size: size[1])


def _way(experiment: Experiment, label: str) -> str:
    """To set a tied cause, or else the one named in its place, apart."""
    names = [label.partition(":")[0], *(item.partition(":")[0] for item in experiment.named)]
    return next((OUT_OF_REACH[name] for name in names if name in OUT_OF_REACH), "")


FAR = 0.5
"""Of a mean principal moment, or of the whole mass 1 mm off: a refitted base that moved more."""
LACKS = "not possible here: the platform has no"
"""Why a cause is of no interest on a machine: of that nothing is said."""
SHOWN = 5
"""Causes that were tried and rejected of which the text tells."""


def diagnosed(diagnosis: Diagnosis) -> list[str]:
    """All that is to be said, the verdict first."""
    said = [finding.sentence for finding in diagnosis.conventions]
    said += taken_as_at_rest(diagnosis.recordings, diagnosis.platform)
    said += beyond_stated(diagnosis.recordings, diagnosis.platform)
    said.append(verdict_sentence(diagnosis))
    said += [] if diagnosis.intervals_hold else [NO_INTERVALS]
    said += [push_sentence(diagnosis.pushes)] if diagnosis.pushes else []
    said += cause_sentences(diagnosis)
    said += common_clock_sentences(diagnosis)
    said += wander_sentences(diagnosis)
    if diagnosis.next_experiment is not None:
        said.append(experiment_sentence(diagnosis.next_experiment))
    if diagnosis.equation is not None:
        said.append(equation_sentence(diagnosis.equation))
    if diagnosis.explained.follows:
        said += _residual_lines(diagnosis.residual_test)
        said += quiet_sentences(diagnosis.explained.account.misfits)
    said.append(_gain(diagnosis))
    said += _base(diagnosis)
    said += _rejected(diagnosis)
    said += could_show(diagnosis)
    said += [finding.sentence for finding in diagnosis.noise]
    said += _untested(diagnosis.not_asked)
    said += [f"Repaired on reading: {r}." for log in diagnosis.recordings for r in log.repairs]
    return said


def push_sentence(pushes: Sequence[PushInterval]) -> str:
    """When something happened that no model has."""
    when = ", ".join(
        f"from {push.start:.2f} to {push.stop:.2f} s of {push.source}" for push in pushes
    )
    return (
        f"An external torque acted on the machine {when}; these times are excluded from all other "
        "results here."
    )


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict, as a person says it: causes with their sizes."""
    names = listed([_with_size(cause) for cause in diagnosis.causes])
    if diagnosis.pushes:
        times = "once" if len(diagnosis.pushes) == 1 else f"{len(diagnosis.pushes)} times"
        rest = f"the model lacks {names}; with it" if names else "with the model as it is,"
        return (
            f"Unexplained: {times} something happened that no cause explains; for the rest of the "
            f"time, {rest} the residual is noise."
        )
    noise = listed(["noise", *wanders(diagnosis)])
    if diagnosis.verdict == "healthy":
        return (
            f"Healthy: the residual of the model is the sensors' {noise}, and none of the "
            f"{sum(item.could_show for item in diagnosis.tried)} causes that these logs could "
            "show explains any of it."
        )
    if diagnosis.verdict == "explained":
        return f"Explained: the model lacks {names}; with it the residual is {noise}."
    if diagnosis.verdict == "ambiguous":
        return (
            f"Ambiguous: the model lacks {names}, or a cause that these logs do not distinguish "
            f"from it; with it the residual is {noise}."
        )
    rest = listed(wanders(diagnosis))
    if diagnosis.verdict == "explained in part":
        carry = f"{names} {_carry(diagnosis)}"
        share = f"{100.0 * diagnosis.carried:.0f} %"
        if diagnosis.explained.follows:
            return (
                f"Explained in part: {carry} {share} of what the model misses; the rest is {rest}, "
                "more than usual rooms and sensors have."
            )
        length = max(body.grid.length for body in diagnosis.explained.bodies)
        size = np.sqrt(diagnosis.residual_test.chi2)
        left = "are predicted to within the noise"
        if not diagnosis.intervals_hold:
            left = f"are still missed by {size:.2g} times the noise"
        return (
            f"Explained in part: {carry} {share} of what the model misses; "
            "no cause makes the motion follow the model for longer, and segments of "
            f"{length:.2g} s {left}."
        )
    if not ordinary(diagnosis.wander):
        best = f", beside {names}," if names else ""
        return (
            f"Unexplained: the model lacks{best} {rest}, more than usual rooms and sensors have, "
            "and no cause of the catalogue explains it."
        )
    if not diagnosis.explained.follows:
        size = np.sqrt(diagnosis.residual_test.chi2)
        best = f"most is explained by {names}, but " if names else ""
        apart = (
            "each segment by itself is predicted to within the noise, but the motion does not "
            "continue from one segment to the next as the model does."
            if size <= 1.0
            else f"even single segments are missed by {size:.2g} times the noise."
        )
        return f"Unexplained: {best}no cause makes the motion follow the model: {apart}"
    if diagnosis.equation is None and crowded(diagnosis.explained.effects):
        return (
            f"Unexplained: {names} together explain most, but so many causes at once rather "
            "replace one that the catalogue does not have."
        )
    if diagnosis.equation is None and foretells_nothing(
        diagnosis.explained.effects, diagnosis.held_out
    ):
        return (
            f"Unexplained: these logs are explained best by {names}, which does not improve the "
            "prediction of held-out time."
        )
    if diagnosis.equation is None and strays(diagnosis.held_out):
        best = f"these logs are explained best by {names}, but " if names else ""
        return (
            f"Unexplained: {best}the prediction of held-out time is worse than that of any true "
            "model."
        )
    beside = f" beside {names}" if names else ""
    return f"Unexplained: the model lacks something{beside} that the catalogue does not have."


def wanders(diagnosis: Diagnosis) -> list[str]:
    """Noise beside the sensors' own in words: `a torque of 0.03 mN m rms that wanders over 3 s`."""
    said: list[str] = []
    if diagnosis.wander.torque is not None:
        item = diagnosis.wander.torque
        size = printed(item.rms, "N m")
        said.append(f"a torque of {size} rms that wanders over {item.time:.2g} s")
    for stream, item in diagnosis.wander.errors:
        unit = "rad" if stream == "attitude" else stream_named(stream).unit
        size = printed(item.rms, unit)
        said.append(f"an error of {stream} of {size} rms that wanders over {item.time:.2g} s")
    for stream, factor in diagnosis.wander.scales:
        said.append(f"white noise of {stream} {factor:.2g} times as large as its samples' scatter")
    return said


def wander_sentences(diagnosis: Diagnosis) -> list[str]:
    """How much of what the model misses the causes carry beside what wanders."""
    if (
        not diagnosis.wander.wanders
        or not diagnosis.causes
        or diagnosis.verdict == "explained in part"
    ):
        return []
    names = listed([cause_name(cause) for cause in diagnosis.causes])
    return [
        f"{names} {_carry(diagnosis)} {100.0 * diagnosis.carried:.0f} % of what "
        "the model misses, what "
        "wanders the rest; every interval allows for it."
    ]


def _carry(diagnosis: Diagnosis) -> str:
    return "carries" if len(diagnosis.causes) == 1 else "carry"


def cause_name(cause: Cause) -> str:
    """`a clock_lag of wheel_speed`."""
    of = f" of {cause.effect.target}" if cause.effect.target else ""
    return f"{cause.effect.name}{of}"


def _with_size(cause: Cause) -> str:
    """`bearing_viscous_friction (0.2 N m s, 0.198 to 0.202)`; of a vector the name alone."""
    name, *others = cause.effect.names
    if others or not np.isfinite(cause.beside[0]):
        return cause_name(cause)
    size = _component(cause, 0).removeprefix(f"{name} ")
    return f"{cause_name(cause)} ({size.replace(' (', ', ').rstrip(')')})"


def cause_sentences(diagnosis: Diagnosis) -> list[str]:
    """Of each cause; no confidence where something without a name is at work."""
    return [cause_sentence(cause, sure=diagnosis.intervals_hold) for cause in diagnosis.causes]


def cause_sentence(cause: Cause, *, sure: bool = True) -> str:
    """Its numbers, how sure it is, and what could be meant instead.

    Args:
        cause: of a diagnosis.
        sure: whether its confidence is one; beside what has no name it is a count of other logs.
    """
    leaning = cause.free & np.isnan(cause.half_widths)
    taken = ~cause.free & ~amplitudes(cause.effect) & leaning.any()
    parts = [
        f"{name} not seen" if away else _component(cause, i)
        for i, (name, away) in enumerate(zip(cause.effect.names, ~cause.free & ~taken, strict=True))
        if not (leaning[i] or taken[i])
    ]
    if leaning.any():
        beside = ", ".join(_component(cause, i) for i in np.flatnonzero(leaning).tolist())
        with_it = ", ".join(_component(cause, i) for i in np.flatnonzero(taken).tolist())
        how = (
            f"taking {with_it}, which no log identifies"
            if with_it
            else "as the other causes are taken"
        )
        parts.append(f"{how}: {beside}")
    ties = ", ".join(f"{tie.label} ({tie.behind:.1f} behind)" for tie in cause.ties)
    instead = f" These logs do not distinguish it from {ties}." if ties else ""
    confidence = f", confidence {100.0 * cause.confidence:.3g} %" if sure else ""
    return (
        f"{cause_name(cause)}: {', '.join(parts)}; evidence {cause.evidence:.0f}"
        f"{confidence}.{instead}"
    )


def _component(cause: Cause, index: int) -> str:
    """`lag 0.171 s (0.168 to 0.174)`."""
    units = [known.unit for known in cause.effect.parameters() for _ in range(known.size)]
    value, half = float(cause.effect.values[index]), float(cause.beside[index])
    factor, unit = fitting(np.nanmax([abs(value), half]), units[index])
    shown = "" if unit == "1" else f" {unit}"
    value, half = value / factor, half / factor
    text = f"{cause.effect.names[index]} {as_precise(value, half)}{shown}"
    if np.isnan(half):
        return text
    low, high = (as_precise(value + sign * half, half) for sign in (-1.0, 1.0))
    return f"{text} ({low} to {high})"


def equation_text(equation: Equation) -> str:
    """`torque_x = 3.1 rate_x rate_z`, `error of gyro_x = 0.02 gyro_y`, one a column, SI."""
    lines: dict[str, list[str]] = {}
    for law, value in zip(equation.laws, equation.coefficients.tolist(), strict=True):
        product = " ".join(law.factors)
        what = f"{law.what}_{law.column}"
        left = what if law.what == TORQUE else f"error of {what}"
        lines.setdefault(left, []).append(f"{value:+.3g} {product}".rstrip())
    return "; ".join(f"{left} = {' '.join(terms)}" for left, terms in lines.items())


def equation_sentence(equation: Equation) -> str:
    """The law without a name, with its intervals."""
    ends = ", ".join(
        f"{value - half:.3g} to {value + half:.3g} [{law.unit}]"
        for law, value, half in zip(
            equation.laws, equation.coefficients, equation.half_widths, strict=True
        )
    )
    return (
        f"It looks like {equation_text(equation)} (SI, body axes; coefficients {ends}): "
        f"evidence {equation.evidence:.0f} beyond the best that the catalogue offers."
    )


def _residual_lines(test: ResidualTest) -> list[str]:
    """What no cause takes."""
    if test.torque_chance < test.noise_chance:
        what = (
            f"a free torque gains {test.torque_gain:.0f} with {test.freedom:.0f} degrees of freedom"
        )
        chance = test.torque_chance
    else:
        what, chance = f"that of {test.where} is the largest", test.noise_chance
    return [f"Residual: {what}; the probability of it by noise alone is {chance:.2g}."]


def _gain(diagnosis: Diagnosis) -> str:
    gain = diagnosis.held_out
    named = bool(diagnosis.causes) or diagnosis.equation is not None
    runs = _free_runs(diagnosis.free_runs, first_of(diagnosis))
    if named and np.isnan(gain.log_likelihood):
        return (
            "The log is too short to hold a part of it out of the fit, so the causes are tested on "
            "no other time; record another run for --validate."
            f"{runs}"
        )
    if not diagnosis.explained.follows and not diagnosis.causes:
        return "No cause is added, so there is no gain on held-out time."
    if not diagnosis.explained.follows:
        return (
            f"On held-out segments the log likelihood rises by {gain.log_likelihood:.0f} nats, "
            "each segment weighted by its scatter."
            f"{runs}"
        )
    if diagnosis.equation is None and not diagnosis.explained.effects:
        band = f"; a true model stays within {gain.low:.3f} to {gain.high:.3f}"
        band = "" if np.isnan(gain.low) else band
        scatters = "The causes only make a sensor scatter more. " if named else ""
        left = diagnosis.residual_test.chi2
        return f"{scatters}Chi-square of the innovations {left:.4f} a sample{band}."
    return (
        f"On held-out time the log likelihood rises by {gain.log_likelihood:.0f} nats; chi-square "
        f"{gain.before:.4f} to {gain.after:.4f} a sample, where a true model stays within "
        f"{gain.low:.3f} to {gain.high:.3f}."
        f"{runs}"
    )


def first_of(diagnosis: Diagnosis) -> str:
    """What free runs and curves are of, where there are several logs or one that has gaps."""
    return " of the first stretch of log" if len(diagnosis.explained.bodies) > 1 else ""


def _free_runs(result: Mapping[float, FreeRun | None], of: str = "") -> str:
    runs = [
        f"{horizon:g} s: {np.degrees(run.errors[0]):.2g} to {np.degrees(run.errors[1]):.2g} deg "
        f"(perfect {np.degrees(run.errors[2]):.2g}){_places(run)}"
        for horizon, run in result.items()
        if run is not None and run.errors[1] < MEANINGFUL
    ]
    return f" Free runs{of}, before and after: {'; '.join(runs)}." if runs else ""


def _places(run: FreeRun) -> str:
    if run.places is None:
        return ""
    before, after, perfect = (1e3 * error for error in run.places)
    return f" and {before:.3g} to {after:.3g} mm (perfect {perfect:.2g})"


def _base(diagnosis: Diagnosis) -> list[str]:
    base, theta = diagnosis.explained.base, diagnosis.explained.at.theta
    half = NORMAL * np.sqrt(np.diag(diagnosis.explained.covariance))[: len(theta)]
    stated = base.as_stated
    parts = [
        f"{name} {pair(float(v), float(h))} ({three_digits(float(s))}) {unit}"
        for name, v, h, s, unit in zip(base.names, theta, half, stated, base.units, strict=True)
    ]
    if not parts:
        return ["The base is fixed as stated: these logs do not identify it."]
    said = ["The base, refitted (as stated): " + ", ".join(parts) + "."]
    if base.held_moment:
        said.append(
            f"{base.held_moment} is fixed as stated, because these logs do not identify the size "
            "of J: every torque, J and m r share a factor with it."
        )
    if base.machine.platform.base.falls:
        said.append("J is about the centre of mass, because the body falls freely.")
    body = np.arange(len(theta)) < len(theta) - len(base.joints)
    far = body & (np.abs(theta - stated) - half > FAR * base.scale)
    if far.any():
        names = ", ".join(name for name, item in zip(base.names, far, strict=True) if item)
        said.append(
            f"Mind: {names} had to move far from what platform.toml states. If that is no "
            "surprise, state it there; else it is another machine, or a torque or a speed of "
            "another size than recorded: a base that grows does what a smaller torque would."
        )
    # what no motion of a joint can show is no news about a log
    never = len(base.not_excited)
    left = not_excited(base, theta, half)[: -never or None]
    return [*said, f"These logs leave open: {'; '.join(left)}."] if left else said


def _rejected(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.tried or diagnosis.verdict == "healthy":
        return []
    alone = sorted(diagnosis.tried, key=lambda tried: -tried.alone)[:SHOWN]
    if not diagnosis.explained.follows:
        # what columns of independent segments predict is not what fits show
        return ["Tried and rejected: " + ", ".join(item.label for item in alone) + "."]
    parts = [
        f"{item.label} (alone {item.alone:.0f}, beside these {item.evidence:.0f})" for item in alone
    ]
    return ["Tried and rejected, evidence in brackets: " + ", ".join(parts) + "."]


def could_show(diagnosis: Diagnosis) -> list[str]:
    """From which size on each cause would have been found, a line an effect; of healthy logs."""
    if diagnosis.verdict != "healthy":
        return []
    sizes: dict[str, list[str]] = {}
    for item in sorted(diagnosis.tried, key=lambda item: item.label):
        if item.could_show:
            name, _, target = item.label.partition(":")
            parts = [
                printed(size, unit) if np.isfinite(size) else "never"
                for size, unit in zip(item.detectable.tolist(), item.units, strict=True)
            ]
            sizes.setdefault(name, []).append(f"{target} {' / '.join(parts)}".lstrip())
    head = "Sizes from which each cause, alone, would be detected in 95 of 100 such logs:"
    said = [head] if sizes else []
    said += [f"  {name}: {', '.join(targets)}" for name, targets in sizes.items()]
    never = [item.label for item in diagnosis.tried if not item.could_show]
    if never:
        said.append(f"Not detectable at any size: {', '.join(never)}.")
    return said


def _untested(why: Mapping[str, str]) -> list[str]:
    groups: dict[str, list[str]] = {}
    for label, reason in why.items():
        if not reason.startswith(LACKS):
            groups.setdefault(reason, []).append(label)
    return [f"{', '.join(labels)}: {reason}." for reason, labels in groups.items()]


def validated(gain: Validation) -> str:
    """The gain on a held-out log."""
    read = [finding.sentence for finding in gain.conventions]
    read += [f"Repaired on reading: {repair}." for repair in gain.repairs]
    worth = (
        f"On the held-out log the log likelihood rises by {gain.log_likelihood:.0f} nats, "
        f"chi-square {gain.before:.4f} to {gain.after:.4f} a sample.{_free_runs(gain.free_runs)}"
    )
    return " ".join((*read, worth))
