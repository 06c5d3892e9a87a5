"""A comparison as one JSON document."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from twin.predict.compare import Comparison, Transfer, stream_errors
from twin.predict.explain import Strength
from twin.predict.fit import Fit
from twin.report.words import name_of, sentences, transfer_sentences


def document(comparisons: Sequence[Comparison], transfers: Sequence[Transfer]) -> dict[str, Any]:
    """What `twin compare --json` prints; SI throughout, null where nothing is known."""
    return {
        "logs": [_log(comparison) for comparison in comparisons],
        "transfers": [_transfer(transfer, comparisons[0]) for transfer in transfers],
    }


def _log(comparison: Comparison) -> dict[str, Any]:
    accounts = {"as_built": comparison.as_built, "refitted": comparison.refitted}
    return {
        "log": str(comparison.recording.provenance.get("source", "")),
        "platform": comparison.platform.name,
        "verdict": comparison.verdict,
        "sentences": sentences(comparison),
        "accounts": {
            name: None
            if account is None
            else {
                "base": _base(comparison, account.explanation.fit),
                "plain": _missed(comparison, account.plain),
                "with_laws": _missed(comparison, account.explanation.fit),
                "laws": [_strength(strength) for strength in account.explanation.laws],
            }
            for name, account in accounts.items()
        },
        "not_excited": list(comparison.base.not_excited),
        "free_run": {
            f"{horizon:g}": None if run is None else {"before": run.ends[0], "after": run.ends[1]}
            for horizon, run in comparison.free_runs.items()
        },
        "repairs": list(comparison.recording.repairs),
        "not_predicted": list(comparison.predictor.not_predicted),
    }


def _base(comparison: Comparison, found: Fit) -> dict[str, Any]:
    fixed = len(found.theta)
    covariance = found.covariance[:fixed, :fixed]
    return dict(comparison.base.table(found.theta, covariance, found.quantile))


def _missed(comparison: Comparison, found: Fit) -> dict[str, Any]:
    errors = [asdict(error) for error in stream_errors(comparison.predictor, found)]
    return {
        "chi2_per_sample": found.chi2_per_sample,
        "streams": {error.pop("stream"): error for error in errors},
    }


def _strength(strength: Strength) -> dict[str, Any]:
    return {
        "name": strength.law.name,
        "value": strength.value,
        "low": strength.low,
        "high": strength.high,
        "unit": strength.law.unit,
        "imitated_by_base": strength.imitated,
    }


def _transfer(transfer: Transfer, source: Comparison) -> dict[str, Any]:
    other = transfer.comparison
    return {
        "fitted_on": name_of(source),
        "log": name_of(other),
        "sentences": transfer_sentences(transfer, source),
        "plain": _missed(other, transfer.plain),
        "with_laws": _missed(other, transfer.with_laws),
    }
