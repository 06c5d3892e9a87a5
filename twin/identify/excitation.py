"""What the logs did not move enough to tell."""

import numpy as np
from numpy.typing import NDArray

from twin.model import Machine
from twin.predict.base import BaseParameters
from twin.recording import Recording

Array = NDArray[np.float64]

BLIND = 0.5
"""A parameter is not excited when half its 95 % interval exceeds so much of its scale: of a mean
principal moment for J, of the whole mass 1 mm off for m r."""

MOVED = 1e-3
"""[m]: a sliding mass that moved so far was moved on purpose."""

_NAMES = {
    "Jxx": "roll inertia Jxx",
    "Jyy": "pitch inertia Jyy",
    "Jzz": "yaw inertia Jzz",
    "Jxy": "product of inertia Jxy",
    "Jxz": "product of inertia Jxz",
    "Jyz": "product of inertia Jyz",
    "J": "inertia about the axis",
    "mr_x": "mass moment m r_x",
    "mr_y": "mass moment m r_y",
    "mr_z": "mass moment m r_z",
    "mr_1": "mass moment across the axis (first)",
    "mr_2": "mass moment across the axis (second)",
}


def not_excited(base: BaseParameters, half_widths: Array) -> list[str]:
    """Sentences for the parameters that these logs leave open, and for those no log shows."""
    return [
        f"{_NAMES[name]}: not excited"
        for name, half, scale in zip(base.names, half_widths, base.scale, strict=True)
        if half > BLIND * scale
    ] + [f"{entry}: no motion of this joint shows it" for entry in base.not_excited]


def common_scale(machine: Machine, recordings: list[Recording]) -> list[str]:
    """The sentence about the one scale that wheels and gravity leave open, where it is open.

    J, m r and the wheels' inertia may grow together and the motion stays the same. A known mass
    that moves sets the scale.
    """
    if not machine.platform.wheels or any(_mass_moved(r) for r in recordings):
        return []
    return [
        "one common scale of J, m r and wheel inertia: it is that of the wheels' stated inertia; "
        "needs a known mass move"
    ]


def _mass_moved(recording: Recording) -> bool:
    name = "stage_position"
    if name not in recording or not len(recording[name]):
        return False
    return bool(np.ptp(recording[name].value, axis=0).max(initial=0.0) > MOVED)
