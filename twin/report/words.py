"""What a comparison found, in sentences with numbers as a person writes them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import norm

from twin.comparison import Comparison, Transfer, name_of
from twin.comparison.account import (
    Account,
    ColumnMisfit,
    StreamError,
    coloured,
    disturbed,
    quiet,
    stream_errors,
)
from twin.comparison.explanation import FALSE_ALARM, Side, Strength
from twin.comparison.symptoms import SymptomDomain
from twin.platform import beyond_stated, taken_as_at_rest
from twin.predict.body import Body
from twin.units import as_precise, fitting, printed, three_digits, unit_of

ALIKE = 0.9
"""Share of a law's effect that the base could imitate, above which that is said."""

NO_INTERVALS = (
    "None of the intervals below is a 95 % interval: they reflect the scatter of the residual, not "
    "its cause."
)

SHOWN = 4
"""Symptoms that are listed."""

ORDER = {
    "bearing_coulomb_friction": 0,
    "bearing_viscous_friction": 1,
    "aerodynamic_drag": 2,
}
"""Torques against the motion of the base, told together."""

MEANINGFUL = 1.0
"""Error of a free run [rad] beyond which its size says nothing any more."""


def sentences(comparison: Comparison) -> list[str]:
    """All that is to be said of one log: how it was read, then the verdict, then the rest."""
    said = _conventions(comparison)
    said += taken_as_at_rest([comparison.recording], comparison.platform)
    said += beyond_stated([comparison.recording], comparison.platform)
    said += [_verdict(comparison)]
    said += _doubt(comparison)
    said += _where(comparison)
    said.append(f"As built, {_misses(comparison.as_built.plain)}.")
    if not comparison.healthy:
        said += _laws(comparison, comparison.as_built, "With the base as built")
    if comparison.refitted is not None:
        said.append(_base(comparison))
        if not comparison.healthy:
            said += _laws(comparison, comparison.refitted, "With the base refitted")
    said += _symptoms(comparison)
    said += _colour(comparison)
    said += quiet_sentences(comparison.best.explained.misfits)
    said += _disturbed(comparison)
    said += _free_runs(comparison)
    said += _biases(comparison)
    said += [finding.sentence for finding in comparison.noise]
    if comparison.body.not_predicted:
        said.append("Not part of the prediction: " + _listed(comparison.body.not_predicted) + ".")
    said += [f"Repaired on reading: {repair}." for repair in comparison.recording.repairs]
    return said


def headline(comparison: Comparison) -> str:
    """The verdict."""
    return _verdict(comparison)


def transfer_sentences(transfer: Transfer, source: Comparison) -> list[str]:
    """What the model fitted on `source` says of another log."""
    other = transfer.comparison
    own = other.best.explained
    said = [
        f"The base fitted on {name_of(source)} predicts {name_of(other)} with a "
        f"{_typical(transfer.plain)}, and with the laws found there "
        f"{_typical(transfer.explained, short=True)}; refitted on this log alone it is "
        f"{_typical(own, short=True)}."
    ]
    ratios: list[tuple[float, float]] = []
    for name, item, two, half_one, half_two, unit in _both(source, other):
        if abs(two - item) <= np.hypot(half_one, half_two):
            continue
        ratio = two / item if min(abs(item), abs(two)) > np.hypot(half_one, half_two) else np.nan
        if abs(item) > 5.0 * half_one and abs(two) > 5.0 * half_two:
            ratios.append((ratio, abs(ratio) * np.hypot(half_one / item, half_two / two)))
        times = f", {ratio:.3g} times as much" if np.isfinite(ratio) else ""
        said.append(
            f"{name} differs: {interval(item, half_one, unit)} on {name_of(source)}, "
            f"{interval(two, half_two, unit)} on {name_of(other)}{times}."
        )
    if len(ratios) > 1 and np.ptp([r for r, _ in ratios]) < max(half for _, half in ratios):
        said.append(
            "They differ by one factor: another mass at the same place, or another scale of the "
            "torque."
        )
    return said


