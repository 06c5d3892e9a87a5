"""A campaign as sentences and rows of tables, as Markdown and as JSON."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.campaigns.answers import Answers, Blamed, Spread
from twin.campaigns.merit import METRICS
from twin.campaigns.statistics import ArmComparison
from twin.interval import Interval
from twin.units import fitting, listed

Rows = tuple[tuple[str, ...], list[list[str]]]
"""Head and cells of a table."""

SHOWN = 3
"""Further metrics of an arm that the first sentence names."""
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


def title(answers: Answers) -> str:
    """Of a report."""
    return f"Campaign {answers.results.spec.path.parent.name or answers.results.folder.name}"


def summary(answers: Answers) -> list[str]:
    """What was flown and how it ended, a sentence each."""
    results, spec = answers.results, answers.results.spec
    machines = sorted({arm.platform.name for arm in spec.arms})
    runs, long = ("runs", "") if spec.procedure == "run" else ("balancings", "at most ")
    drawn = f", {_machines(answers)} machines" if spec.dispersed else ""
    lines = [
        f"{len(results.run)} of {spec.runs} {runs} of {', '.join(machines)} flown, {long}"
        f"{spec.duration:g} s each, {spec.sampling} samples{drawn}, seed {spec.seed}."
    ]
    for arm, ends in answers.ended.items():
        words = {"done": "balanced"} if spec.procedure == "balance" else {}
        counted = ", ".join(f"{n} {words.get(end, end)}" for end, n in sorted(ends.items()))
        lines.append(f"{arm}: {counted}.")
    for arm, count in answers.at_stop.items():
        angle = math.degrees(next(a.platform.stop_angle for a in spec.arms if a.name == arm))
        lines.append(
            f"{arm}: {count} touched the tilt stop at {angle:.3g} deg; what their metrics say is "
            "of the stop, too."
        )
    for reason, count, run in answers.reasons:
        lines.append(f"{count} did not come to their end: {reason} (the first is run {run}).")
    return lines + _held_against(answers)


def _machines(answers: Answers) -> int:
    return len(set(answers.results.machine.tolist()))


def _held_against(answers: Answers) -> list[str]:
    """Which campaign it is held against, and in what that is another."""
    against = answers.against
    if against is None:
        return []
    ours, theirs = answers.results.spec, against.spec
    said = {
        "machines": [", ".join(arm.machine for arm in s.arms) for s in (ours, theirs)],
        "procedure": [s.procedure for s in (ours, theirs)],
        "duration": [f"{s.duration:g} s" for s in (ours, theirs)],
        "steady": [f"{s.steady:g} s" for s in (ours, theirs)],
        "runs": [f"{len(r.run)}" for r in (answers.results, against)],
        "seed": [f"{s.seed}" for s in (ours, theirs)],
        "what is drawn": [
            "; ".join(f"{f.name} {f.distribution.words()}" for f in s.factors) or "nothing"
            for s in (ours, theirs)
        ],
    }
    differ = [f"{what} ({item} here, {other} there)" for what, (item, other) in said.items()
              if item != other]  # fmt: skip
    lines = [f"Held against {against.folder.name}: " + ("they differ in " + ", ".join(differ)
             if differ else "the same machines, duration and seed") + "."]  # fmt: skip
    if not set(answers.results.metrics) & set(against.metrics):
        lines.append("They have no metric in common.")
    return lines


def conclusion(answers: Answers) -> list[str]:
    """What the campaign says, the answer first: which arm, or which point of the grid, is better in
    the leading metric, and by how much; else how that metric is distributed.

    The leading metric is the first one of the specification that differs between runs.
    """
    lead = _leading(answers)
    if lead is None:
        return []
    said: list[str] = []
    pairs = dict.fromkeys((item.one, item.other) for item in answers.comparisons)
    for pair in pairs:
        of_pair = [c for c in answers.comparisons if (c.one, c.other) == pair]
        said += _better(of_pair, lead)
    said += _best_point(answers, lead)
    return said or _distribution(answers, lead)


def _leading(answers: Answers) -> str | None:
    fixed = constants(answers)
    known = [spread.metric for spread in answers.spreads]
    names = [name for name in answers.results.metrics if name in known and name not in fixed]
    return next((name for name in names if METRICS[name].worse), next(iter(names), None))


def constants(answers: Answers) -> dict[str, float]:
    """Metrics that are the same in every run, and their values."""
    columns = answers.results.metrics.items()
    known = {name: column[np.isfinite(column)] for name, column in columns}
    return {name: float(own[0]) for name, own in known.items() if len(own) > 1 and not np.ptp(own)}


def _better(comparisons: Sequence[ArmComparison], lead: str) -> list[str]:
    """Of two arms: which is better in the leading metric, and in how many of the others."""
    ranked = sorted(comparisons, key=lambda item: item.metric != lead)
    judged = [item for item in ranked if METRICS[item.metric].worse and item.ties < 1.0]
    if not judged:
        return []
    wins: dict[str, list[str]] = {judged[0].one: [], judged[0].other: []}
    for item in judged:
        if item.p < PROVEN:
            wins[_winner(item)].append(_times(item))
    first, *_ = judged
    where = f"on {first.machines} machines" + ("" if first.pairs else " each")
    if not first.p < PROVEN:
        start = (
            f"No difference in {METRICS[first.metric].words} between {first.one} and "
            f"{first.other} is proven {where} ({_ratio(first)})"
        )
    else:
        best = _winner(first)
        worst = first.one if best == first.other else first.other
        start = f"{best} is better than {worst}: {_times(first)}, {where}"
        wins[best].remove(_times(first))
    others = [
        f"{arm} has {listed([*own[:SHOWN], *more])}"
        for arm, own in wins.items()
        if (more := [f"{len(own) - SHOWN} more that are better"] if own[SHOWN:] else []) or own
    ]
    return [f"{start}; {'; '.join(others)}." if others else f"{start}."]


def _winner(comparison: ArmComparison) -> str:
    smaller = comparison.wins > 1.0 - comparison.wins - comparison.ties
    good = smaller if METRICS[comparison.metric].worse > 0 else not smaller
    return comparison.other if good else comparison.one


def _times(comparison: ArmComparison) -> str:
    """The winner's metric in parts of the other's."""
    ratio, words = comparison.ratio, METRICS[comparison.metric].words
    if not (math.isfinite(ratio.value) and ratio.low > 0.0):
        return f"another {words}"
    if _winner(comparison) == comparison.one:
        ratio = Interval(1.0 / ratio.value, 1.0 / ratio.high, 1.0 / ratio.low)
    return f"{_interval(ratio, 1.0)} times the {words}"


def _ratio(comparison: ArmComparison) -> str:
    if not math.isfinite(comparison.ratio.value):
        return f"p {_p(comparison.p)}"
    return f"ratio {_interval(comparison.ratio, 1.0)}"


def _best_point(answers: Answers, lead: str) -> list[str]:
    """Of each arm: where on the grid the leading metric's median is best, and where worst."""
    said: list[str] = []
    metric, several = METRICS[lead], len(answers.results.spec.arms) > 1
    units = {factor.name: factor.unit for factor, _ in answers.results.spec.grids}
    for arm in dict.fromkeys(point.arm for point in answers.points):
        points = [p for p in answers.points if p.arm == arm and p.metric == lead]
        points = [p for p in points if math.isfinite(p.median.value)]
        points.sort(key=lambda point: metric.worse * point.median.value)
        if len(points) < 2 or points[0].median.value == points[-1].median.value:
            continue
        factor, unit = fitting(abs(points[-1].median.value), metric.unit)
        best, worst = (
            f"{_interval(point.median, factor)}{'' if unit == '1' else f' {unit}'} at "
            + ", ".join(f"{name} {_number(value, units[name])}" for name, value in point.at)
            for point in (points[0], points[-1])
        )
        of = f" with {arm}" if several else ""
        side = "smallest" if metric.worse >= 0 else "largest"
        said.append(f"The median {metric.words}{of} is {side}, {best}; the worst is {worst}.")
    return said


