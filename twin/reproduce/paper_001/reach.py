"""Can the vertical stage take away the vertical offset?"""

from twin.reproduce.paper_001.flights import astros
from twin.reproduce.part import Computed, Ours, Say


def reach(say: Say) -> Computed:
    """From mid-travel, where the paper's masses start."""
    say("the vertical mass's reach")
    platform = astros()
    vertical = max(platform.stages, key=lambda stage: abs(stage.axis[2]))
    asked = abs(float(platform.center_of_mass_offset[2]))
    half = vertical.mass * vertical.travel[1]
    note = f"Asked {asked:.4f} kg m, from mid-travel {half:.4f}, from the end {2 * half:.4f}."
    return Computed({"001.reach": Ours(half >= asked, note=note)})
