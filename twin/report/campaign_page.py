"""One self-contained HTML page about a campaign."""

from html import escape
from pathlib import Path

import numpy as np

from twin.campaigns.answers import Answers
from twin.report.campaign_figures import gain_figure, sensitivity_figure, spread_figure
from twin.report.campaign_words import (
    CONDITIONS,
    INDICES,
    Rows,
    comparison_table,
    condition_table,
    index_table,
    nothing_proven,
    point_table,
    sensitivity_table,
    spread_table,
    summary,
    title,
    verdicts,
    worst_table,
)
from twin.report.foot import foot
from twin.report.style import bullets, framed, page, table
from twin.whole_file import write_whole


def write_campaign_page(path: Path, found: Answers) -> None:
    """Write the page."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, campaign_page(found))


def campaign_page(found: Answers) -> str:
    """The page as text."""
    results, spec = found.results, found.results.spec
    first, *rest = summary(found)
    parts = [f"<h1>{escape(title(found))}</h1>", f"<p class='verdict'>{escape(first)}</p>"]
    parts.append(bullets(rest))
    if found.comparisons:
        parts += ["<h2>Compared</h2>", bullets(verdicts(found))]
        parts.append(_table(comparison_table(found.comparisons)))
    if found.conditions:
        parts.append(f"<p>{escape(CONDITIONS)}</p>")
        parts.append(_table(condition_table(found)))
    parts += [
        "<h2>Distributions</h2>",
        framed(spread_figure(found), "Share of the runs that stay below each value."),
        _table(spread_table(found)),
        "<h2>What they depend on</h2>",
    ]
    if found.indices:
        parts.append(f"<p>{escape(INDICES)}</p>")
        parts.append(_table(index_table(found)))
    for arm in spec.arms:
        drawn = sensitivity_figure(found, arm.name)
        if drawn is not None:
            caption = f"{arm.name}: numbers stand where it is no chance, among all that were asked."
            parts.append(framed(drawn, caption))
    head, rows = sensitivity_table(found)
    parts.append(_table((head, rows)) if rows else f"<p>{nothing_proven(found)}</p>")
    maps = [(name, gain_figure(results, name)) for name in results.metrics
            if np.isfinite(results.metrics[name]).any()]  # fmt: skip
    if found.points:
        parts.append("<h2>Over the grid</h2>")
        parts.append(_table(point_table(found)))
        band = "; the band holds 90 % of the runs" if len(spec.grids) == 1 else ""
        parts += [framed(drawn, f"Median of {name}{band}.") for name, drawn in maps if drawn]
    parts += ["<h2>Worst runs</h2>", _table(worst_table(found))]
    parts.append(f"<p>Again, and in full: <code>twin replay {escape(str(results.folder))} RUN "
                 "--rrd OUT.rrd</code></p>")  # fmt: skip
    parts += ["<h2>Specification</h2>", f"<pre>{escape(spec.text)}</pre>"]
    parts.append(foot([], None))
    return page(title(found), "\n".join(parts))


def _table(rows: Rows) -> str:
    head, cells = rows
    return table(head, cells)
