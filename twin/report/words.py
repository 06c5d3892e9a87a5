"""What a comparison found, in sentences with numbers as a person writes them."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from twin.predict.compare import (
    Account,
    Comparison,
    StreamError,
    Transfer,
    disturbed,
    noise_findings,
    stream_errors,
)
from twin.predict.explain import Strength
from twin.predict.fit import Fit
from twin.predict.laws import LAWS
from twin.units import fitting, printed, three_digits

ALIKE = 0.9
"""Share of a law's effect that the base could imitate, above which that is said."""

MEANINGFUL = 0.5
"""Error of a free run [rad] beyond which its size says nothing any more."""


def sentences(comparison: Comparison) -> list[str]:
    """All that is to be said of one log, the verdict first."""
    said = [_verdict(comparison), f"As built, {_misses(comparison, comparison.as_built.plain)}."]
    if not comparison.healthy:
        said += _laws(comparison, comparison.as_built, "With the base as built")
    if comparison.refitted is not None:
        said.append(_base(comparison))
        if not comparison.healthy:
            said += _laws(comparison, comparison.refitted, "With the base refitted")
    said += _disturbed(comparison)
    said += _free_runs(comparison)
    said += noise_findings(comparison)
    if comparison.predictor.not_predicted:
        said.append(
            "Not part of the prediction: " + _listed(comparison.predictor.not_predicted) + "."
        )
    said += [f"Repaired on reading: {repair}." for repair in comparison.recording.repairs]
    return said


def transfer_sentences(transfer: Transfer, source: Comparison) -> list[str]:
    """What the model fitted on `source` says of another log."""
    other = transfer.comparison
    own = other.best.explanation.fit
    said = [
        f"The base fitted on {name_of(source)} predicts {name_of(other)} with a "
        f"{_typical(other, transfer.plain)}, and with the laws found there "
        f"{_typical(other, transfer.with_laws, short=True)}; refitted on this log alone it is "
        f"{_typical(other, own, short=True)}."
    ]
    ratios: list[tuple[float, float]] = []
    for name, one, two, half_one, half_two, unit in _both(source, other):
        if abs(two - one) <= np.hypot(half_one, half_two):
            continue
        ratio = two / one if min(abs(one), abs(two)) > np.hypot(half_one, half_two) else np.nan
        if abs(one) > 5.0 * half_one and abs(two) > 5.0 * half_two:
            ratios.append((ratio, abs(ratio) * np.hypot(half_one / one, half_two / two)))
        times = f", {ratio:.3g} times as much" if np.isfinite(ratio) else ""
        said.append(
            f"{name} differs: {interval(one, half_one, unit)} on {name_of(source)}, "
            f"{interval(two, half_two, unit)} on {name_of(other)}{times}."
        )
    if len(ratios) > 1 and np.ptp([r for r, _ in ratios]) < max(half for _, half in ratios):
        said.append(
            "They differ by one factor: another mass at the same place, or another scale of the "
            "torque."
        )
    return said


def name_of(comparison: Comparison) -> str:
    """The log's own name: that of its folder or file."""
    source = str(comparison.recording.provenance.get("source", "the log"))
    return source.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]


