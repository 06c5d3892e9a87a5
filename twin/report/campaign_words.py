"""What a campaign says, as sentences and rows of tables; and as Markdown."""

import math
from collections.abc import Sequence

from twin.campaign.answers import Answers, Blamed, Spread
from twin.campaign.comparison import Comparison
from twin.campaign.merit import METRICS
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
PROVEN = 0.05
"""Level of significance, of p-values that are corrected for their number."""


def title(found: Answers) -> str:
    """Of a report."""
    return f"Campaign {found.results.spec.path.parent.name or found.results.folder.name}"


def summary(found: Answers) -> list[str]:
    """What was flown and how it ended, a sentence each."""
    results, spec = found.results, found.results.spec
    machines = sorted({arm.platform.name for arm in spec.arms})
    what = "balanced" if spec.procedure == "balance" else "flown"
    lines = [
        f"{len(results.run)} of {spec.runs} runs of {', '.join(machines)} {what}, "
        f"{spec.duration:g} s each, {spec.sampling} samples, seed {spec.seed}."
    ]
    for arm, ends in found.ended.items():
        counted = ", ".join(f"{count} {end}" for end, count in sorted(ends.items()))
        lines.append(f"{arm}: {counted}.")
    for reason, count, run in found.reasons:
        lines.append(f"{count} did not come to their end: {reason} (the first is run {run}).")
    return lines


def verdicts(found: Answers) -> list[str]:
    """The comparisons as sentences: what is different, and by how much."""
    return [comparison_words(one) for one in found.comparisons]


def comparison_words(one: Comparison) -> str:
    """One comparison as a sentence."""
    words = METRICS[one.metric].words
    how = f"on {one.machines} machines that both met" if one.pairs else "on machines of their own"
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
        f"(p {_p(one.p)})."
    )


def spread_table(found: Answers) -> Rows:
    """Distribution of each metric."""
    rows = [_spread_row(spread) for spread in found.spreads]
    head = ("metric", "arm", "runs", "mean (95 %)", "median (95 %)", "95th percentile (95 %)")
    return head, rows


def comparison_table(comparisons: Sequence[Comparison]) -> Rows:
    """Of two sets of runs, metric by metric."""
    rows = [
        [
            one.metric,
            f"{one.other} / {one.one}",
            f"{one.pairs}" if one.pairs else "unpaired",
            _interval(one.ratio, 1.0),
            f"{one.wins:.0%}",
            _p(one.p),
        ]
        for one in comparisons
    ]
    return ("metric", "of", "pairs", "ratio of means (95 %)", "smaller in", "p, corrected"), rows


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
        parts += ["", *_table(comparison_table(found.comparisons))]
    if found.conditions:
        parts += ["", CONDITIONS, "", *_table(condition_table(found))]
    parts += ["", "## Distributions", "", *_table(spread_table(found))]
    head, rows = sensitivity_table(found)
    parts += ["", "## What they depend on", ""]
    if found.indices:
        parts += [INDICES, ""]
        parts += [*_table(index_table(found)), ""]
    parts += _table((head, rows)) if rows else ["No factor is proven to matter."]
    parts += ["", "## Worst runs", "", *_table(worst_table(found))]
    return "\n".join(parts) + "\n"


def _table(rows: Rows) -> list[str]:
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
    value = format(one.value / factor, f"{sign}.3g")
    if not math.isfinite(one.low):
        return value
    low, high = (format(end / factor, f"{sign}.3g") for end in (one.low, one.high))
    return f"{value} ({low} to {high})"


def _number(value: float, unit: str) -> str:
    factor, name = fitting(abs(value), unit)
    return f"{value / factor:.3g}" + ("" if name == "1" else f" {name}")


def _p(value: float) -> str:
    return "below 1e-9" if value < 1e-9 else f"{value:.2g}"
