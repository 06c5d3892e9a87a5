"""Table 2: are the recursive inertias that the paper gives as results those of bodies?"""

import numpy as np

from twin.reproduce.inertia import is_rigid_body, tensor
from twin.reproduce.part import Computed, Ours, PaperPart, Say

PUBLISHED = np.array(
    [
        [2.8, 11.8, 12.0, 1.6, -0.9, 1.09],
        [4.0, 6.5, 14.1, 1.3, -0.81, 1.32],
        [1.2, 10.1, 13.9, 2.5, -0.76, 0.65],
        [2.5, 11.6, 10.6, 2.9, -1.5, 1.87],
        [3.5, 14.0, 16.0, 0.8, -2.1, 1.52],
    ]
)
"""xx yy zz xy xz yz of the five tests [kg m^2]."""


def compute(say: Say) -> Computed:
    """Count them."""
    say("Table 2: rigid bodies")
    bodies = [str(i + 1) for i, row in enumerate(PUBLISHED) if is_rigid_body(tensor(row))]
    note = f"Rigid bodies: tests {', '.join(bodies) or 'none'}."
    return Computed({"004.table2.unphysical": Ours(float(len(bodies)), note=note)})


PART = PaperPart(("004.table2.unphysical",), compute)
