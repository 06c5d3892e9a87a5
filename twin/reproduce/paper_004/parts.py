"""Everything of paper 004 that is computed."""

from twin.reproduce.paper_004 import table1_wheels, table2_unphysical
from twin.reproduce.part import Part

PARTS: tuple[Part, ...] = (table1_wheels.PART, table2_unphysical.PART)