def _distribution(answers: Answers, lead: str) -> list[str]:
    said: list[str] = []
    for spread in (item for item in answers.spreads if item.metric == lead):
        metric = METRICS[lead]
        factor, unit = fitting(max(abs(spread.median.value), abs(spread.high.value)), metric.unit)
        tail = "" if unit == "1" else f" {unit}"
        of = f" of {spread.arm}" if len(answers.results.spec.arms) > 1 else ""
        said.append(
            f"The {metric.words}{of} has a median of {_interval(spread.median, factor)}{tail}, and "
            f"95 % of the runs stay below {_interval(spread.high, factor)}{tail}."
        )
    return said


def verdicts(answers: Answers) -> list[str]:
    """The comparisons as sentences: what is different, and by how much."""
    fixed = constants(answers) if answers.against is None else {}
    return [comparison_words(item) for item in answers.comparisons if item.metric not in fixed]


def fixed_words(answers: Answers) -> list[str]:
    """Of metrics that have no distribution."""
    fixed = [
        f"{METRICS[name].words} {_number(value, METRICS[name].unit)}"
        for name, value in constants(answers).items()
    ]
    return [f"The same in every run: {', '.join(fixed)}."] if fixed else []


def comparison_words(comparison: ArmComparison) -> str:
    """One comparison as a sentence."""
    words = METRICS[comparison.metric].words
    how = (
        f"on {comparison.machines} machines that both met"
        if comparison.pairs
        else "on machines of their own"
    )
    if comparison.ties == 1.0:
        return f"{words}: the same with {comparison.one} and {comparison.other} {how}."
    if not comparison.p < PROVEN:
        return (
            f"{words}: no difference between {comparison.one} and {comparison.other} "
            f"is proven {how}."
        )
    ratio = comparison.ratio
    scale = (
        f"on average {ratio.value:.3g} ({ratio.low:.3g} to {ratio.high:.3g}) times that of "
        if math.isfinite(ratio.value)
        else "unlike that of "
    )
    return (
        f"{words}: with {comparison.other} {scale}{comparison.one}, {how}; "
        f"smaller in {comparison.wins:.0%} of them "
        + (f"and the same in {comparison.ties:.0%} " if comparison.ties else "")
        + f"(p {_p(comparison.p)})."
    )


