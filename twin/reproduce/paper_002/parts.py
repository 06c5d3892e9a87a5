"""Everything of paper 002 that is computed."""

from twin.reproduce.paper_002 import fig2, fig9, table2, table3, table3_ours, table4
from twin.reproduce.part import Part

PARTS: tuple[Part, ...] = (
    table2.PART,
    table3.PART,
    table3_ours.PART,
    table4.PART,
    fig2.PART,
    fig9.PART,
)
