"""Curves over time in the paper's axes, as SVG text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.report.style import FIGURE, PALETTE, SOFT, svg

Array = NDArray[np.float64]

POINTS = 1500
"""Drawn of a long curve."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    label: str
    """Of the upright axis, with its unit."""
    curves: Mapping[str, Array]
    """By name, (m,) over the time of the figure."""
    levels: Sequence[float] = ()
    """Drawn dashed: what was published, or is true."""
    limit: float | None = None
    """Of the upright axis, up and down; None: what the curves need."""


def drawn(time: Array, panels: Sequence[Panel]) -> str:
    """The panels above each other.

    Args:
        time: (m,) [s].
        panels: from the top.
    """
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 0.6 + 2.1 * len(panels)))
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        thin = slice(None, None, max(len(time) // POINTS, 1))
        for axis, panel in zip(axes, panels, strict=True):
            for (name, curve), color in zip(panel.curves.items(), PALETTE, strict=False):
                axis.plot(time[thin], curve[thin], color=color, label=name)
            for level in panel.levels:
                axis.axhline(level, color=SOFT, lw=0.9, ls="--")
            if panel.limit is not None:
                axis.set_ylim(-panel.limit, panel.limit)
            axis.set_ylabel(panel.label)
            if len(panel.curves) > 1:
                axis.legend(ncols=4, loc="upper right")
        axes[-1].set_xlabel("time [s]")
        return svg(figure)


def named(names: Sequence[str], values: Array) -> dict[str, Array]:
    """Columns (m, k) as curves, by k names."""
    return dict(zip(names, values.T, strict=True))
