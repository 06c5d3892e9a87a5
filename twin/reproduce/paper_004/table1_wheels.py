"""Table 1's offset against the wheels' limit: can the machine be held level?"""

import numpy as np

from twin.budget import momentum_budget
from twin.platform import load_platform
from twin.reference import Hold
from twin.reproduce.part import Computed, Ours, PaperPart, Say

DURATION = 300.0
"""[s]."""


def compute(say: Say) -> Computed:
    """From the balance of momentum alone."""
    say("Table 1: the wheels' momentum")
    platform = load_platform("sads:table1")
    budget = momentum_budget(platform, Hold(), DURATION)
    limits = {wheel.name: wheel.momentum_limit for wheel in platform.wheels}
    value = max(budget.peak[name] / limit for name, limit in limits.items())
    torque = platform.gravity * float(np.hypot(*platform.center_of_mass_offset[:2]))
    full = "never" if budget.saturates_at is None else f"after {budget.saturates_at:.0f} s"
    note = f"Level, gravity asks {torque:.2f} N m; the first wheel is full {full}."
    return Computed({"004.table1.wheels": Ours(value, note=note)})


PART = PaperPart(("004.table1.wheels",), compute)
