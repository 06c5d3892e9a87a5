"""A campaign as sentences and rows of tables, as Markdown and as JSON."""

import math
from collections.abc import Sequence
from typing import Any

from twin.campaigns.answers import Answers, Blamed, Spread
from twin.campaigns.merit import METRICS
from twin.campaigns.statistics import ArmComparison
from twin.interval import Interval
from twin.units import fitting

Rows = tuple[tuple[str, ...], list[list[str]]]
"""Head and cells of a table."""

LISTED = 30
"""Sensitivities listed at most."""
WORTH = 0.01
"""Share of the variance from which on an index is listed."""
INDICES = "Shares of each metric's variance (Sobol indices), where they may be 1 % or more:"
CONDITIONS = "How the ratio goes with the factor that it depends on most:"
A_BEGINNING = 12
"""Machines of which tests of ranks may prove something."""
PROVEN = 0.05
"""Level of significance, of p-values that are corrected for their number."""


def title(found: Answers) -> str:
    """Of a report."""
    return f"Campaign {found.results.spec.path.parent.name or found.results.folder.name}"


def summary(found: Answers) -> list[str]:
    """What was flown and how it ended, a sentence each."""
    results, spec = found.results, found.results.spec
    machines = sorted({arm.platform.name for arm in spec.arms})
    runs, long = ("runs", "") if spec.procedure == "run" else ("balancings", "at most ")
    drawn = f", {_machines(found)} machines" if spec.dispersed else ""
    lines = [
        f"{len(results.run)} of {spec.runs} {runs} of {', '.join(machines)} flown, {long}"
        f"{spec.duration:g} s each, {spec.sampling} samples{drawn}, seed {spec.seed}."
    ]
    for arm, ends in found.ended.items():
        words = {"done": "balanced"} if spec.procedure == "balance" else {}
        counted = ", ".join(f"{n} {words.get(end, end)}" for end, n in sorted(ends.items()))
        lines.append(f"{arm}: {counted}.")
    for arm, count in found.at_stop.items():
        angle = math.degrees(next(a.platform.stop_angle for a in spec.arms if a.name == arm))
        lines.append(
            f"{arm}: {count} touched the tilt stop at {angle:.3g} deg; what their metrics say is "
            "of the stop, too."
        )
    for reason, count, run in found.reasons:
        lines.append(f"{count} did not come to their end: {reason} (the first is run {run}).")
    return lines + _held_against(found)


def _machines(found: Answers) -> int:
    return len(set(found.results.machine.tolist()))


def _held_against(found: Answers) -> list[str]:
    """Which campaign it is held against, and in what that is another."""
    against = found.against
    if against is None:
        return []
    ours, theirs = found.results.spec, against.spec
    said = {
        "machines": [", ".join(arm.machine for arm in s.arms) for s in (ours, theirs)],
        "procedure": [s.procedure for s in (ours, theirs)],
        "duration": [f"{s.duration:g} s" for s in (ours, theirs)],
        "steady": [f"{s.steady:g} s" for s in (ours, theirs)],
        "runs": [f"{len(r.run)}" for r in (found.results, against)],
        "seed": [f"{s.seed}" for s in (ours, theirs)],
        "what is drawn": [
            "; ".join(f"{f.name} {f.distribution.words()}" for f in s.factors) or "nothing"
            for s in (ours, theirs)
        ],
    }
    differ = [f"{what} ({one} here, {other} there)" for what, (one, other) in said.items()
              if one != other]  # fmt: skip
    lines = [f"Held against {against.folder}: " + ("they differ in " + ", ".join(differ)
             if differ else "the same machines, duration and seed") + "."]  # fmt: skip
    if not set(found.results.metrics) & set(against.metrics):
        lines.append("They have no metric in common.")
    return lines


def verdicts(found: Answers) -> list[str]:
    """The comparisons as sentences: what is different, and by how much."""
    return [comparison_words(one) for one in found.comparisons]