def base_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Each base parameter as stated, refitted, and refitted with the laws found."""
    base, refitted = comparison.base, comparison.refitted
    rows: list[dict[str, Any]] = []
    for i, (name, unit) in enumerate(zip(base.names, base.units, strict=True)):
        row: dict[str, Any] = {"name": name, "unit": unit, "stated": float(base.as_stated[i])}
        if refitted is not None:
            for key, found in (("plain", refitted.plain), ("laws", refitted.explanation.fit)):
                half = float(found.half_widths[i])
                row[key] = (float(found.theta[i]), half)
        rows.append(row)
    return rows


def _verdict(comparison: Comparison) -> str:
    if comparison.healthy:
        return "Healthy: the residual is the sensors' noise; nothing to add."
    laws = _found(comparison).explanation.laws
    if not laws:
        return "The model misses more than noise, and none of the simple laws explains it."
    losing = all(strength.law.dissipative for strength in laws)
    what = "loses energy that the model keeps" if losing else "does what the model does not know"
    rest = "" if comparison.verdict == "explained" else " That is not all it does."
    return f"The machine {what}: {_law_words(laws)}.{rest}"


def _found(comparison: Comparison) -> Account:
    """The account whose laws are told first: the refitted one, unless it found none."""
    best = comparison.best
    return best if best.explanation.laws else comparison.as_built


def _laws(comparison: Comparison, account: Account, where: str) -> list[str]:
    laws = account.explanation.laws
    if not laws:
        return [f"{where}, no simple law takes away what is left."]
    said = [
        f"{where}, the log asks for {_law_words(laws)}; then the typical stretch misses "
        f"{_typical(comparison, account.explanation.fit, short=True)}."
    ]
    for strength in laws:
        if account is comparison.as_built and strength.imitated > ALIKE:
            said.append(
                f"Mind: {strength.imitated:.0%} of the effect of {_short(strength)} on this log "
                "could be another base just as well."
            )
    return said


def _law_words(laws: Iterable[Strength]) -> str:
    laws = sorted(laws, key=lambda strength: LAWS.index(strength.law))
    against = [_law(strength) for strength in laws if strength.law.dissipative]
    others = [_law(strength) for strength in laws if not strength.law.dissipative]
    if against:
        others.insert(0, "a torque against the motion of " + " plus ".join(against))
    return _listed(others)


def _law(strength: Strength) -> str:
    return strength.law.words.format(strength_words(strength))


def _short(strength: Strength) -> str:
    return strength.law.name.replace("_", " ")


def strength_words(strength: Strength) -> str:
    """A strength with its 95 % interval: 0.148 N m (0.133 to 0.163)."""
    law = strength.law
    values = [bound + law.offset for bound in (strength.value, strength.low, strength.high)]
    factor, unit = (0.01, "%") if law.unit == "1" else fitting(values[0], law.unit)
    value, low, high = (three_digits(entry / factor) for entry in values)
    return f"{value} {unit} ({low} to {high})"


def _misses(comparison: Comparison, found: Fit) -> str:
    first, *others = stream_errors(comparison.predictor, found)
    parts = [f"{first.stream} by {_error(first)}"]
    parts += [
        f"{error.stream} by {printed(error.rms, error.unit)} rms, "
        f"{error.rms / error.noise:.2g} times its noise"
        for error in others
    ]
    return f"the prediction misses {_listed(parts)}"


def _error(error: StreamError) -> str:
    rms, noise, typical, worst = (
        printed(size, error.unit) for size in (error.rms, error.noise, error.typical, error.worst)
    )
    return (
        f"{rms} rms, {error.rms / error.noise:.2g} times its noise of {noise} "
        f"(typical stretch {typical}; worst {worst} at {error.worst_time:.2f} s)"
    )


def _typical(comparison: Comparison, found: Fit, *, short: bool = False) -> str:
    error = stream_errors(comparison.predictor, found)[0]
    text = printed(error.typical, error.unit)
    ratio = f"{error.typical / error.noise:.2g} times the noise"
    return f"{text} ({ratio})" if short else f"typical miss of {text} in {error.stream} ({ratio})"


def _base(comparison: Comparison) -> str:
    assert comparison.refitted is not None
    rows = base_rows(comparison)
    parts: list[str] = []
    for row in rows:
        value, half = row["plain"]
        stated = row["stated"]
        change = f" ({value / stated - 1.0:+.0%})" if abs(stated) > half else ""
        parts.append(
            f"{row['name']} from {stated:.3g} to {interval(value, half, row['unit'])}{change}"
        )
    plain = comparison.refitted.plain
    return (
        f"Refitting the base alone moves {_listed(parts)}; then the typical stretch misses "
        f"{_typical(comparison, plain, short=True)}."
    )


def _disturbed(comparison: Comparison) -> list[str]:
    found = disturbed(comparison.predictor, comparison.best.explanation.fit)
    if not found:
        return []
    spans = [f"{segment.start:.1f} to {segment.stop:.1f} s" for segment in found]
    return [
        f"From {_listed(spans)} something acted that no law knows: was the machine touched? "
        "There the log hardly weighs in the fit."
    ]


def _free_runs(comparison: Comparison) -> list[str]:
    parts: list[str] = []
    for horizon, run in comparison.free_runs.items():
        if run is not None and min(run.ends) < MEANINGFUL:
            before, after = (printed(error, "rad") for error in run.ends)
            parts.append(f"{before} after {horizon:g} s as built and {after} with the best model")
    return [f"A free run is typically off by {_listed(parts)}."] if parts else []


def _both(
    source: Comparison, other: Comparison
) -> Iterable[tuple[str, float, float, float, float, str]]:
    if source.refitted is None or other.refitted is None:
        return
    one, two = source.refitted.explanation.fit, other.refitted.explanation.fit
    for i, (name, unit) in enumerate(zip(source.base.names, source.base.units, strict=True)):
        yield (
            name,
            float(one.theta[i]),
            float(two.theta[i]),
            float(one.half_widths[i]),
            float(two.half_widths[i]),
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
