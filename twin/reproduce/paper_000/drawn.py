"""Vectors over time, side by side: how the paper draws its runs."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.report.style import FIGURE, PALETTE, svg

Array = NDArray[np.float64]


def side_by_side(time: Array, panels: Mapping[str, Array]) -> str:
    """SVG of one panel a label; values are (m, 3) at times (m,) [s]."""
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.4))
        drawn = figure.subplots(1, len(panels))
        for panel, (label, values) in zip(drawn, panels.items(), strict=True):
            for column, name in enumerate("xyz"):
                panel.plot(time, values[:, column], color=PALETTE[column], label=name)
            panel.set_xlabel("time [s]")
            panel.set_ylabel(label)
        drawn[-1].legend(ncols=3)
        return svg(figure)