def comparison_words(one: ArmComparison) -> str:
    """One comparison as a sentence."""
    words = METRICS[one.metric].words
    how = f"on {one.machines} machines that both met" if one.pairs else "on machines of their own"
    if one.ties == 1.0:
        return f"{words}: the same with {one.one} and {one.other} {how}."
    if not one.p < PROVEN:
        return f"{words}: no difference between {one.one} and {one.other} is proven {how}."
    ratio = one.ratio
    scale = (
        f"on average {ratio.value:.3g} ({ratio.low:.3g} to {ratio.high:.3g}) times that of "
        if math.isfinite(ratio.value)
        else "unlike that of "
    )
    return (
        f"{words}: with {one.other} {scale}{one.one}, {how}; smaller in {one.wins:.0%} of them "
        + (f"and the same in {one.ties:.0%} " if one.ties else "")
        + f"(p {_p(one.p)})."
    )


def spread_table(found: Answers) -> Rows:
    """Distribution of each metric."""
    rows = [_spread_row(spread) for spread in found.spreads]
    head = ("metric", "arm", "runs", "mean (95 %)", "median (95 %)", "95th percentile (95 %)")
    return head, rows


def point_table(found: Answers) -> Rows:
    """Distribution of each metric at each point of the grids."""
    grids = [factor for factor, _ in found.results.spec.grids]
    rows: list[list[str]] = []
    for one in found.points:
        metric = METRICS[one.metric]
        factor, unit = fitting(max(abs(one.median.value), abs(one.high.value)), metric.unit)
        at = [_number(value, grid.unit) for (_, value), grid in zip(one.at, grids, strict=True)]
        told = [_interval(value, factor) for value in (one.median, one.high)]
        rows.append([f"{one.metric} [{unit}]", one.arm, *at, f"{one.count}", *told])
    names = [grid.name for grid in grids]
    head = ("metric", "arm", *names, "runs", "median (95 %)", "95th percentile (95 %)")
    return head, rows


def nothing_proven(found: Answers) -> str:
    """What stands where no factor matters for certain."""
    machines, said = _machines(found), "No factor is proven to matter."
    if not found.results.spec.dispersed or machines >= A_BEGINNING:
        return said
    return f"{said} {machines} machines can hardly prove any: a dozen is a beginning."


def comparison_table(comparisons: Sequence[ArmComparison]) -> Rows:
    """Of two sets of runs, metric by metric."""
    rows = [
        [
            one.metric,
            f"{one.other} / {one.one}",
            f"{one.pairs}" if one.pairs else "unpaired",
            _interval(one.ratio, 1.0),
            f"{one.wins:.0%}",
            f"{one.ties:.0%}",
            _p(one.p),
        ]
        for one in comparisons
    ]
    head = ("metric", "of", "pairs", "ratio of means (95 %)", "smaller in", "the same in",
            "p, corrected")  # fmt: skip
    return head, rows


def condition_table(found: Answers) -> Rows:
    """Ratios of arms in the parts of a factor on which they depend."""
    units = {factor.name: factor.unit for factor in found.results.spec.factors}
    rows = [
        [
            one.metric,
            f"{one.other} / {one.one}",
            f"{one.factor} {_span(one.low, one.high, units[one.factor.strip('|')])}",
            f"{one.pairs}",
            _interval(one.ratio, 1.0),
        ]
        for one in found.conditions
    ]
    return ("metric", "of", "where", "pairs", "ratio of means (95 %)"), rows


def _span(low: float, high: float, unit: str) -> str:
    if low == high:
        return _number(low, unit)
    factor, name = fitting(max(abs(low), abs(high)), unit)
    tail = "" if name == "1" else f" {name}"
    return f"{low / factor:.3g} to {high / factor:.3g}{tail}"


def sensitivity_table(found: Answers) -> Rows:
    """Those that are no chance, the strongest first."""
    links = [one for one in found.sensitivities if one.certain]
    links.sort(key=lambda one: -abs(one.correlation.value))
    rows = [
        [one.metric, one.factor, one.arm, _interval(one.correlation, 1.0, "+")]
        for one in links[:LISTED]
    ]
    return ("metric", "goes with", "arm", "rank correlation (95 %)"), rows


