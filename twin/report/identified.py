"""What an identification found, in lines for a terminal."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.identification import Identification, Misfit
from twin.platform import beyond_stated, taken_as_at_rest
from twin.predict.base import NAMES, hinge_axis
from twin.recording import Recording
from twin.report.words import pair
from twin.units import printed, three_digits

Array = NDArray[np.float64]


def identified(found: Identification) -> list[str]:
    """The entries with their 95 % intervals, then how far to trust them."""
    logs = " and ".join(f"{_duration(log):.0f} s" for log in found.recordings)
    together = ", fitted together" if len(found.recordings) > 1 else ""
    lines = [
        f"{found.platform.title} ({found.platform.name}), {logs} of log{together}",
        f"  by {found.method}, {_intervals(found)}:",
    ]
    lines += [f"    {line}" for line in (*_entries(found), *_joints(found), *_scales(found))]
    lines += [f"  {line}" for line in (*_excitation(found), *_sentences(found.not_used))]
    lines += [f"  {line}" for line in taken_as_at_rest(found.recordings, found.platform)]
    lines += [f"  {line}" for line in beyond_stated(found.recordings, found.platform)]
    lines += [f"  {line}" for line in _trust(found)]
    lines += [f"  {found.not_rigid}"] if found.not_rigid else []
    if found.platform.base.falls:
        lines.append("  J is about the centre of mass, about which a body turns that falls freely.")
    lines += [f"  Cannot be told: {sentence}." for sentence in found.not_excited]
    lines += [f"  Repaired on reading: {r}." for log in found.recordings for r in log.repairs]
    return lines


def _intervals(found: Identification) -> str:
    if not found.doubt:
        return "with 95 % intervals"
    return f"not with 95 % intervals, for {found.doubt}; the +- know the scatter alone"


def _entries(found: Identification) -> list[str]:
    base, platform = found.base, found.platform
    values = base.entries(found.theta)
    half = found.quantile * np.sqrt(np.diag(base.map @ found.covariance @ base.map.T))
    seen = np.abs(base.map).sum(axis=1) > 0.0
    if platform.base.kind == "hinge":
        axis = hinge_axis(base.machine)
        if "J" in base.names:
            size = pair(found.theta[0], found.half_widths[0])
        else:
            size = f"{axis @ platform.inertia @ axis:.6g} (as stated)"
        lines = [f"J     {size} kg m^2 about the axis"]
    else:
        lines = [
            f"{name:<5} {pair(value, width)} kg m^2"
            for name, value, width in zip(NAMES[:6], values, half, strict=False)
        ]
    moved = _carried(found.recordings[-1], found)
    for place, extra in [("", np.zeros(3)), (" with the masses as the log left them", moved)]:
        if place and not extra.any():
            continue
        for i, axis in enumerate("xyz"):
            if not seen[6 + i]:
                continue
            value, width = values[6 + i] + extra[i], half[6 + i]
            lines.append(
                f"m r_{axis} {pair(value, width)} kg m"
                f" = {pair(value * platform.gravity, width * platform.gravity)} N m"
                f" = {pair(value / platform.mass * 1e6, width / platform.mass * 1e6)} um"
                f" of {platform.mass:g} kg{place}"
            )
    return lines


def _joints(found: Identification) -> list[str]:
    first = len(found.theta) - len(found.base.joints)
    return [
        f"{joint.name} {pair(value, width)} {joint.unit}"
        for joint, value, width in zip(
            found.base.joints, found.theta[first:], found.half_widths[first:], strict=True
        )
    ]


def _scales(found: Identification) -> list[str]:
    return [
        f"scale of {scale.stream} {pair(scale.value, 0.5 * (scale.high - scale.low))} {scale.unit}"
        for scale in found.scales
        if scale.known
    ]


def _sentences(said: Sequence[str]) -> list[str]:
    return [f"{sentence}." for sentence in said]


def _excitation(found: Identification) -> list[str]:
    moved = found.excitation
    rates = ", ".join(three_digits(float(np.degrees(rate))) for rate in moved.rate)
    reach = f"{three_digits(float(np.degrees(moved.reach)))} deg"
    if found.platform.base.kind == "hinge":
        return [f"Excitation: rate {rates} deg/s rms, angle up to {reach} from its mean"]
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


def _trust(found: Identification) -> list[str]:
    if not found.misfit:
        return []
    total, *streams = found.misfit
    lines = [
        f"chi2 per sample {_chi2(total)}, a true model keeps {total.low:.3f} to {total.high:.3f}: "
        + ", ".join(f"{part.name} {_chi2(part)}" for part in streams)
    ]
    if not total.is_noise and not found.disturbance:
        lines.append("More is left than noise, but no torque explains it: look at the sensors.")
    elif not total.is_noise:
        lines.append(
            "The model misses more than noise. A white torque of "
            f"{printed(found.disturbance, 'N m')} in a band of 1 Hz about each axis was fitted in "
            "place of what it lacks; the intervals know of that torque, not of its cause: see "
            "`twin compare`."
        )
    if found.fit is not None and not found.fit.converged:
        lines.append("The fit has not settled: take its numbers as a guess.")
    return lines


def _chi2(part: Misfit) -> str:
    value = part.chi2_per_sample
    return f"{value:.3f}" if value < 100.0 else three_digits(value)


def _carried(recording: Recording, found: Identification) -> Array:
    """(3,) what the sliding masses add to m r at the end of a log [kg m]."""
    stages = found.platform.stages
    if not stages or "stage_position" not in recording or not len(recording["stage_position"]):
        return np.zeros(3)
    last = recording["stage_position"].value[-1]
    return np.asarray(sum(s.mass * d * s.axis for s, d in zip(stages, last, strict=True)))
