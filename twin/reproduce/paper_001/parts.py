"""What is computed of the paper."""

from twin.reproduce.paper_001 import (
    experiment,
    gains,
    in_plane,
    reach,
    simplified,
    three_offsets,
    vertical,
)
from twin.reproduce.part import PaperPart

PARTS: tuple[PaperPart, ...] = (
    PaperPart(
        ("001.eq17.simplified", "001.eq17.simplified_real_mounting"),
        simplified.compared,
    ),
    PaperPart(("001.gains.printed_roots", "001.gains.printed_run"), gains.printed),
    PaperPart(
        ("001.fig7.settles", "001.fig8.mass_1", "001.fig8.mass_2"),
        in_plane.settling,
    ),
    PaperPart(("001.fig9.rate_error", "001.fig10.offset_as_printed"), vertical.as_printed),
    PaperPart(("001.fig10.offset_with_imbalance",), vertical.with_imbalance),
    PaperPart(("001.fig10.three_offsets",), three_offsets.three_offsets),
    PaperPart(("001.fig16.settled_at", "001.fig17.masses"), experiment.hardware),
    PaperPart(("001.reach",), reach.reach),
)
