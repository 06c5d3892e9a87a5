"""One self-contained HTML page about a campaign, and its figures."""

from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.campaigns.answers import Answers
from twin.campaigns.merit import METRICS
from twin.campaigns.results import Results
from twin.files import write_whole
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
from twin.report.style import FIGURE, PALETTE, SOFT, bullets, foot, framed, page, table
from twin.units import fitting

Array = NDArray[np.float64]

SHOWN = 400
"""Points of a distribution that are drawn."""


def spread_figure(answers: Answers) -> Figure:
    """Share of runs below each value of each metric, an arm a line."""
    results = answers.results
    names = list(dict.fromkeys(spread.metric for spread in answers.spreads))
    with mpl.rc_context(FIGURE):
        columns = 3
        lines = -(-len(names) // columns)
        figure = Figure(figsize=(9.6, 0.5 + 2.2 * lines))
        panels = figure.subplots(lines, columns, squeeze=False, sharey=True).ravel()
        for panel, name in zip(panels, names, strict=False):
            column = results.metrics[name]
            size = float(np.nanpercentile(np.abs(column), 95.0))
            factor, unit = fitting(size, METRICS[name].unit)
            for arm, color in zip(results.spec.arms, PALETTE, strict=False):
                own = column[results.of(arm.name)]
                values = np.sort(own[np.isfinite(own)])
                if not values.size:
                    continue
                share = np.linspace(0.0, 1.0, min(SHOWN, max(values.size, 2)))
                drawn = np.quantile(values, share, method="inverted_cdf") / factor
                panel.plot(drawn, share, color=color, label=arm.name)
            panel.set_xlabel(f"{name} [{unit}]", fontsize=8)
        for panel in panels[len(names) :]:
            panel.set_axis_off()
        for panel in panels[::columns]:
            panel.set_ylabel("share of runs")
        if len(results.spec.arms) > 1:
            panels[0].legend(loc="lower right", fontsize=8)
        return figure


def sensitivity_figure(answers: Answers, arm: str) -> Figure | None:
    """Rank correlation of each metric with each factor; None where there is none."""
    links = [sensitivity for sensitivity in answers.sensitivities if sensitivity.arm == arm]
    if not links:
        return None
    metrics = list(dict.fromkeys(link.metric for link in links))
    factors = list(dict.fromkeys(link.factor for link in links))
    grid = np.full((len(metrics), len(factors)), np.nan)
    for link in links:
        grid[metrics.index(link.metric), factors.index(link.factor)] = link.correlation.value
    sure = {(link.metric, link.factor) for link in links if link.certain}
    with mpl.rc_context({**FIGURE, "axes.grid": False}):
        figure = Figure(figsize=(9.6, 2.2 + 0.32 * len(metrics)))
        panel = figure.subplots()
        shades = panel.imshow(grid, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
        panel.set_xticks(range(len(factors)), [_short(name) for name in factors], rotation=40)
        for label in panel.get_xticklabels():
            label.set_horizontalalignment("right")
        panel.set_yticks(range(len(metrics)), metrics)
        panel.tick_params(labelsize=8)
        for row, metric in enumerate(metrics):
            for column, factor in enumerate(factors):
                if (metric, factor) in sure:
                    value = grid[row, column]
                    ink = "white" if abs(value) > 0.6 else "black"
                    panel.text(
                        column, row, f"{value:.2f}", ha="center", va="center", color=ink, fontsize=7
                    )
        figure.colorbar(shades, ax=panel, label="rank correlation")
        return figure


def gain_figure(results: Results, metric: str) -> Figure | None:
    """Median of a metric over the grid: lines over one factor, shades over two; else None."""
    grids = results.spec.grids
    if not 1 <= len(grids) <= 2 or metric not in results.metrics:
        return None
    with mpl.rc_context(FIGURE):
        arms = results.spec.arms
        if len(grids) == 1:
            figure = Figure(figsize=(9.6, 3.2))
            return _line(figure, results, metric)
        figure = Figure(figsize=(9.6, 0.6 + 3.0 * len(arms)))
        panels = figure.subplots(len(arms), 1, squeeze=False)[:, 0]
        (first, xs), (second, ys) = grids
        factor, unit = _scale(results, metric)
        for panel, arm in zip(panels, arms, strict=True):
            grid = np.array([[_median(results, metric, arm.name, {first.name: x, second.name: y})
                              for x in xs] for y in ys])  # fmt: skip
            shades = panel.imshow(grid / factor, aspect="auto", origin="lower", cmap="viridis_r")
            panel.set_xticks(range(len(xs)), [f"{x:g}" for x in xs])
            panel.set_yticks(range(len(ys)), [f"{y:g}" for y in ys])
            panel.set_xlabel(f"{first.name} [{first.unit}]")
            panel.set_ylabel(f"{second.name} [{second.unit}]")
            panel.set_title(arm.name, fontsize=9)
            panel.grid(visible=False)
            figure.colorbar(shades, ax=panel, label=f"{metric} [{unit}]")
        return figure


def _line(figure: Figure, results: Results, metric: str) -> Figure:
    ((first, xs),) = results.spec.grids
    factor, unit = _scale(results, metric)
    panel = figure.subplots()
    for arm, color in zip(results.spec.arms, PALETTE, strict=False):
        rows = results.of(arm.name)
        bands = [
            np.nanpercentile(
                results.metrics[metric][rows[results.factors[first.name][rows] == x]],
                [5.0, 50.0, 95.0],
            )
            / factor
            for x in xs
        ]
        low, middle, high = np.array(bands).T
        panel.fill_between(xs, low, high, color=color, alpha=0.15, lw=0.0)
        panel.plot(xs, middle, "o-", color=color, ms=4, label=arm.name)
    panel.set_xlabel(f"{first.name} [{first.unit}]")
    panel.set_ylabel(f"{metric} [{unit}]")
    panel.axhline(0.0, color=SOFT, lw=0.5)
    if len(results.spec.arms) > 1:
        panel.legend()
    return figure


def _median(results: Results, metric: str, arm: str, at: dict[str, float]) -> float:
    rows = results.of(arm)
    for name, value in at.items():
        rows = rows[results.factors[name][rows] == value]
    known = results.metrics[metric][rows]
    known = known[np.isfinite(known)]
    return float(np.median(known)) if known.size else np.nan


def _scale(results: Results, metric: str) -> tuple[float, str]:
    size = float(np.nanmedian(np.abs(results.metrics[metric])))
    return fitting(size, METRICS[metric].unit)


def _short(name: str) -> str:
    plain = name.strip("|").split(".", 1)[1]
    return f"|{plain}|" if name.startswith("|") else plain


def write_campaign_page(path: Path, answers: Answers) -> None:
    """Write the page."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, campaign_page(answers))


def campaign_page(answers: Answers) -> str:
    """The page as text."""
    results, spec = answers.results, answers.results.spec
    first, *rest = summary(answers)
    parts = [f"<h1>{escape(title(answers))}</h1>", f"<p class='verdict'>{escape(first)}</p>"]
    parts.append(bullets(rest))
    if answers.comparisons:
        parts += ["<h2>Compared</h2>", bullets(verdicts(answers))]
        parts.append(_table(comparison_table(answers.comparisons)))
    if answers.conditions:
        parts.append(f"<p>{escape(CONDITIONS)}</p>")
        parts.append(_table(condition_table(answers)))
    parts += [
        "<h2>Distributions</h2>",
        framed(spread_figure(answers), "Share of the runs that stay below each value."),
        _table(spread_table(answers)),
        "<h2>What they depend on</h2>",
    ]
    if answers.indices:
        parts.append(f"<p>{escape(INDICES)}</p>")
        parts.append(_table(index_table(answers)))
    for arm in spec.arms:
        drawn = sensitivity_figure(answers, arm.name)
        if drawn is not None:
            caption = f"{arm.name}: numbers stand where it is no chance, among all that were asked."
            parts.append(framed(drawn, caption))
    head, rows = sensitivity_table(answers)
    parts.append(_table((head, rows)) if rows else f"<p>{nothing_proven(answers)}</p>")
    maps = [(name, gain_figure(results, name)) for name in results.metrics
            if np.isfinite(results.metrics[name]).any()]  # fmt: skip
    if answers.points:
        parts.append("<h2>Over the grid</h2>")
        parts.append(_table(point_table(answers)))
        band = "; the band holds 90 % of the runs" if len(spec.grids) == 1 else ""
        parts += [framed(drawn, f"Median of {name}{band}.") for name, drawn in maps if drawn]
    parts += ["<h2>Worst runs</h2>", _table(worst_table(answers))]
    parts.append(f"<p>Again, and in full: <code>twin replay {escape(str(results.folder))} RUN "
                 "--rrd OUT.rrd</code></p>")  # fmt: skip
    parts += ["<h2>Specification</h2>", f"<pre>{escape(spec.text)}</pre>"]
    parts.append(foot([], None))
    return page(title(answers), "\n".join(parts))


def _table(rows: Rows) -> str:
    head, cells = rows
    return table(head, cells)
