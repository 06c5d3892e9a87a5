"""What an effect changes, in words and drawn."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from twin.contrast import Contrast, Difference
from twin.errors import UsageError
from twin.files import whole
from twin.report.style import FIGURE, PALETTE
from twin.units import fitting, printed


def contrast_words(contrast: Contrast) -> str:
    """A table: what the effect changes in each stream, beside the sensor's noise."""
    platform, effect = contrast.platform, contrast.effect
    head = ("stream", "changed by (rms)", "at most", "noise a sample")
    rows = [head, *(_row(difference) for difference in contrast.differences)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    table = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join(
        [
            f"{platform.name} with {effect.words()}",
            f"against the same without it: moved alike at steps of {printed(platform.step, 's')}, "
            "no sensor noise, no tilt stop",
            "",
            *table,
        ]
    )


def draw_contrast(contrast: Contrast, path: Path) -> None:
    """Write a picture of what the effect changes, a panel a stream.

    Raises:
        UsageError: the file cannot be written.
    """
    shown = [
        difference for difference in contrast.differences if difference.significant
    ] or contrast.differences[:1]
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 0.9 + 1.9 * max(len(shown), 1)))
        panels = figure.subplots(max(len(shown), 1), 1, sharex=True, squeeze=False)[:, 0]
        for panel, item in zip(panels, shown, strict=False):
            factor, unit = fitting(item.worst, item.unit)
            for k, column in enumerate(item.columns):
                color = PALETTE[k % len(PALETTE)]
                panel.plot(item.time, item.value[:, k] / factor, color=color, label=column)
            panel.axhspan(
                -item.noise / factor, item.noise / factor, color="#e8edf1", zorder=0, lw=0.0
            )
            room = 1.15 * item.worst / factor or 1.0
            panel.set_ylim(-room, room)
            panel.set_ylabel(f"{item.stream} [{unit}]")
            panel.legend(ncols=len(item.columns), loc="lower right", bbox_to_anchor=(1.0, 0.98))
        panels[-1].set_xlabel("time [s]")
        figure.suptitle(
            f"{contrast.platform.name}: with {contrast.effect.words()}, less without\n"
            "grey: the sensor's noise, 1 sigma a sample",
            fontsize=9,
            x=0.01,
            ha="left",
        )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole(path) as file:
                figure.savefig(file, format=path.suffix[1:].lower(), dpi=130)
        except OSError as problem:
            raise UsageError(f"{path} cannot be written ({problem.strerror})") from None


def _row(difference: Difference) -> tuple[str, str, str, str]:
    noise = printed(difference.noise, difference.unit) if difference.noise else "none"
    if not difference.significant:
        return difference.stream, "unchanged", "", noise
    return (
        difference.stream,
        printed(difference.rms, difference.unit),
        printed(difference.worst, difference.unit),
        noise,
    )
