"""A log drawn: one panel a stream, as PNG, SVG, or a page."""

from dataclasses import replace
from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.files import whole, write_whole
from twin.noise.stream import GAP
from twin.report.contents import Contents, StreamContents, contents_words
from twin.report.style import FIGURE, MISSING, PALETTE, Drawing, Part, foot, page, rendered
from twin.units import fitting

Array = NDArray[np.float64]

ENDINGS = (".png", ".svg", ".html")
BINS = 1000
"""Of a longer stream the least and the greatest value of each bin are drawn: no peak is lost."""
MARKED = 200
"""Gaps of a stream that are marked, the longest."""
LEGEND_COLUMNS = 5
"""Names of columns that fit into a row above a panel."""


def draw_contents(contents: Contents, path: Path) -> None:
    """Write the picture.

    Raises:
        UsageError: a file of another format, or one that cannot be written.
    """
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: a picture ends in one of {', '.join(ENDINGS)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure = contents_figure(contents)
        with mpl.rc_context(FIGURE):
            if path.suffix.lower() == ".html":
                write_whole(path, contents_page(contents, figure))
            else:
                with whole(path) as file:
                    figure.savefig(file, format=path.suffix[1:].lower(), dpi=130)
    except OSError as problem:
        raise UsageError(f"{path} cannot be written ({problem.strerror})") from None


def contents_page(contents: Contents, figure: Figure | None = None) -> str:
    """The page as text."""
    name = Path(contents.source).name or contents.source
    words = contents_words(replace(contents, source=name))
    parts: list[Part] = [
        f"<h1>{escape(name)}</h1>",
        Drawing("streams", figure or contents_figure(contents)),
        f"<pre>{escape(words)}</pre>",
        foot([contents.recording], []),
    ]
    return page(name, rendered(parts))


def contents_figure(contents: Contents) -> Figure:
    """One panel a stream that changes."""
    with mpl.rc_context(FIGURE):
        return _panels(contents)


def _panels(contents: Contents) -> Figure:
    rows = [stream for stream in contents.streams if len(stream.series)]
    streams = [stream for stream in rows if not stream.still] or rows
    heights = [1.5 + 0.2 * _legend_rows(stream) for stream in streams] or [1.7]
    figure = Figure(figsize=(9.6, 0.6 + sum(heights)))
    panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[
        :, 0
    ]
    for panel, stream in zip(panels, streams, strict=False):
        _draw(panel, stream, contents.recording.stop)
    panels[-1].set_xlabel("time [s]")
    return figure


def _legend_rows(stream: StreamContents) -> int:
    return -(-len(stream.shown[0]) // LEGEND_COLUMNS)


def _draw(panel: Axes, stream: StreamContents, stop: float) -> None:
    columns, values, unit = stream.shown
    factor, name = fitting(float(np.abs(values).max()), unit)
    times, period = stream.series.time, stream.noise.clock.period
    if not stream.clocked:
        # the last value holds to the end of the log
        times, values, period = np.append(times, stop), np.vstack([values, values[-1:]]), np.inf
    for index, column in enumerate(columns):
        time, value = _thinned(times, values[:, index] / factor, period)
        panel.plot(
            time,
            value,
            color=PALETTE[index % len(PALETTE)],
            label=column,
            drawstyle="steps-post" if stream.held else "default",
            marker="." if len(time) < 2 else "",
        )
    for start, stop in stream.gaps[:MARKED]:
        panel.axvspan(start, stop, color=MISSING, zorder=0, lw=0)
    panel.set_title(stream.name, loc="left", fontsize=10)
    panel.set_ylabel("" if name == "1" else name)
    panel.legend(
        ncols=min(len(columns), LEGEND_COLUMNS),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
    )


def _thinned(time: Array, value: Array, period: float) -> tuple[Array, Array]:
    """At most two points a bin, with a break in the line at every gap."""
    reach = GAP * period
    if len(time) > 2 * BINS:
        width = (time[-1] - time[0]) / BINS
        edges = np.unique(np.searchsorted(time, time[0] + width * np.arange(BINS)))
        rows: set[int] = set()
        for first, part in zip(edges, np.split(value, edges[1:]), strict=True):
            rows |= {int(first + part.argmin()), int(first + part.argmax())}
        kept = sorted(rows)
        time, value, reach = time[kept], value[kept], max(reach, 2.0 * width)
    breaks = np.flatnonzero(np.diff(time) > reach) + 1
    return np.insert(time, breaks, np.nan), np.insert(value, breaks, np.nan)
