"""Sentences, documents and pages of experiments: isolability, excitation, checks, calibration."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from twin.experiments.isolation import Alternative, CauseIsolation, Isolation
from twin.report.style import FIGURE, Drawing, PageTable, Part, foot, opened, page, rendered
from twin.units import listed, printed, three_digits

MOST_PAIRS = 12
"""Tied pairs that the text lists."""
CELL = 0.19
"""Of the matrix [in]."""


def isolation_sentences(result: Isolation) -> list[str]:
    """What `twin isolate` prints."""
    run, shown = result.run, [c for c in result.causes if np.isfinite(c.detectable)]
    lines = [
        f"{run.platform.name}: {run.words}, {run.duration:g} s, with {listed(result.streams)}",
        "95 % half widths with no further cause: " + ", ".join(_base(result)),
        "",
        f"{'cause':<32}  {'detectable from':<24}  {'separable from':<24}  confused with",
    ]
    for cause in shown:
        separable = "at no size" if np.isinf(cause.separable) else _size(cause, cause.separable)
        ties = ", ".join(cause.ties) or "-"
        size = _size(cause, cause.detectable)
        lines.append(f"{cause.label:<32}  {size:<24}  {separable:<24}  {ties}")
    hidden = [cause.label for cause in result.causes if np.isinf(cause.detectable)]
    lines += ["", f"Detectable means an evidence of {result.evidence:g}, of each component alike."]
    if hidden:
        lines.append("Not detectable at any size: " + ", ".join(_grouped(hidden)) + ".")
    lines.append(_ties(result))
    better = [a for a in result.alternatives if a.kind != "without" and (a.separates or _finer(a))]
    if better:
        lines += ["", "What would help:"]
        lines += [f"  {sentence}" for sentence in map(_alternative, better)]
    needed = [a for a in result.alternatives if a.kind == "without"]
    if needed:
        lines += ["", "What each sensor is worth:"]
        lines += [f"  {_without(item)}" for item in needed]
    return lines


def _finer(item: Alternative) -> bool:
    return item.ratio < 0.9


def _base(result: Isolation) -> list[str]:
    return [f"{name} {printed(half, unit)}" for name, (half, unit) in result.base.items()]


def _size(cause: CauseIsolation, multiple: float) -> str:
    """Of the first amplitude of each unit."""
    kinds = dict.fromkeys(cause.units)
    first = [cause.units.index(unit) for unit in kinds]
    return ", ".join(printed(multiple * float(cause.usual[i]), cause.units[i]) for i in first)


def _grouped(labels: Sequence[str]) -> list[str]:
    """`nozzle_gain (16 targets)` for many targets of one effect."""
    result: list[str] = []
    for name, group in groupby(labels, key=lambda label: label.partition(":")[0]):
        several = list(group)
        result.append(f"{name} ({len(several)} targets)" if len(several) > 3 else listed(several))
    return result


def _ties(result: Isolation) -> str:
    pairs = result.ties
    if not pairs:
        return "No two detectable causes are confused."
    some = "; ".join(" with ".join(pair) for pair in pairs[:MOST_PAIRS])
    more = f"; and {len(pairs) - MOST_PAIRS} more" if len(pairs) > MOST_PAIRS else ""
    noun = "pair" if len(pairs) == 1 else "pairs"
    return f"{len(pairs)} {noun} confused at the detectable size: {some}{more}."


def _alternative(item: Alternative) -> str:
    said = f"{item.words}: detectable sizes x {three_digits(item.ratio)} in the median"
    if item.separates:
        some = "; ".join(" from ".join(pair) for pair in item.separates[:3])
        more = f" and {len(item.separates) - 3} more pairs" if len(item.separates) > 3 else ""
        said += f", separates {some}{more}"
    if item.lost:
        said += f", but does not detect {', '.join(_grouped(item.lost))}"
    return said


def _without(item: Alternative) -> str:
    lost = f", {', '.join(_grouped(item.lost))} undetectable" if item.lost else ""
    return f"{item.words}: detectable sizes x {three_digits(item.ratio)}, {item.ties} ties{lost}"


def isolation_document(result: Isolation) -> Mapping[str, Any]:
    """For `--json`; SI."""
    labels = [cause.label for cause in result.causes]
    return {
        "platform": result.run.platform.name,
        "command": result.run.command,
        "duration": result.run.duration,
        "streams": result.streams,
        "evidence": result.evidence,
        "base_half_widths": {name: half for name, (half, _) in result.base.items()},
        "causes": [
            {
                "cause": cause.label,
                "parameters": cause.parameters,
                "units": cause.units,
                "detectable": cause.size,
                "detectable_alone": cause.each,
                "usual": cause.usual,
                "separable": cause.separable * cause.usual,
                "confused_with": cause.ties,
            }
            for cause in result.causes
        ],
        "behind": {"causes": labels, "evidence": result.behind},
        "not_asked": dict(result.not_asked),
        "alternatives": [
            {
                "words": item.words,
                "kind": item.kind,
                "detected": item.detected,
                "ties": item.ties,
                "ratio": item.ratio,
                "separates": item.separates,
                "undetected": item.lost,
            }
            for item in result.alternatives
        ],
    }


def isolation_figure(result: Isolation) -> Figure:
    """The matrix of evidence by which one cause in place of another is behind."""
    shown = [i for i, cause in enumerate(result.causes) if np.isfinite(cause.detectable)]
    labels = [result.causes[i].label for i in shown]
    behind = result.behind[np.ix_(shown, shown)]
    with mpl.rc_context(FIGURE):
        edge = max(CELL * len(shown) + 3.4, 5.5)
        figure = Figure(figsize=(edge + 0.8, edge))
        panel = figure.subplots()
        panel.grid(visible=False)
        drawn = panel.imshow(
            np.ma.masked_invalid(behind), cmap="viridis", vmin=0.0, vmax=result.evidence
        )
        places = np.arange(len(shown))
        panel.set_xticks(places, labels, rotation=90, fontsize=7)
        panel.set_yticks(places, labels, fontsize=7)
        panel.set_xlabel("explained by")
        panel.set_ylabel("true cause, at its detectable size")
        bar = figure.colorbar(drawn, ax=panel, shrink=0.6)
        bar.set_label("evidence by which it is behind")
        return figure


def isolation_parts(result: Isolation) -> list[Part]:
    """What the page is made of."""
    run = result.run
    shown = [cause for cause in result.causes if np.isfinite(cause.detectable)]
    rows = [
        [
            cause.label,
            _size(cause, cause.detectable),
            _size(cause, 1.0),
            "at no size" if np.isinf(cause.separable) else _size(cause, cause.separable),
            ", ".join(cause.ties),
        ]
        for cause in shown
    ]
    others = [
        [
            item.words,
            str(item.detected),
            str(item.ties),
            three_digits(item.ratio),
            "; ".join(" from ".join(pair) for pair in item.separates),
        ]
        for item in result.alternatives
    ]
    hidden = [cause.label for cause in result.causes if np.isinf(cause.detectable)]
    under = f"{run.platform.title} · {run.words} · {run.duration:g} s"
    answer = f"{len(shown)} of {len(result.causes)} causes are detectable. {_ties(result)}"
    rest = [f"95 % half widths with no further cause: {', '.join(_base(result))}."]
    if hidden:
        rest.append(f"Not detectable at any size: {', '.join(_grouped(hidden))}.")
    return [
        *opened(f"What this experiment could tell of {run.platform.name}", under, answer, rest),
        "<h2>Which causes it confuses</h2>",
        Drawing(
            "isolation",
            isolation_figure(result),
            "Evidence by which a cause (column) in place of the true one (row) is behind. Dark: "
            "the experiment cannot tell them apart.",
        ),
        "<h2>Detectable sizes</h2>",
        PageTable(
            "detectable",
            [
                "cause",
                f"detectable (evidence {result.evidence:g})",
                "usual",
                "separable from",
                "confused with",
            ],
            rows,
        ),
        "<h2>Other sensors and motions</h2>",
        PageTable(
            "alternatives",
            ["experiment", "causes detected", "ties", "sizes x", "separates"],
            others,
        ),
    ]


def isolation_page(result: Isolation) -> str:
    """The page as text."""
    title = f"What an experiment could tell of {result.run.platform.name}"
    return page(title, rendered([*isolation_parts(result), foot([], [result.run.platform])]))
