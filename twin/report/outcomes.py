"""Runs, balancings, gyro comparisons and identifications in lines for a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.budget import SINGULAR
from twin.formation import FormationRun
from twin.identification import Identification, Misfit
from twin.interval import Interval
from twin.loop import Outcome
from twin.platform import Platform, beyond_stated, taken_as_at_rest
from twin.predict.base import NAMES, hinge_axis
from twin.procedures import Statement
from twin.recording import Recording
from twin.report.words import pair
from twin.strapdown import FAULTS, GyroComparison
from twin.strapdown.compare import GyroError
from twin.units import fitting, printed, three_digits

_SIGMAS_95 = 1.96
"""Half width of a 95 % interval, in sigmas."""


def flown(platform: Platform, outcome: Outcome, row: Mapping[str, Any], settle: float) -> list[str]:
    """What happened, in words a lab uses: degrees and newton metre seconds.

    Args:
        platform: the machine.
        outcome: how the loop ended.
        row: its metrics, by name.
        settle: from which on tracking counts [s].
    """
    end = f"{outcome.ended.value} after {outcome.duration:g} s"
    lines = [f"{end}: {outcome.reason}" if outcome.reason else end]
    if "tracking_error_rms_rad" in row:
        rms, worst = np.degrees([row["tracking_error_rms_rad"], row["tracking_error_max_rad"]])
        lines.append(
            f"tracking error {rms:.3g} deg rms, {worst:.3g} deg at worst, from {settle:g} s on"
        )
    if "place_error_rms_m" in row:
        rms, worst = row["place_error_rms_m"], row["place_error_max_m"]
        lines.append(
            f"place error {1e3 * rms:.3g} mm rms, {1e3 * worst:.3g} mm at worst, "
            f"from {settle:g} s on"
        )
    if "tilt_max_rad" in row:
        most = row["tilt_max_rad"]
        touched = platform.pitch_stop is None and most >= platform.tilt_limit
        stop = ", where it touched its stop" if touched else ""
        lines.append(f"largest tilt {np.degrees(most):.3g} deg{stop}")
    peaks = row.get("wheel_momentum_max_N_m_s", ())
    if "wheel_speed" not in platform.sensors:
        # nobody has seen them
        peaks = ()
    for wheel, peak in zip(platform.wheels, peaks, strict=bool(len(peaks))):
        lines.append(f"{wheel.name} held up to {peak:.3g} of {wheel.momentum_limit:g} N m s")
    if np.isfinite(row.get("wheel_saturated_at_s", np.nan)):
        lines.append(f"a wheel was saturated from {row['wheel_saturated_at_s']:.1f} s on")
    if "gyro_margin_min" in row:
        since = row["gyro_near_singular_at_s"]
        near = f", below {SINGULAR:g} from {since:.1f} s on" if np.isfinite(since) else ""
        lines.append(
            f"gyros held up to {row['gyro_momentum_max_N_m_s']:.3g} N m s; their least margin to a "
            f"singular state was {row['gyro_margin_min']:.2g}{near}"
        )
    lines += estimated(platform, outcome)
    lines += outcome.remarks
    timing = outcome.timing
    if timing.lateness:
        p50, p99, most = (timing.lateness_at(p) * 1e3 for p in (50.0, 99.0, 100.0))
        own50, own99, longest = (timing.duration_at(p) * 1e3 for p in (50.0, 99.0, 100.0))
        lines.append(
            f"ticks came {p50:.2f} ms late (median), {p99:.2f} ms (99 %), {most:.2f} ms at most; "
            f"{timing.overruns} overruns in {timing.ticks} ticks"
        )
        lines.append(
            f"each took {own50:.2f} ms (median), {own99:.2f} ms (99 %), {longest:.2f} ms at most, "
            f"of {platform.tick * 1e3:g} ms"
        )
    return lines


def flown_together(result: FormationRun) -> list[str]:
    """What happened to each machine of a run of several, and between them."""
    lines: list[str] = []
    for name, run in result.runs.items():
        told = flown(run.platform, run.outcome, run.metrics, run.settle)
        lines += [f"{name}: {line}" for line in told]
    for (name, other), row in result.relative.items():
        settle = result.runs[name].settle
        rms, worst = np.degrees([row["attitude_rms_rad"], row["attitude_max_rad"]])
        line = (
            f"{name} relative to {other}: {rms:.3g} deg rms, {worst:.3g} deg at worst, "
            f"from {settle:g} s on"
        )
        if "distance_min_m" in row:
            line += f"; {row['distance_min_m']:.3g} to {row['distance_max_m']:.3g} m away"
        lines.append(line)
    return lines


def estimated(platform: Platform, outcome: Outcome) -> list[str]:
    """What the estimator stated of the first run in the end, with 95 % intervals."""
    lines: list[str] = []
    for name, stated in outcome.quantities.items():
        unit, factor = stated.unit, 1.0
        if unit == "kg m":
            unit, factor = "m", 1.0 / platform.mass
        value, half = (
            np.zeros_like(stated.sigma[0]) if stated.value is None else factor * stated.value[0],
            _SIGMAS_95 * factor * stated.sigma[0],
        )
        largest = float(np.abs(np.concatenate([value, half])).max())
        scale, shown = (1e-6, "um") if unit == "m" else fitting(largest, unit)
        called = "CM from CR" if name == "center_of_mass_offset" else name.replace("_", " ")
        if stated.value is None:
            known = ", ".join(three_digits(item / scale) for item in half)
            known = f"({known})" if len(half) > 1 else known
            lines.append(f"estimated {called} is known within {known} {shown} (95 %)")
            continue
        known = ", ".join(pair(v / scale, h / scale) for v, h in zip(value, half, strict=True))
        known = f"({known})" if len(half) > 1 else known
        lines.append(f"estimated {called} {known} {shown} (95 %)")
    return lines


def balanced(statement: Statement, platform: Platform, target: float) -> list[str]:
    """Residual offset and torque with 95 % intervals, and where the masses stand."""
    per_um = 1e6 / platform.mass
    offset = ", ".join(
        pair(axis.value * per_um, 0.5 * (axis.high - axis.low) * per_um)
        for axis in statement.center_of_mass_offset
    )
    whole, plane = statement.residual_torque, statement.residual_torque_in_plane
    verdict = "keeps" if whole.high <= target else "misses"
    stands = ", ".join(
        f"{stage.name} {position * 1e3:.4g} mm"
        for stage, position in zip(platform.stages, statement.stage_position, strict=True)
    )
    lines = [
        "left, with 95 % intervals:",
        f"  CM from CR ({offset}) um of {platform.mass:g} kg",
        f"  gravity torque at the worst attitude {torque_words(whole)}, which {verdict} the target "
        f"of {printed(target, 'N m')}",
        f"  of the level body {torque_words(plane)}",
        "  95 % of the torque observed in free float stay below "
        f"{printed(statement.residual_torque_observed, 'N m')}, drag and gyro noise included",
        f"  masses at {stands}",
    ]
    misfit = statement.misfit
    if not misfit.is_noise:
        lines.append(
            f"  The model misses more than noise of this (chi2 per sample "
            f"{misfit.chi2_per_sample:.3f}, a true one keeps {misfit.low:.3f} to "
            f"{misfit.high:.3f}): the intervals hold only if what it lacks is a random torque. "
            "`twin diagnose` names causes."
        )
    return lines


def torque_words(interval: Interval) -> str:
    """`5.05 uN m (4.81 to 5.31)`: near zero an interval is not the same to either side."""
    scale, unit = fitting(interval.value, "N m")
    value, low, high = (
        three_digits(number / scale) for number in (interval.value, interval.low, interval.high)
    )
    return f"{value} {unit} ({low} to {high})"


TIES = {
    "gyro_misalignment": "whether the gyro's or the attitude's are turned, the two do not show",
    "clock_lag": "or the attitude is early",
}


def gyro_sentences(comparison: GyroComparison) -> list[str]:
    """What is wrong with a gyro that is taken as it is, and how far that leads astray."""
    lines = [
        "The gyro compared with the attitude, without a model of the body's motion:",
        "taken as it is, its squared innovations are "
        f"{three_digits(comparison.chi2_before)} times what they are without the errors below.",
    ]
    lines += [_sentence(fault, comparison) for fault in FAULTS]
    alone = [
        f"{printed(raw, 'rad')} in {three_digits(horizon)} s ({printed(mended, 'rad', raw)})"
        for horizon, raw, mended in comparison.drift
    ]
    if alone:
        lines.append(f"Alone and as it is (corrected) it strays by {', '.join(alone)}, rms.")
    lines.append(
        f"The residual is noise of {printed(comparison.gyro_noise, 'rad/s')} a "
        "sample of the gyro and "
        f"of {printed(comparison.attitude_noise, 'rad')} of the attitude; intervals are 95 %."
    )
    return lines


def _sentence(fault: GyroError, comparison: GyroComparison) -> str:
    places = _places(fault)
    value, half = comparison.value[places], comparison.half_width[places]
    shown = np.isfinite(half)
    if not shown.any():
        return f"{fault.name}: the motion does not show it."
    factor, unit = fitting(float(np.abs(value[shown]).max()), fault.unit)
    if fault.unit == "1":
        factor, unit = 0.01, "%"
    numbers = ", ".join(
        f"{column}{' ' if column else ''}{three_digits(v / factor)} "
        f"({three_digits((v - h) / factor)} to {three_digits((v + h) / factor)})"
        if np.isfinite(h)
        else f"{column} unknown"
        for column, v, h in zip(fault.columns, value, half, strict=True)
    )
    text = f"{fault.name}: {fault.words} {numbers} {unit}"
    if not shown.all():
        text += " (unknown: the body hardly turns that way)"
    if not comparison.certain[places].any():
        return f"{text}: nothing significant."
    return f"{text}; {TIES[fault.name]}." if fault.name in TIES else f"{text}."


def gyro_document(source: str, comparison: GyroComparison) -> dict[str, Any]:
    """What `twin compare --json` prints of a log without a platform; SI."""
    parameters: dict[str, Any] = {}
    for fault in FAULTS:
        places = _places(fault)
        value, half = comparison.value[places], comparison.half_width[places]
        parameters[fault.name] = {
            "value": value,
            "low": value - half,
            "high": value + half,
            "unit": fault.unit,
            "columns": fault.columns,
        }
    return {
        "log": source,
        "platform": None,
        "gyro_against_attitude": {
            "parameters": parameters,
            "chi2_before": comparison.chi2_before,
            "noise": {"gyro": comparison.gyro_noise, "attitude": comparison.attitude_noise},
            "alone": [
                {"horizon": horizon, "as_it_is": raw, "corrected": mended}
                for horizon, raw, mended in comparison.drift
            ],
        },
    }


def _places(fault: GyroError) -> slice:
    first = sum(len(other.columns) for other in FAULTS[: FAULTS.index(fault)])
    return slice(first, first + len(fault.columns))


Array = NDArray[np.float64]


def identified(identification: Identification) -> list[str]:
    """The entries with their 95 % intervals, then how far to trust them."""
    logs = " and ".join(f"{_duration(log):.0f} s" for log in identification.recordings)
    together = ", fitted together" if len(identification.recordings) > 1 else ""
    lines = [
        f"{identification.platform.title} ({identification.platform.name}), "
        f"{logs} of log{together}",
        f"  by {identification.method}, {_intervals(identification)}:",
    ]
    lines += [
        f"    {line}"
        for line in (*_entries(identification), *_joints(identification), *_scales(identification))
    ]
    lines += [
        f"  {line}" for line in (*_excitation(identification), *_sentences(identification.not_used))
    ]
    lines += [
        f"  {line}" for line in taken_as_at_rest(identification.recordings, identification.platform)
    ]
    lines += [
        f"  {line}" for line in beyond_stated(identification.recordings, identification.platform)
    ]
    lines += [f"  {line}" for line in _trust(identification)]
    lines += [f"  {identification.not_rigid}"] if identification.not_rigid else []
    if identification.platform.base.falls:
        lines.append("  J is about the centre of mass, about which a body turns that falls freely.")
    lines += [f"  Not identifiable: {sentence}." for sentence in identification.not_excited]
    lines += [
        f"  Repaired on reading: {r}." for log in identification.recordings for r in log.repairs
    ]
    return lines


def _intervals(identification: Identification) -> str:
    if not identification.doubt:
        return "with 95 % intervals"
    return f"not with 95 % intervals, for {identification.doubt}; the +- know the scatter alone"


def _entries(identification: Identification) -> list[str]:
    base, platform = identification.base, identification.platform
    values = base.entries(identification.theta)
    half = identification.quantile * np.sqrt(
        np.diag(base.map @ identification.covariance @ base.map.T)
    )
    seen = np.abs(base.map).sum(axis=1) > 0.0
    mass = platform.mass
    if platform.base.kind == "planar":
        mass = float(identification.theta[0]) if base.with_mass else mass
        told = (
            pair(mass, identification.half_widths[0]) if base.with_mass else f"{mass:g} (as stated)"
        )
        lines = [f"mass  {told} kg", f"Jzz   {pair(values[2], half[2])} kg m^2 about the vertical"]
    elif platform.base.kind == "hinge":
        axis = hinge_axis(base.machine)
        if "J" in base.names:
            size = pair(identification.theta[0], identification.half_widths[0])
        else:
            size = f"{axis @ platform.inertia @ axis:.6g} (as stated)"
        lines = [f"J     {size} kg m^2 about the axis"]
    else:
        lines = [
            f"{name:<5} {pair(value, width)} kg m^2"
            for name, value, width in zip(NAMES[:6], values, half, strict=False)
        ]
    moved = _carried(identification.recordings[-1], identification)
    for place, extra in [("", np.zeros(3)), (" with the masses as the log left them", moved)]:
        if place and not extra.any():
            continue
        for i, axis in enumerate("xyz"):
            if not seen[6 + i]:
                continue
            value, width = values[6 + i] + extra[i], half[6 + i]
            if platform.base.kind == "planar":
                lines.append(
                    f"m r_{axis} {pair(value, width)} kg m"
                    f" = {pair(value / mass * 1e3, width / mass * 1e3)} mm of {mass:g} kg{place}"
                )
                continue
            lines.append(
                f"m r_{axis} {pair(value, width)} kg m"
                f" = {pair(value * platform.gravity, width * platform.gravity)} N m"
                f" = {_length(value / platform.mass, width / platform.mass)}"
                f" of {platform.mass:g} kg{place}"
            )
    return lines


def _length(value: float, width: float) -> str:
    """With half its interval, in um up to a millimetre and in mm beyond."""
    factor, unit = (1e-3, "mm") if max(abs(value), width) > 1e-3 else (1e-6, "um")
    return f"{pair(value / factor, width / factor)} {unit}"


def _joints(identification: Identification) -> list[str]:
    first = len(identification.theta) - len(identification.base.joints)
    return [
        f"{joint.name} {pair(value, width)} {joint.unit}"
        for joint, value, width in zip(
            identification.base.joints,
            identification.theta[first:],
            identification.half_widths[first:],
            strict=True,
        )
    ]


def _scales(identification: Identification) -> list[str]:
    return [
        f"scale of {scale.stream} {pair(scale.value, 0.5 * (scale.high - scale.low))} {scale.unit}"
        for scale in identification.scales
        if scale.known
    ]


def _sentences(said: Sequence[str]) -> list[str]:
    return [f"{sentence}." for sentence in said]


def _excitation(identification: Identification) -> list[str]:
    moved = identification.excitation
    rates = ", ".join(three_digits(float(np.degrees(rate))) for rate in moved.rate)
    reach = f"{three_digits(float(np.degrees(moved.reach)))} deg"
    if identification.platform.base.kind == "hinge":
        return [f"Excitation: rate {rates} deg/s rms, angle up to {reach} from its mean"]
    if identification.platform.base.kind == "planar":
        x, y, turn = moved.rate.tolist()
        return [
            f"Excitation: speed {printed(float(np.hypot(x, y)), 'm/s')} and turn "
            f"{three_digits(float(np.degrees(turn)))} deg/s rms"
        ]
    weights = " ".join(
        f"{'+-'[weight < 0.0]} {abs(weight):.1f} {name}"
        for name, weight in moved.least_known.items()
    ).removeprefix("+ ")
    return [
        f"Excitation: rate {rates} deg/s rms about x, y, z; tilt up to {reach}",
        f"Least known of J: {weights}, to {three_digits(100.0 * moved.half_width)} % of a mean "
        f"moment, {three_digits(moved.condition)} times worse than the best known",
    ]


def _duration(recording: Recording) -> float:
    ends = [(s.time[0], s.time[-1]) for _, s in recording.items() if len(s)]
    return float(max(stop for _, stop in ends) - min(start for start, _ in ends))


def _trust(identification: Identification) -> list[str]:
    if not identification.misfit:
        return []
    total, *streams = identification.misfit
    lines = [
        f"chi2 per sample {_chi2(total)}, a true model keeps {total.low:.3f} to {total.high:.3f}: "
        + ", ".join(f"{part.name} {_chi2(part)}" for part in streams)
    ]
    if not total.is_noise and not identification.disturbance:
        lines.append(
            "The residual is more than noise, but no torque explains it: check the sensors."
        )
    elif not total.is_noise:
        lines.append(
            "The model misses more than noise. A white torque of "
            f"{printed(identification.disturbance, 'N m')} in a band of 1 Hz about "
            "each axis was fitted in "
            "place of what it lacks; the intervals know of that torque, not of its cause: see "
            "`twin compare`."
        )
    if identification.fit is not None and not identification.fit.converged:
        lines.append("The fit has not settled: take its numbers as a guess.")
    return lines


def _chi2(part: Misfit) -> str:
    value = part.chi2_per_sample
    return f"{value:.3f}" if value < 100.0 else three_digits(value)


def _carried(recording: Recording, identification: Identification) -> Array:
    """(3,) what the sliding masses add to m r at the end of a log [kg m]."""
    stages = identification.platform.stages
    if not stages or "stage_position" not in recording or not len(recording["stage_position"]):
        return np.zeros(3)
    last = recording["stage_position"].value[-1]
    return np.asarray(sum(s.mass * d * s.axis for s, d in zip(stages, last, strict=True)))
