"""What the logs did not move enough to tell."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.identify.scale import Scale
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


def not_excited(base: BaseParameters, theta: Array, half_widths: Array) -> list[str]:
    """Sentences for the parameters that these logs leave open, and for those no log shows.

    What a joint takes of the motion is measured against what is found of it, where that is more.
    """
    first = len(theta) - len(base.joints)
    size = np.concatenate([base.scale[:first], np.maximum(base.scale, np.abs(theta))[first:]])
    return [
        f"{_NAMES.get(name, name)}: not excited"
        for name, half, scale in zip(base.names, half_widths, size, strict=True)
        if half > BLIND * scale
    ] + [f"{entry}: no motion of this joint shows it" for entry in base.not_excited]


def common_scale(machine: Machine, recordings: list[Recording]) -> list[str]:
    """The sentence about the one scale that wheels and gravity leave open, where it is open.

    J, m r, the wheels' inertia and what joints take may grow together and the motion stays the
    same. A known torque on the base or a known mass that moves sets the scale.
    """
    if any(_mass_moved(r) or "command_joint_torque" in r for r in recordings):
        return []
    what = "one common scale of J, m r"
    if not machine.platform.wheels:
        if machine.platform.base.kind == "ball":
            return []
        return [f"{what} and damping: it is that of the stated m r; needs a known torque"]
    if any("command_wheel_duty" in r and "wheel_speed" not in r for r in recordings):
        return [
            f"{what}, damping and the wheels: it is that of the wheels' stated torque_limit, which "
            "a duty of 1 is taken to give; needs a measured wheel speed and a known mass move"
        ]
    return [
        f"{what} and wheel inertia: it is that of the wheels' stated inertia; "
        "needs a known mass move"
    ]


def scale_unknown(scales: Sequence[Scale]) -> list[str]:
    """Sentences for the streams whose scale the logs do not tell."""
    return [
        f"scale of {scale.stream}: these motions look the same at any amplitude; "
        f"{scale.value:.3g} {scale.unit} was taken; needs a wider swing, a known start, "
        "or another sensor"
        for scale in scales
        if not scale.known
    ]


def _mass_moved(recording: Recording) -> bool:
    name = "stage_position"
    if name not in recording or not len(recording[name]):
        return False
    return bool(np.ptp(recording[name].value, axis=0).max(initial=0.0) > MOVED)
