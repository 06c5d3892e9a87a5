"""Parts for tests: each runs in a process of its own, so they stand in a module."""

import os
from dataclasses import dataclass

import matplotlib as mpl
from matplotlib.figure import Figure

from twin.report.style import FIGURE, svg
from twin.reproduce.part import Found, Ours, Say


def good(say: Say) -> Found:
    """A value and a figure."""
    say("counting")
    with mpl.rc_context(FIGURE):
        figure = Figure()
        figure.subplots().plot([0.0, 1.0])
        return Found({"000.good": Ours(0.5, note="Half of one.")}, {"A line": svg(figure)})


def raises(say: Say) -> Found:
    """It divides by zero."""
    return Found({"000.raises": Ours(1 / 0)})


def dies(say: Say) -> Found:
    """As one that the system kills."""
    os._exit(3)


@dataclass(frozen=True)
class Constant:
    """A value that is known before."""

    name: str
    value: float

    def __call__(self, say: Say) -> Found:
        """That value."""
        return Found({self.name: Ours(self.value)})
