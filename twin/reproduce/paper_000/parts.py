"""All that is computed for the paper."""

from twin.reproduce.paper_000 import eq_43, fig_3, fig_7, fig_8
from twin.reproduce.part import PaperPart

PARTS: tuple[PaperPart, ...] = (fig_3.PART, *eq_43.PARTS, fig_7.PART, fig_8.PART)
