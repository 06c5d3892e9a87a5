"""How much the logs moved the machine, and what they did not move enough to tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.identification.scale import Scale
from twin.model import Machine
from twin.predict.base import BaseParameters, hinge_axis, is_upright
from twin.predict.logs import Motion
from twin.recording import Recording

Array = NDArray[np.float64]

BLIND = 0.5
"""A parameter is not excited when half its 95 % interval exceeds so much of its scale: of a mean
principal moment for J, of the whole mass 1 mm off for m r."""

COUNTS = 0.3
"""Smallest weight that is worth naming."""

SINGULAR = 1e-12
"""A covariance from fewer blocks than parameters knows some combination perfectly; it does not."""

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


@dataclass(frozen=True)
class Excitation:
    """What the logs went through, and how evenly it shows the base."""

    rate: Array
    """(k,) rms over all logs, about the joint's axes [rad/s]."""
    reach: float
    """Largest tilt of a ball, largest angle from the mean of a hinge [rad]."""
    least_known: Mapping[str, float]
    """Of all combinations of J the one that is known worst: its weights, their squares adding up to
    1; those that count."""
    half_width: float
    """Of the 95 % interval of that combination, as a share of a mean principal moment; NaN where J
    is held at its stated size."""
    condition: float
    """How many times worse it is known than the best known one; 1 is the most even excitation."""

    def document(self) -> Mapping[str, Any]:
        """For `--json`."""
        return {
            "rate": [float(value) for value in self.rate],
            "reach": self.reach,
            "least_known": dict(self.least_known),
            "half_width": self.half_width,
            "condition": self.condition,
        }


def excitation_of(
    motions: Sequence[Motion], base: BaseParameters, covariance: Array, quantile: float
) -> Excitation:
    """Measure it on smoothed motions and on the covariance (p, p) that they led to."""
    square = np.concatenate([np.square(motion.rate) for motion in motions])
    rate, reach = np.sqrt(square.mean(axis=0)), max(_reach(motion.position) for motion in motions)
    tensor = [index for index, name in enumerate(base.names) if name.startswith("J")]
    if not tensor:
        return Excitation(rate, reach, {}, float("nan"), float("nan"))
    size, direction = np.linalg.eigh(covariance[np.ix_(tensor, tensor)])
    worst = direction[:, -1] * np.sign(direction[np.argmax(np.abs(direction[:, -1])), -1])
    return Excitation(
        rate,
        reach,
        {
            base.names[index]: float(weight)
            for index, weight in zip(tensor, worst, strict=True)
            if abs(weight) > COUNTS
        },
        quantile * float(np.sqrt(size[-1])) / float(base.scale[tensor[0]]),
        float(np.sqrt(size[-1] / max(float(size[0]), SINGULAR * float(size[-1])))),
    )


def _reach(position: Array) -> float:
    if position.shape[-1] == 4:
        return float(rotation.tilt(position).max())
    return float(np.abs(position - position.mean()).max())


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
    same. A known torque on the base or a known mass that moves sets the scale; so do rotors of
    stated momentum.
    """
    if any(_mass_moved(r) or _pushed(r) for r in recordings) or machine.platform.rotors:
        return []
    what = "one common scale of J, m r"
    if not machine.platform.wheels:
        if machine.platform.base.kind != "hinge":
            return [f"{what}: it is that of the stated ones; needs a known torque or mass move"]
        stated = "J" if is_upright(hinge_axis(machine)) else "m r"
        return [f"{what} and damping: it is that of the stated {stated}; needs a known torque"]
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


def _pushed(recording: Recording) -> bool:
    """Whether something of known strength turned the base from outside."""
    names = ("command_joint_torque", "command_dipole", "command_thruster")
    return any(name in recording and bool(recording[name].value.any()) for name in names)


def _mass_moved(recording: Recording) -> bool:
    name = "stage_position"
    if name not in recording or not len(recording[name]):
        return False
    return bool(np.ptp(recording[name].value, axis=0).max(initial=0.0) > MOVED)
