"""The printed gains: the roots of the loop they close, and a run with them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.reproduce.paper_001.figures import Panel, drawn
from twin.reproduce.paper_001.flights import PRINTED, STABLE, astros
from twin.reproduce.paper_001.in_plane import LAST, fly, tilts
from twin.reproduce.part import Computed, Ours, Say

Array = NDArray[np.float64]


def roots(platform: Platform, gains: Mapping[str, float]) -> NDArray[np.complex128]:
    """Of the level, balanced machine under the law, without the turn about the vertical, (6,).

    J s^3 + K_w s^2 + (K_q / 2 + k) s + K_I / 2 = 0 with k = -m g r_z, about both horizontal axes
    at once: masses give no vertical torque, so J is what is left of it when the momentum about the
    vertical is kept, J_hh - J_hz J_zh / J_zz.
    """
    tensor = platform.inertia
    inertia = tensor[:2, :2] - np.outer(tensor[:2, 2], tensor[2, :2]) / tensor[2, 2]
    restoring = -platform.gravity * platform.center_of_mass_offset[2]
    stiffness = 0.5 * gains["proportional"] + restoring
    torque = np.kron([-0.5 * gains["integral"], -stiffness, -gains["derivative"]], np.eye(2))
    above = np.eye(4, 6, k=2)
    matrix = np.concatenate([above, np.linalg.solve(inertia, torque)])
    return np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)


def routh(platform: Platform, gains: Mapping[str, float]) -> Array:
    """(2,) below which K_I keeps each horizontal axis stable, taken alone [N m/s]."""
    restoring = -platform.gravity * platform.center_of_mass_offset[2]
    moments = np.diag(platform.inertia)[:2]
    return gains["derivative"] * (gains["proportional"] + 2.0 * restoring) / moments


def printed(say: Say) -> Computed:
    """Roots and run."""
    say("200 s with the printed gains")
    platform = astros()
    unstable, bounds = roots(platform, PRINTED), routh(platform, PRINTED)
    tamed = roots(platform, {**PRINTED, **STABLE}).real.max()
    run = fly(PRINTED)
    angle = tilts(run)
    late = angle[run.time >= run.time[-1] - LAST].max()
    rows = {
        "001.gains.printed_roots": Ours(
            float(unstable.real.max()),
            note=f"The bounds are {bounds[0]:.2f} and {bounds[1]:.2f}; with K_I = 0.1 the largest "
            f"real part is {tamed:.3f} 1/s.",
        ),
        "001.gains.printed_run": Ours(
            float(late / angle[0]),
            note=f"It grows until the stop at {np.degrees(platform.stop_angle):.0f} deg is struck.",
        ),
    }
    panels = [Panel("tilt [deg]", {"": np.degrees(angle)})]
    return Computed(rows, {"The run of Fig. 7 with K_I = 1 as printed": drawn(run.time, panels)})
