"""A log drawn: one panel a stream, as PNG, SVG, or a page."""

from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.noise.clock import GAP
from twin.report.contents import Contents, StreamContents, contents_words
from twin.report.style import FIGURE, MISSING, PALETTE, page, svg
from twin.units import fitting
from twin.whole_file import whole, write_whole

Array = NDArray[np.float64]

ENDINGS = (".png", ".svg", ".html")
BINS = 1000
"""Of a longer stream the least and the greatest value of each bin are drawn: no peak is lost."""
MARKED = 200
"""Gaps of a stream that are marked, the longest."""


def draw_contents(contents: Contents, path: Path) -> None:
    """Write the picture.

    Raises:
        UsageError: a file of another format, or one that cannot be written.
    """
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: a picture ends in one of {', '.join(ENDINGS)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(FIGURE):
            figure = _figure(contents)
            if path.suffix.lower() == ".html":
                write_whole(path, _page(contents, svg(figure)))
            else:
                with whole(path) as file:
                    figure.savefig(file, format=path.suffix[1:].lower(), dpi=130)
    except OSError as problem:
        raise UsageError(f"{path} cannot be written ({problem.strerror})") from None


def _page(contents: Contents, figure: str) -> str:
    return page(
        contents.source,
        f"<h1>{escape(contents.source)}</h1>\n<figure>{figure}</figure>\n"
        f"<pre>{escape(contents_words(contents))}</pre>",
    )


def _figure(contents: Contents) -> Figure:
    streams = [stream for stream in contents.streams if len(stream.series)]
    figure = Figure(figsize=(9.6, 0.6 + 1.7 * max(len(streams), 1)))
    panels = figure.subplots(max(len(streams), 1), 1, sharex=True, squeeze=False)[:, 0]
    for panel, stream in zip(panels, streams, strict=False):
        _draw(panel, stream, contents.recording.stop)
    panels[-1].set_xlabel("time [s]")
    return figure


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
        ncols=len(columns), loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1
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