def spread_table(answers: Answers) -> Rows:
    """Distribution of each metric."""
    fixed = constants(answers)
    rows = [_spread_row(spread) for spread in answers.spreads if spread.metric not in fixed]
    head = ("metric", "arm", "runs", "mean (95 %)", "median (95 %)", "95th percentile (95 %)")
    return head, rows


def point_table(answers: Answers) -> Rows:
    """Distribution of each metric at each point of the grids."""
    grids = [factor for factor, _ in answers.results.spec.grids]
    rows: list[list[str]] = []
    fixed = constants(answers)
    for point in (item for item in answers.points if item.metric not in fixed):
        metric = METRICS[point.metric]
        factor, unit = fitting(max(abs(point.median.value), abs(point.high.value)), metric.unit)
        at = [_number(value, grid.unit) for (_, value), grid in zip(point.at, grids, strict=True)]
        told = [_interval(value, factor) for value in (point.median, point.high)]
        rows.append([f"{point.metric} [{unit}]", point.arm, *at, f"{point.count}", *told])
    names = [grid.name for grid in grids]
    head = ("metric", "arm", *names, "runs", "median (95 %)", "95th percentile (95 %)")
    return head, rows


def nothing_proven(answers: Answers) -> str:
    """What stands where no factor matters for certain."""
    machines, said = _machines(answers), "No factor is proven to matter."
    if not answers.results.spec.dispersed or machines >= A_BEGINNING:
        return said
    return f"{said} {machines} machines can hardly prove any: a dozen is a beginning."


def comparison_table(comparisons: Sequence[ArmComparison]) -> Rows:
    """Of two sets of runs, metric by metric."""
    rows = [
        [
            comparison.metric,
            f"{comparison.other} / {comparison.one}",
            f"{comparison.pairs}" if comparison.pairs else "unpaired",
            _interval(comparison.ratio, 1.0),
            f"{comparison.wins:.0%}",
            f"{comparison.ties:.0%}",
            _p(comparison.p),
        ]
        for comparison in comparisons
    ]
    head = ("metric", "of", "pairs", "ratio of means (95 %)", "smaller in", "the same in",
            "p, corrected")  # fmt: skip
    return head, rows


