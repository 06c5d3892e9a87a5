"""A diagnosis as one JSON document."""

from typing import Any

from twin.diagnosis import Cause, Diagnosis, Validation
from twin.identification.prediction_error import NORMAL
from twin.platform import taken_as_at_rest
from twin.report.diagnosed import equation_text, verdict_sentence
from twin.report.document import free_run_document
from twin.report.next_experiment import experiment_document


def diagnosis_document(found: Diagnosis, validation: Validation | None) -> dict[str, Any]:
    """What `twin diagnose --json` prints (docs/design.md 4.5); SI throughout."""
    explained, gain = found.explained, found.held_out
    p = len(explained.at.theta)
    covariance = explained.covariance[:p, :p]
    return {
        "verdict": found.verdict,
        "intervals_hold": found.intervals_hold,
        "sentence": verdict_sentence(found),
        "causes": [_cause(cause) for cause in found.causes],
        "wander": _wander(found),
        "base": dict(explained.base.table(explained.at.theta, covariance, NORMAL)),
        "gain": {
            "held_out": {
                "log_likelihood": gain.log_likelihood,
                "chi2_per_sample": {
                    "before": gain.before,
                    "after": gain.after,
                    "band": [gain.low, gain.high],
                },
                "free_run": free_run_document(found.free_runs),
            },
            "validation": None if validation is None else _validation(validation),
        },
        "equation": None
        if found.equation is None
        else {
            "text": equation_text(found.equation),
            "evidence": found.equation.evidence,
            "terms": [
                {
                    "what": law.what,
                    "column": law.column,
                    "factors": list(law.factors),
                    "unit": law.unit,
                    "value": value,
                    "low": value - half,
                    "high": value + half,
                }
                for law, value, half in zip(
                    found.equation.laws,
                    found.equation.coefficients.tolist(),
                    found.equation.half_widths.tolist(),
                    strict=True,
                )
            ],
        },
        "pushes": [
            {"log": push.source, "start": push.start, "stop": push.stop} for push in found.pushes
        ],
        "next_experiment": None
        if found.next_experiment is None
        else experiment_document(found.next_experiment),
        "remainder": {
            "chance": found.residual_test.chance,
            "torque_gain": found.residual_test.torque_gain,
            "directions": found.residual_test.freedom,
        },
        "tried": [
            {
                "label": tried.label,
                "evidence": tried.evidence,
                "alone": tried.alone,
                "detectable": dict(zip(tried.names, tried.detectable.tolist(), strict=True)),
            }
            for tried in found.tried
        ],
        "not_asked": dict(found.not_asked),
        "conventions": [finding.sentence for finding in found.conventions],
        "noise": [finding.sentence for finding in found.noise],
        "taken_as_at_rest": list(taken_as_at_rest(found.recordings, found.platform)),
        "repairs": [repair for log in found.recordings for repair in log.repairs],
    }


def _wander(found: Diagnosis) -> dict[str, Any]:
    noise = found.wander
    torque = noise.torque
    shared = bool(found.causes) and (noise.wanders or not found.explained.follows)
    return {
        "torque": None if torque is None else {"rms": torque.rms, "time": torque.time},
        "errors": {stream: {"rms": one.rms, "time": one.time} for stream, one in noise.errors},
        "white_noise": dict(noise.scales),
        "carried_by_causes": found.carried if shared else None,
    }


def _cause(cause: Cause) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    first = 0
    for known in cause.effect.parameters():
        own = slice(first, first + known.size)
        first += known.size
        value, half = cause.effect.values[own], cause.half_widths[own]
        ends = (value, value - half, value + half)
        scalar = known.size == 1 and not isinstance(known.typical, tuple)
        parameters[known.name] = {
            key: float(part[0]) if scalar else part.tolist()
            for key, part in zip(("value", "low", "high"), ends, strict=True)
        } | {"unit": known.unit}
    return {
        "name": cause.effect.name,
        "target": cause.effect.target or None,
        "evidence": cause.evidence,
        "confidence": cause.confidence,
        "parameters": parameters,
        "ties": [
            {
                "name": tie.label.partition(":")[0],
                "target": tie.label.partition(":")[2] or None,
                "behind": tie.behind,
            }
            for tie in cause.ties
        ],
    }


def _validation(gain: Validation) -> dict[str, Any]:
    return {
        "log_likelihood": gain.log_likelihood,
        "chi2_per_sample": {"before": gain.before, "after": gain.after},
        "free_run": free_run_document(gain.free_runs),
        "conventions": [finding.sentence for finding in gain.conventions],
        "repairs": list(gain.repairs),
    }