def base_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Each base parameter as stated, refitted, and refitted with the laws found."""
    base, refitted = comparison.base, comparison.refitted
    rows: list[dict[str, Any]] = []
    for i, (name, unit) in enumerate(zip(base.names, base.units, strict=True)):
        row: dict[str, Any] = {"name": name, "unit": unit, "stated": float(base.as_stated[i])}
        if refitted is not None:
            for key, account in (("plain", refitted.plain), ("laws", refitted.explained)):
                row[key] = (float(account.theta[i]), float(half_widths(account)[i]))
        rows.append(row)
    return rows


def half_widths(account: Account) -> Any:
    """Half the 95 % intervals of theta, biases and strengths."""
    covariance, quantile = account.covariance()
    return quantile * np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _conventions(comparison: Comparison) -> list[str]:
    result = comparison.conventions
    if not result:
        return []
    said = [finding.sentence for finding in result]
    if any(not finding.ambiguous and finding.kind != "no_fit" for finding in result):
        said.append("What follows is about the log as it should have been read.")
    return said


def _verdict(comparison: Comparison) -> str:
    if comparison.healthy:
        return "Healthy: the residual is the sensors' noise; nothing to add."
    strengths = comparison.reported.strengths
    if not strengths:
        return "The model misses more than noise, and none of the simple laws explains it."
    losing = all(strength.symptom.dissipative for strength in strengths)
    domains = {strength.symptom.domain for strength in strengths}
    if losing:
        what = "The machine loses energy that the model keeps"
    elif domains <= {SymptomDomain.sensor, SymptomDomain.clock}:
        what = "The sensors err"
    else:
        what = "The model is incomplete"
    rest = "" if comparison.verdict == "explained" else " The residual is still more than noise."
    if comparison.reported is not comparison.best:
        what = f"With the base as built, {what[0].lower()}{what[1:]}"
        rest = " With the base refitted no law is significant, but the residual is more than noise."
    return f"{what}: {_law_words(strengths)}.{rest}"


def _where(comparison: Comparison) -> list[str]:
    own, others = comparison.where
    if comparison.healthy or not own:
        return []
    said = f"By the evidence the discrepancy is in {_listed(map(_domain, own))}"
    if others:
        said += f", or in {' or '.join(map(_domain, others))}: this log does not decide"
    return [f"{said}."]


def _domain(domain: SymptomDomain) -> str:
    inside = domain is SymptomDomain.exchange
    return "a torque between body and wheels or motor" if inside else domain.value


def _laws(comparison: Comparison, side: Side, where: str) -> list[str]:
    strengths = side.strengths
    if not strengths:
        return [f"{where}, no simple law explains the residual."]
    said = [
        f"{where}, the log is explained by {_law_words(strengths)}; the typical stretch then "
        f"misses {_typical(side.explained, short=True)}."
    ]
    for strength in strengths:
        if side is comparison.as_built and strength.imitated > ALIKE:
            said.append(
                f"Mind: {strength.imitated:.0%} of the effect of {_short(strength)} on this log "
                "could be another base just as well."
            )
        others = [tie.looks for tie in strength.ties]
        if others:
            said.append(
                f"In place of {_short(strength)} it is explained as well by {_listed(others)}."
            )
    return said


def _symptoms(comparison: Comparison) -> list[str]:
    """What stands out where the best model stands without any law, each on its own."""
    scores = comparison.best.scores
    out = [score for score in scores if score.stands_out]
    if not out:
        return []
    listed = [f"{s.symptom.looks}, evidence {three_digits(s.evidence)}" for s in out[:SHOWN]]
    more = f" and {len(out) - SHOWN} more" if len(out) > SHOWN else ""
    return [
        f"Each fitted alone, {len(out)} of {len(scores)} departures are significant (one or more "
        f"by chance in {FALSE_ALARM:.0%} of logs): {'; '.join(listed)}{more}."
    ]


def _colour(comparison: Comparison) -> list[str]:
    misfits = coloured(comparison.best.explained.misfits)
    if not misfits:
        return []
    columns = [f"{part.stream} {part.column}" for part in misfits]
    small = "something small" if comparison.best.explained.follows else "something"
    return [f"The residual of {_listed(columns)} is not white: the model still lacks {small}."]


def quiet_sentences(misfits: Sequence[ColumnMisfit]) -> list[str]:
    """Of noise that was stated too large, and what comes of that."""
    parts = [f"{part.stream} {part.column} (chi-square {part.chi2:.2g})" for part in quiet(misfits)]
    if not parts:
        return []
    return [
        f"The residual is below the stated noise of {_listed(parts)}: intervals are wider than "
        "these logs would allow, and small causes may stay undetected."
    ]


def _biases(comparison: Comparison) -> list[str]:
    """Constant errors beyond what platform.toml states of them."""
    account, body = comparison.best.explained, comparison.body
    limit = float(norm.isf(FALSE_ALARM / max(2 * len(body.bias_scale), 1)))
    said: list[str] = []
    sensors = account.at.biases[0][: len(body.bias_names)]
    for name, value, scale in zip(body.bias_names, sensors, body.bias_scale, strict=True):
        if abs(value) > limit * scale:
            said.append(
                f"The constant error of {name} is {printed(abs(value), _unit(body, name))}, "
                f"{abs(value) / scale:.2g} times the 1 sigma that platform.toml states."
            )
    return said


def _unit(body: Body, name: str) -> str:
    return {output.stream: output.unit for output in body.outputs}[name.split()[0]]


def _law_words(laws: Iterable[Strength]) -> str:
    laws = sorted(laws, key=lambda strength: ORDER.get(strength.symptom.name, len(ORDER)))
    against = [_law(s) for s in laws if s.symptom.name in ORDER]
    others = [_law(s) for s in laws if s.symptom.name not in ORDER]
    if against:
        others.insert(0, "a torque against the motion of " + " plus ".join(against))
    return _listed(others)


def _doubt(comparison: Comparison) -> list[str]:
    """That no interval holds, where something is left that no law explains."""
    if comparison.verdict != "unexplained":
        return []
    return [NO_INTERVALS]


def _law(strength: Strength) -> str:
    return strength.symptom.words.format(strength_words(strength))


def _short(strength: Strength) -> str:
    return strength.symptom.name.replace("_", " ").replace(":", " of ")


def strength_words(strength: Strength) -> str:
    """A strength with its 95 % interval: 0.148 N m (0.133 to 0.163)."""
    symptom = strength.symptom
    parts = [
        _with_interval(value, half, symptom.unit, symptom.offset)
        for value, half in zip(strength.values.tolist(), strength.half.tolist(), strict=True)
    ]
    if len(parts) == 1:
        return parts[0]
    names = symptom.parts or tuple(f"along {axis}" for axis in "xyz")
    if len(names) != len(parts):
        return "[" + "; ".join(parts) + "]"
    sure = np.abs(strength.values) > strength.half
    shown = sure if sure.any() else np.ones(len(parts), dtype=np.bool_)
    said = _listed(f"{part} {names[i]}" for i, part in enumerate(parts) if shown[i])
    rest = [names[i].removeprefix("for ").removeprefix("along ") for i in np.flatnonzero(~shown)]
    return f"{said} (of {_listed(rest)} no size is sure)" if rest else said


def _with_interval(value: float, half: float, unit: str, offset: float) -> str:
    values = [value + offset, value - half + offset, value + half + offset]
    factor, name = (0.01, "%") if unit == "1" else fitting(max(map(abs, values)), unit)
    middle, low, high = (as_precise(entry / factor, half / factor) for entry in values)
    return f"{middle} {name} ({low} to {high})"


def _misses(account: Account) -> str:
    first, *others = stream_errors(account)
    parts = [f"{first.stream} by {_error(first)}"]
    parts += [
        f"{error.stream} by {printed(error.rms, unit_of(error.stream, error.unit))} rms, "
        f"{error.rms / error.noise:.2g} times its noise"
        for error in others
    ]
    return f"the prediction misses {_listed(parts)}"


def _error(error: StreamError) -> str:
    unit = unit_of(error.stream, error.unit)
    rms, noise, typical, worst = (
        printed(size, unit) for size in (error.rms, error.noise, error.typical, error.worst)
    )
    return (
        f"{rms} rms, {error.rms / error.noise:.2g} times its noise of {noise} "
        f"(typical stretch {typical}; worst {worst} at {error.worst_time:.2f} s)"
    )


def _typical(account: Account, *, short: bool = False) -> str:
    error = stream_errors(account)[0]
    text = printed(error.typical, error.unit)
    ratio = f"{error.typical / error.noise:.2g} times the noise"
    return f"{text} ({ratio})" if short else f"typical miss of {text} in {error.stream} ({ratio})"


def _base(comparison: Comparison) -> str:
    assert comparison.refitted is not None
    parts: list[str] = []
    for row in base_rows(comparison):
        value, half = row["plain"]
        stated = row["stated"]
        if abs(value - stated) <= half:
            continue
        by = value / stated - 1.0 if abs(stated) > half else 0.0
        size = f"{by:+.0%}" if abs(by) > 0.1 else f"{100.0 * by:+.1g}%"
        change = f" ({size})" if by else ""
        parts.append(
            f"{row['name']} from {stated:.3g} to {interval(value, half, row['unit'])}{change}"
        )
    if not parts:
        held = "interval" if comparison.verdict == "unexplained" else "95 % interval"
        return f"Refitting the base moves no part of it beyond its {held}."
    return (
        f"Refitting the base alone moves {_listed(parts)}; then the typical stretch misses "
        f"{_typical(comparison.refitted.plain, short=True)}."
    )


def _disturbed(comparison: Comparison) -> list[str]:
    result = disturbed(comparison.best.explained)
    if not result:
        return []
    spans = [f"{segment.start:.1f} to {segment.stop:.1f} s" for segment in result]
    return [
        f"From {_listed(spans)} something acted that no law explains: was the machine touched? "
        "That time hardly counts in the fit."
    ]


def _free_runs(comparison: Comparison) -> list[str]:
    parts: list[str] = []
    for horizon, run in comparison.free_runs.items():
        if run is not None and min(run.errors[:2]) < MEANINGFUL:
            built, best, perfect = (printed(error, "rad") for error in run.errors)
            parts.append(
                f"after {horizon:g} s by {built} as built and {best} with the best model, where a "
                f"perfect one would be off by {perfect}"
            )
            if run.places is not None:
                built, best, perfect = (printed(error, "m") for error in run.places)
                parts[-1] += f", in place by {built}, {best} and {perfect}"
    return [f"A free run is typically off {_listed(parts)}."] if parts else []


def _both(
    source: Comparison, other: Comparison
) -> Iterable[tuple[str, float, float, float, float, str]]:
    if source.refitted is None or other.refitted is None:
        return
    item, two = source.refitted.explained, other.refitted.explained
    half_one, half_two = half_widths(item), half_widths(two)
    for i, (name, unit) in enumerate(zip(source.base.names, source.base.units, strict=True)):
        yield (
            name,
            float(item.theta[i]),
            float(two.theta[i]),
            float(half_one[i]),
            float(half_two[i]),
            unit,
        )


def interval(value: float, half: float, unit: str) -> str:
    """A value and half its 95 % interval, to the digits that the interval gives."""
    digits = max(0, 1 - int(np.floor(np.log10(half)))) if half > 0.0 else 3
    digits = min(digits, 9)
    return f"{value:.{digits}f} +- {half:.{digits}f} {unit}"


def _listed(parts: Iterable[str]) -> str:
    items = list(parts)
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def pair(value: float, half: float) -> str:
    """Value and half an interval, to the digits that the interval leaves."""
    if not np.isfinite(half) or half <= 0.0:
        return f"{value:.4g}"
    digits = max(1 - int(np.floor(np.log10(half))), 0)
    return f"{value:.{digits}f} +- {half:.{digits}f}"
