"""What is computed of the paper."""

from twin.reproduce.paper_001 import experiment, gains, in_plane, reach, simplified
from twin.reproduce.part import Part

PARTS: tuple[Part, ...] = (
    Part(
        ("001.eq17.simplified", "001.eq17.simplified_real_mounting"),
        simplified.compared,
    ),
    Part(("001.gains.printed_roots", "001.gains.printed_run"), gains.printed),
    Part(
        ("001.fig7.settles", "001.fig8.mass_1", "001.fig8.mass_2"),
        in_plane.settling,
    ),
    Part(("001.fig16.settled_at", "001.fig17.masses"), experiment.hardware),
    Part(("001.reach",), reach.reach),
)
