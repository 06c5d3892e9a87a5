"""One self-contained HTML page about a campaign, and its figures."""

from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from twin.campaigns.answers import Answers
from twin.campaigns.merit import METRICS
from twin.campaigns.results import Results
from twin.files import write_whole
from twin.report.campaign_words import (
    CONDITIONS,
    INDICES,
    comparison_table,
    conclusion,
    condition_table,
    constants,
    fixed_words,
    index_table,
    nothing_proven,
    point_table,
    sensitivity_table,
    spread_table,
    summary,
    title,
    worst_table,
)
from twin.report.style import (
    FIGURE,
    PALETTE,
    Drawing,
    PageTable,
    Part,
    foot,
    hash_of,
    opened,
    page,
    rendered,
)
from twin.units import fitting

SHOWN = 400
"""Points of a distribution that are drawn."""


def spread_figure(answers: Answers) -> Figure:
    """Share of runs below each value of each metric, an arm a line."""
    results = answers.results
    fixed = constants(answers)
    names = [name for name in dict.fromkeys(s.metric for s in answers.spreads) if name not in fixed]
    names = names or list(fixed)
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


def gain_figures(answers: Answers) -> list[Drawing]:
    """Each metric over the grid: panels of lines over one factor, shades over two; else none."""
    results, fixed = answers.results, constants(answers)
    grids = results.spec.grids
    names = [
        name
        for name, column in results.metrics.items()
        if name not in fixed and np.isfinite(column).any()
    ]
    if not names or not 1 <= len(grids) <= 2:
        return []
    if len(grids) == 1:
        band = "Median of each metric; the band holds 90 % of the runs."
        return [Drawing("over_the_grid", _lines(results, names), band)]
    return [
        Drawing(f"over_the_grid_{name}", _shades(results, name), f"Median of {name}.")
        for name in names
    ]


def _shades(results: Results, metric: str) -> Figure:
    arms, ((first, xs), (second, ys)) = results.spec.arms, results.spec.grids
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.2))
        panels = figure.subplots(1, len(arms), squeeze=False)[0]
        factor, unit = _scale(results, metric)
        grids = [
            np.array([[_median(results, metric, arm.name, {first.name: x, second.name: y})
                       for x in xs] for y in ys]) / factor
            for arm in arms
        ]  # fmt: skip
        low, high = float(np.nanmin(grids)), float(np.nanmax(grids))
        shades = ScalarMappable(Normalize(low, high), "viridis_r")
        for panel, arm, grid in zip(panels, arms, grids, strict=True):
            panel.imshow(grid, aspect="auto", origin="lower", cmap=shades.cmap, norm=shades.norm)
            panel.set_xticks(range(len(xs)), [f"{x:g}" for x in xs])
            panel.set_yticks(range(len(ys)), [f"{y:g}" for y in ys])
            panel.set_xlabel(f"{first.name} [{first.unit}]")
            panel.set_title(arm.name, fontsize=9)
            panel.grid(visible=False)
        panels[0].set_ylabel(f"{second.name} [{second.unit}]")
        figure.colorbar(shades, ax=list(panels), label=f"{metric} [{unit}]")
        return figure


def _lines(results: Results, metrics: list[str]) -> Figure:
    ((first, xs),) = results.spec.grids
    columns = 2 if len(metrics) > 1 else 1
    lines = -(-len(metrics) // columns)
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 0.5 + 2.2 * lines))
        panels = figure.subplots(lines, columns, squeeze=False, sharex=True).ravel()
        for panel, metric in zip(panels, metrics, strict=False):
            factor, unit = _scale(results, metric)
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
            panel.set_ylabel(metric if unit == "1" else f"{metric} [{unit}]", fontsize=8)
        for panel in panels[len(metrics) :]:
            panel.set_axis_off()
        for panel in panels[max(len(metrics) - columns, 0) : len(metrics)]:
            panel.set_xlabel(f"{first.name} [{first.unit}]")
            panel.tick_params(labelbottom=True)
        if len(results.spec.arms) > 1:
            panels[0].legend(fontsize=8)
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
    machines = {arm.platform.name: arm.platform for arm in spec.arms}
    facts = [f"specification of {results.folder.name}: {hash_of(spec.text.encode())}"]
    under = foot([], list(machines.values()), facts)
    return page(title(answers), rendered([*campaign_parts(answers), under]))


def campaign_parts(answers: Answers) -> list[Part]:
    """What the page is made of."""
    spec = answers.results.spec
    flown, *rest = summary(answers)
    answer, *more = [*conclusion(answers), flown] if conclusion(answers) else [flown]
    parts = opened(title(answers), flown, answer, [*more[:-1], *rest, *fixed_words(answers)])
    if answers.comparisons:
        fixed = constants(answers) if answers.against is None else {}
        told = [item for item in answers.comparisons if item.metric not in fixed]
        parts += ["<h2>Compared</h2>", PageTable("comparisons", *comparison_table(told))]
    if answers.conditions:
        parts += _folded(CONDITIONS.rstrip(":"), PageTable("conditions", *condition_table(answers)))
    if answers.points:
        parts += ["<h2>Over the grid</h2>", *gain_figures(answers)]
        parts += _folded("Each point of the grid", PageTable("grid", *point_table(answers)))
    parts += [
        "<h2>Distributions</h2>",
        Drawing(
            "distributions", spread_figure(answers), "Share of the runs that stay below each value."
        ),
        *_folded("As numbers", PageTable("distributions", *spread_table(answers))),
        "<h2>What they depend on</h2>",
    ]
    if answers.indices:
        parts.append(f"<p>{escape(INDICES)}</p>")
        parts.append(PageTable("sobol_indices", *index_table(answers)))
    for number, arm in enumerate(spec.arms):
        drawn = sensitivity_figure(answers, arm.name)
        if drawn is not None:
            caption = (
                f"{arm.name}: numbers are shown where the correlation is significant, corrected "
                "for all tests."
            )
            parts.append(Drawing(f"sensitivities_{number}", drawn, caption))
    head, rows = sensitivity_table(answers)
    if rows:
        parts += _folded("The strongest", PageTable("sensitivities", head, rows))
    else:
        parts.append(f"<p>{nothing_proven(answers)}</p>")
    again = f"twin replay {escape(answers.results.folder.name)} RUN --rrd OUT.rrd"
    parts += [
        "<h2>Worst runs</h2>",
        f"<p>To fly one again and record it: <code>{again}</code></p>",
        *_folded("Of each metric", PageTable("worst_runs", *worst_table(answers))),
        f"<details><summary>Specification</summary><pre>{escape(spec.text)}</pre></details>",
    ]
    return parts


def _folded(title: str, table: PageTable) -> list[Part]:
    """A long table that a click opens."""
    return [f"<details><summary>{escape(title)}</summary>", table, "</details>"]
