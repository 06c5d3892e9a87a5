"""All that is computed for the paper."""

from twin.reproduce.paper_003 import fig_6, readings, tables
from twin.reproduce.part import PaperPart

PARTS: tuple[PaperPart, ...] = (*tables.PARTS, *readings.PARTS, fig_6.PART)