def index_table(found: Answers) -> Rows:
    """Sobol indices that may be worth a word, metric by metric, the largest first."""
    order = {name: number for number, name in enumerate(found.results.metrics)}
    indices = [one for one in found.indices if one.total.high >= WORTH]
    indices.sort(key=lambda one: (order[one.metric], one.arm, -one.total.value))
    rows = [
        [one.metric, one.factor, one.arm, _interval(one.first, 1.0), _interval(one.total, 1.0)]
        for one in indices
    ]
    head = ("metric", "depends on", "arm", "alone: first-order index (95 %)",
            "with others, too: total index (95 %)")  # fmt: skip
    return head, rows


def worst_table(found: Answers) -> Rows:
    """The worst runs of each metric, and what is unusual about them."""
    units = {factor.name: factor.unit for factor in found.results.spec.factors}
    rows: list[list[str]] = []
    for one in found.worst:
        why = [_blamed(factor, units[factor.factor.strip("|")]) for factor in one.blamed]
        rows.append(
            [
                one.metric,
                f"{one.run}",
                one.arm,
                _number(one.value, METRICS[one.metric].unit),
                "; ".join(why) or "nothing that is known to matter is unusual about it",
            ]
        )
    return ("metric", "run", "arm", "value", "why, as far as the factors tell"), rows


def markdown(found: Answers) -> str:
    """The whole report without figures."""
    parts = [f"# {title(found)}", "", *(f"- {line}" for line in summary(found))]
    if found.comparisons:
        parts += ["", "## Compared", "", *(f"- {line}" for line in verdicts(found))]
        parts += ["", *_markdown_table(comparison_table(found.comparisons))]
    if found.conditions:
        parts += ["", CONDITIONS, "", *_markdown_table(condition_table(found))]
    parts += ["", "## Distributions", "", *_markdown_table(spread_table(found))]
    head, rows = sensitivity_table(found)
    parts += ["", "## What they depend on", ""]
    if found.indices:
        parts += [INDICES, ""]
        parts += [*_markdown_table(index_table(found)), ""]
    parts += _markdown_table((head, rows)) if rows else [nothing_proven(found)]
    if found.points:
        parts += ["", "## Over the grid", "", *_markdown_table(point_table(found))]
    parts += ["", "## Worst runs", "", *_markdown_table(worst_table(found))]
    return "\n".join(parts) + "\n"


def _markdown_table(rows: Rows) -> list[str]:
    head, cells = rows
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    # the size of a factor is written with bars, which would end a cell
    bare = ([cell.replace("|", "\\|") for cell in row] for row in cells)
    return [*lines, *("| " + " | ".join(row) + " |" for row in bare)]


def _spread_row(one: Spread) -> list[str]:
    metric = METRICS[one.metric]
    largest = max(abs(v) for v in (one.mean.value, one.median.value, one.high.value))
    factor, unit = fitting(largest, metric.unit)
    return [
        f"{one.metric} [{unit}]",
        one.arm,
        f"{one.count}",
        *(_interval(value, factor) for value in (one.mean, one.median, one.high)),
    ]


def _blamed(one: Blamed, unit: str) -> str:
    more = one.below >= one.above
    side, share = ("more", one.below) if more else ("less", one.above)
    return f"{one.factor} {_number(one.value, unit)}, {side} than in {share:.0%} of the runs"


def _interval(one: Interval, factor: float, sign: str = "") -> str:
    if not math.isfinite(one.value):
        return "none"
    value, low, high = (
        format(number / factor, f"{sign}.3g") for number in (one.value, one.low, one.high)
    )
    if math.isinf(one.high):
        return f"{value} (at least {low})" if math.isfinite(one.low) else value
    if math.isinf(one.low):
        return f"{value} (at most {high})"
    return value if math.isnan(one.low) else f"{value} ({low} to {high})"


def _number(value: float, unit: str) -> str:
    factor, name = fitting(abs(value), unit)
    return f"{value / factor:.3g}" + ("" if name == "1" else f" {name}")


def _p(value: float) -> str:
    return "below 1e-9" if value < 1e-9 else f"{value:.2g}"


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