def condition_table(answers: Answers) -> Rows:
    """Ratios of arms in the parts of a factor on which they depend."""
    units = {factor.name: factor.unit for factor in answers.results.spec.factors}
    rows = [
        [
            condition.metric,
            f"{condition.other} / {condition.one}",
            f"{condition.factor} "
            f"{_span(condition.low, condition.high, units[condition.factor.strip('|')])}",
            f"{condition.pairs}",
            _interval(condition.ratio, 1.0),
        ]
        for condition in answers.conditions
    ]
    return ("metric", "of", "where", "pairs", "ratio of means (95 %)"), rows


def _span(low: float, high: float, unit: str) -> str:
    if low == high:
        return _number(low, unit)
    factor, name = fitting(max(abs(low), abs(high)), unit)
    tail = "" if name == "1" else f" {name}"
    return f"{low / factor:.3g} to {high / factor:.3g}{tail}"


def sensitivity_table(answers: Answers) -> Rows:
    """Those that are no chance, the strongest first."""
    links = [sensitivity for sensitivity in answers.sensitivities if sensitivity.certain]
    links.sort(key=lambda item: -abs(item.correlation.value))
    rows = [
        [link.metric, link.factor, link.arm, _interval(link.correlation, 1.0, "+")]
        for link in links[:LISTED]
    ]
    return ("metric", "goes with", "arm", "rank correlation (95 %)"), rows


def index_table(answers: Answers) -> Rows:
    """Sobol indices that may be worth a word, metric by metric, the largest first."""
    order = {name: number for number, name in enumerate(answers.results.metrics)}
    indices = [index for index in answers.indices if index.total.high >= WORTH]
    indices.sort(key=lambda item: (order[item.metric], item.arm, -item.total.value))
    rows = [
        [
            index.metric,
            index.factor,
            index.arm,
            _interval(index.first, 1.0),
            _interval(index.total, 1.0),
        ]
        for index in indices
    ]
    head = ("metric", "depends on", "arm", "alone: first-order index (95 %)",
            "with others, too: total index (95 %)")  # fmt: skip
    return head, rows


def worst_table(answers: Answers) -> Rows:
    """The worst runs of each metric, and what is unusual about them."""
    units = {factor.name: factor.unit for factor in answers.results.spec.factors}
    rows: list[list[str]] = []
    for item in answers.worst:
        why = [_blamed(factor, units[factor.factor.strip("|")]) for factor in item.blamed]
        rows.append(
            [
                item.metric,
                f"{item.run}",
                item.arm,
                _number(item.value, METRICS[item.metric].unit),
                "; ".join(why) or "nothing that is known to matter is unusual about it",
            ]
        )
    return ("metric", "run", "arm", "value", "correlated factors"), rows


def markdown(answers: Answers) -> str:
    """The whole report without figures."""
    said = [*conclusion(answers), *summary(answers), *fixed_words(answers)]
    parts = [f"# {title(answers)}", "", *(f"- {line}" for line in said)]
    if answers.comparisons:
        parts += ["", "## Compared", "", *(f"- {line}" for line in verdicts(answers))]
        parts += ["", *_markdown_table(comparison_table(answers.comparisons))]
    if answers.conditions:
        parts += ["", CONDITIONS, "", *_markdown_table(condition_table(answers))]
    parts += ["", "## Distributions", "", *_markdown_table(spread_table(answers))]
    head, rows = sensitivity_table(answers)
    parts += ["", "## What they depend on", ""]
    if answers.indices:
        parts += [INDICES, ""]
        parts += [*_markdown_table(index_table(answers)), ""]
    parts += _markdown_table((head, rows)) if rows else [nothing_proven(answers)]
    if answers.points:
        parts += ["", "## Over the grid", "", *_markdown_table(point_table(answers))]
    parts += ["", "## Worst runs", "", *_markdown_table(worst_table(answers))]
    # names and reasons come from files that somebody may have shared; browsers take HTML from here
    return "\n".join(parts).replace("&", "&amp;").replace("<", "&lt;") + "\n"


def _markdown_table(rows: Rows) -> list[str]:
    head, cells = rows
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    # the size of a factor is written with bars, which would end a cell
    bare = ([cell.replace("|", "\\|") for cell in row] for row in cells)
    return [*lines, *("| " + " | ".join(row) + " |" for row in bare)]


def _spread_row(spread: Spread) -> list[str]:
    metric = METRICS[spread.metric]
    largest = max(abs(v) for v in (spread.mean.value, spread.median.value, spread.high.value))
    factor, unit = fitting(largest, metric.unit)
    return [
        f"{spread.metric} [{unit}]",
        spread.arm,
        f"{spread.count}",
        *(_interval(value, factor) for value in (spread.mean, spread.median, spread.high)),
    ]


