"""A gyro held against an attitude: in sentences, and as one JSON document."""

from typing import Any

import numpy as np

from twin.strapdown import FAULTS, GyroComparison
from twin.strapdown.compare import Fault
from twin.units import fitting, printed, three_digits

TIES = {
    "gyro_misalignment": "whether the gyro's or the attitude's are turned, the two do not tell",
    "clock_lag": "or the attitude is early",
}


def gyro_sentences(found: GyroComparison) -> list[str]:
    """What is wrong with a gyro that is taken as it is, and how far that leads astray."""
    lines = [
        "The gyro held against the attitude, without a model of what moves the body:",
        "taken as it is, its squared innovations are "
        f"{three_digits(found.chi2_before)} times what they are without the errors below.",
    ]
    lines += [_sentence(fault, found) for fault in FAULTS]
    alone = [
        f"{printed(raw, 'rad')} in {three_digits(horizon)} s ({printed(mended, 'rad', raw)})"
        for horizon, raw, mended in found.drift
    ]
    if alone:
        lines.append(f"Alone and as it is (corrected) it strays by {', '.join(alone)}, rms.")
    lines.append(
        f"What is left is noise of {printed(found.gyro_noise, 'rad/s')} a sample of the gyro and "
        f"of {printed(found.attitude_noise, 'rad')} of the attitude; intervals are 95 %."
    )
    return lines


def _sentence(fault: Fault, found: GyroComparison) -> str:
    places = _places(fault)
    value, half = found.value[places], found.half_width[places]
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
    if not found.certain[places].any():
        return f"{text}: nothing that is sure."
    return f"{text}; {TIES[fault.name]}." if fault.name in TIES else f"{text}."


def gyro_document(source: str, found: GyroComparison) -> dict[str, Any]:
    """What `twin compare --json` prints of a log without a platform; SI."""
    parameters: dict[str, Any] = {}
    for fault in FAULTS:
        places = _places(fault)
        value, half = found.value[places], found.half_width[places]
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
            "chi2_before": found.chi2_before,
            "noise": {"gyro": found.gyro_noise, "attitude": found.attitude_noise},
            "alone": [
                {"horizon": horizon, "as_it_is": raw, "corrected": mended}
                for horizon, raw, mended in found.drift
            ],
        },
    }


def _places(fault: Fault) -> slice:
    first = sum(len(other.columns) for other in FAULTS[: FAULTS.index(fault)])
    return slice(first, first + len(fault.columns))
