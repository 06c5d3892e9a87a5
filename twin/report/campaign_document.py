"""What a campaign says, as plain data for `--json`."""

from typing import Any

from twin.campaigns.answers import Answers
from twin.campaigns.merit import METRICS


def campaign_document(found: Answers) -> dict[str, Any]:
    """One document; what is not known is null when it is printed."""
    results, spec = found.results, found.results.spec
    units = {factor.name: factor.unit for factor in spec.factors}
    return {
        "runs": len(results.run),
        "of": spec.runs,
        "ended": found.ended,
        "reasons": [
            {"reason": reason, "count": count, "first_run": run}
            for reason, count, run in found.reasons
        ],
        "metrics": [
            {
                "arm": one.arm,
                "metric": one.metric,
                "unit": METRICS[one.metric].unit,
                "count": one.count,
                "mean": one.mean.document(),
                "median": one.median.document(),
                "percentile_95": one.high.document(),
            }
            for one in found.spreads
        ],
        "points": [
            {
                "arm": one.arm,
                "at": dict(one.at),
                "metric": one.metric,
                "unit": METRICS[one.metric].unit,
                "count": one.count,
                "median": one.median.document(),
                "percentile_95": one.high.document(),
            }
            for one in found.points
        ],
        "touched_the_stop": found.at_stop,
        "sensitivities": [
            {
                "arm": one.arm,
                "metric": one.metric,
                "factor": one.factor,
                "rank_correlation": one.correlation.document(),
                "certain": one.certain,
            }
            for one in found.sensitivities
        ],
        "sobol_indices": [
            {
                "arm": one.arm,
                "metric": one.metric,
                "factor": one.factor,
                "first_order": one.first.document(),
                "total": one.total.document(),
                "points": one.count,
            }
            for one in found.indices
        ],
        "comparisons": [
            {
                "one": one.one,
                "other": one.other,
                "metric": one.metric,
                "pairs": one.pairs,
                "machines": one.machines,
                "ratio_of_means": one.ratio.document(),
                "smaller_in": one.wins,
                "same_in": one.ties,
                "p": one.p,
            }
            for one in found.comparisons
        ],
        "conditions": [
            {
                "one": one.one,
                "other": one.other,
                "metric": one.metric,
                "factor": one.factor,
                "low": one.low,
                "high": one.high,
                "unit": units[one.factor.strip("|")],
                "pairs": one.pairs,
                "ratio_of_means": one.ratio.document(),
            }
            for one in found.conditions
        ],
        "worst": [
            {
                "run": one.run,
                "arm": one.arm,
                "metric": one.metric,
                "value": one.value,
                "unit": METRICS[one.metric].unit,
                "blamed": [
                    {
                        "factor": blamed.factor,
                        "value": blamed.value,
                        "unit": units[blamed.factor.strip("|")],
                        "share_below": blamed.below,
                        "share_above": blamed.above,
                    }
                    for blamed in one.blamed
                ],
            }
            for one in found.worst
        ],
    }
