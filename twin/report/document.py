"""A comparison as one JSON document."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from twin.comparison import Comparison, Transfer, name_of
from twin.comparison.account import Account, stream_errors
from twin.comparison.explanation import FreeRun, Side, Strength
from twin.platform import taken_as_at_rest
from twin.report.words import sentences, transfer_sentences


def document(comparisons: Sequence[Comparison], transfers: Sequence[Transfer]) -> dict[str, Any]:
    """What `twin compare --json` prints; SI throughout, null where nothing is known."""
    return {
        "logs": [_log(comparison) for comparison in comparisons],
        "transfers": [_transfer(transfer, comparisons[0]) for transfer in transfers],
    }


def free_run_document(runs: Mapping[float, FreeRun | None]) -> dict[str, Any]:
    """Typical errors [rad] by horizon [s], on a floor of x and y [m] besides; null where a log is
    too short."""
    return {
        f"{horizon:g}": None
        if run is None
        else {**_free_run(run.errors), **({"place": _free_run(run.places)} if run.places else {})}
        for horizon, run in runs.items()
    }


def _free_run(errors: tuple[float, float, float]) -> dict[str, Any]:
    return dict(zip(("before", "after", "perfect"), errors, strict=True))


def _log(comparison: Comparison) -> dict[str, Any]:
    sides = {"as_built": comparison.as_built, "refitted": comparison.refitted}
    return {
        "log": str(comparison.recording.provenance.get("source", "")),
        "platform": comparison.platform.name,
        "verdict": comparison.verdict,
        "intervals_hold": comparison.verdict != "unexplained",
        "sentences": sentences(comparison),
        "conventions": [
            {"stream": finding.stream, "kind": finding.kind, "sentence": finding.sentence}
            for finding in comparison.conventions
        ],
        "noise": [finding.sentence for finding in comparison.noise],
        "taken_as_at_rest": list(taken_as_at_rest([comparison.recording], comparison.platform)),
        "where": [domain.value for domain in comparison.where[0]],
        "or_where": [domain.value for domain in comparison.where[1]],
        "accounts": {
            name: None if side is None else _side(comparison, side) for name, side in sides.items()
        },
        "not_excited": list(comparison.base.not_excited),
        "free_run": free_run_document(comparison.free_runs),
        "repairs": list(comparison.recording.repairs),
        "not_predicted": list(comparison.body.not_predicted),
    }


def _side(comparison: Comparison, side: Side) -> dict[str, Any]:
    return {
        "base": _base(comparison, side.explained),
        "plain": _missed(side.plain),
        "with_laws": _missed(side.explained),
        "laws": [_strength(strength) for strength in side.strengths],
        "symptoms": [
            {
                "name": score.symptom.name,
                "domain": score.symptom.domain.name,
                "evidence": score.evidence,
                "needed": score.needed,
                "stands_out": score.stands_out,
                "strengths": score.strengths.tolist(),
                "unit": score.symptom.unit,
            }
            for score in side.scores
        ],
    }


def _base(comparison: Comparison, account: Account) -> dict[str, Any]:
    fixed = len(account.theta)
    covariance, quantile = account.covariance()
    return dict(comparison.base.table(account.theta, covariance[:fixed, :fixed], quantile))


def _missed(account: Account) -> dict[str, Any]:
    errors = [asdict(error) for error in stream_errors(account)]
    return {
        "follows": account.follows,
        "streams": {error.pop("stream"): error for error in errors},
        "columns": [
            {
                "stream": part.stream,
                "column": part.column,
                "chi2_per_sample": part.chi2,
                "band": [part.low, part.high],
                "whiteness": part.whiteness,
            }
            for part in account.misfits
        ],
    }


def _strength(strength: Strength) -> dict[str, Any]:
    values, half = strength.values, strength.half
    value, low, high = (
        part.tolist() if len(part) > 1 else float(part[0])
        for part in (values, values - half, values + half)
    )
    return {
        "name": strength.symptom.name,
        "domain": strength.symptom.domain.name,
        "value": value,
        "low": low,
        "high": high,
        "unit": strength.symptom.unit,
        "imitated_by_base": strength.imitated,
        "ties": [tie.name for tie in strength.ties],
    }


def _transfer(transfer: Transfer, source: Comparison) -> dict[str, Any]:
    return {
        "fitted_on": name_of(source),
        "log": name_of(transfer.comparison),
        "sentences": transfer_sentences(transfer, source),
        "plain": _missed(transfer.plain),
        "with_laws": _missed(transfer.explained),
    }