def _blamed(blamed: Blamed, unit: str) -> str:
    more = blamed.below >= blamed.above
    side, share = ("more", blamed.below) if more else ("less", blamed.above)
    return f"{blamed.factor} {_number(blamed.value, unit)}, {side} than in {share:.0%} of the runs"


def _interval(interval: Interval, factor: float, sign: str = "") -> str:
    if not math.isfinite(interval.value):
        return "none"
    value, low, high = (
        format(number / factor, f"{sign}.3g")
        for number in (interval.value, interval.low, interval.high)
    )
    if math.isinf(interval.high):
        return f"{value} (at least {low})" if math.isfinite(interval.low) else value
    if math.isinf(interval.low):
        return f"{value} (at most {high})"
    if math.isnan(interval.low) or interval.low == interval.value == interval.high:
        return value
    return f"{value} ({low} to {high})"


def _number(value: float, unit: str) -> str:
    factor, name = fitting(abs(value), unit)
    return f"{value / factor:.3g}" + ("" if name == "1" else f" {name}")


def _p(value: float) -> str:
    return "below 1e-9" if value < 1e-9 else f"{value:.2g}"


def campaign_document(answers: Answers) -> dict[str, Any]:
    """One document; what is not known is null when it is printed."""
    results, spec = answers.results, answers.results.spec
    units = {factor.name: factor.unit for factor in spec.factors}
    return {
        "runs": len(results.run),
        "of": spec.runs,
        "ended": answers.ended,
        "reasons": [
            {"reason": reason, "count": count, "first_run": run}
            for reason, count, run in answers.reasons
        ],
        "metrics": [
            {
                "arm": spread.arm,
                "metric": spread.metric,
                "unit": METRICS[spread.metric].unit,
                "count": spread.count,
                "mean": spread.mean.document(),
                "median": spread.median.document(),
                "percentile_95": spread.high.document(),
            }
            for spread in answers.spreads
        ],
        "points": [
            {
                "arm": point.arm,
                "at": dict(point.at),
                "metric": point.metric,
                "unit": METRICS[point.metric].unit,
                "count": point.count,
                "median": point.median.document(),
                "percentile_95": point.high.document(),
            }
            for point in answers.points
        ],
        "touched_the_stop": answers.at_stop,
        "sensitivities": [
            {
                "arm": sensitivity.arm,
                "metric": sensitivity.metric,
                "factor": sensitivity.factor,
                "rank_correlation": sensitivity.correlation.document(),
                "certain": sensitivity.certain,
            }
            for sensitivity in answers.sensitivities
        ],
        "sobol_indices": [
            {
                "arm": index.arm,
                "metric": index.metric,
                "factor": index.factor,
                "first_order": index.first.document(),
                "total": index.total.document(),
                "points": index.count,
            }
            for index in answers.indices
        ],
        "comparisons": [
            {
                "one": comparison.one,
                "other": comparison.other,
                "metric": comparison.metric,
                "pairs": comparison.pairs,
                "machines": comparison.machines,
                "ratio_of_means": comparison.ratio.document(),
                "smaller_in": comparison.wins,
                "same_in": comparison.ties,
                "p": comparison.p,
            }
            for comparison in answers.comparisons
        ],
        "conditions": [
            {
                "one": condition.one,
                "other": condition.other,
                "metric": condition.metric,
                "factor": condition.factor,
                "low": condition.low,
                "high": condition.high,
                "unit": units[condition.factor.strip("|")],
                "pairs": condition.pairs,
                "ratio_of_means": condition.ratio.document(),
            }
            for condition in answers.conditions
        ],
        "worst": [
            {
                "run": item.run,
                "arm": item.arm,
                "metric": item.metric,
                "value": item.value,
                "unit": METRICS[item.metric].unit,
                "blamed": [
                    {
                        "factor": blamed.factor,
                        "value": blamed.value,
                        "unit": units[blamed.factor.strip("|")],
                        "share_below": blamed.below,
                        "share_above": blamed.above,
                    }
                    for blamed in item.blamed
                ],
            }
            for item in answers.worst
        ],
    }
