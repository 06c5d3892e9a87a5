"""Everything of paper 002 that is computed."""

from twin.reproduce.paper_002 import (
    fig2,
    fig4,
    fig5,
    fig9,
    lag_and_turn,
    table2,
    table3,
    table3_ours,
    table4,
)
from twin.reproduce.part import PaperPart

PARTS: tuple[PaperPart, ...] = (
    table2.PART,
    table3.PART,
    table3_ours.PART,
    fig2.PART,
    fig4.PART,
    fig5.PART,
    lag_and_turn.PART,
    fig9.PART,
    table4.PART,
)
