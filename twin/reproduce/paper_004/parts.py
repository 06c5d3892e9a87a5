"""Everything of paper 004 that is computed."""

from twin.reproduce.paper_004 import (
    fig10,
    fig11,
    table1,
    table1_ours,
    table1_wheels,
    table2,
    table2_unphysical,
)
from twin.reproduce.part import PaperPart

PARTS: tuple[PaperPart, ...] = (
    table1_wheels.PART,
    table1.PART,
    table1_ours.PART,
    table2.PART,
    table2_unphysical.PART,
    fig10.PART,
    fig11.PART,
)
