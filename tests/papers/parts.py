"""Parts for tests: each runs in a process of its own, so they stand in a module."""

import os
from dataclasses import dataclass

import matplotlib as mpl
from matplotlib.figure import Figure

from papers.rows import Computed, Ours, Say
from twin.report.style import FIGURE, svg


def good(say: Say) -> Computed:
    """A value and a figure."""
    say("counting")
    with mpl.rc_context(FIGURE):
        figure = Figure()
        figure.subplots().plot([0.0, 1.0])
        return Computed({"000.good": Ours(0.5, note="Half of one.")}, {"A line": svg(figure)})


def raises(say: Say) -> Computed:
    """It divides by zero."""
    return Computed({"000.raises": Ours(1 / 0)})


def dies(say: Say) -> Computed:
    """As one that the system kills."""
    os._exit(3)


@dataclass(frozen=True)
class Constant:
    """A value that is known before."""

    name: str
    value: float

    def __call__(self, say: Say) -> Computed:
        """That value."""
        return Computed({self.name: Ours(self.value)})
