"""How much the logs moved the machine, and what they excite too little to identify.

The factor to SI of a stream that nobody calibrated, fitted beside the base.
Where another sensor shows the motion, a scale is that sensor's against this one's. Where none does,
the motion itself may be of any size, and what tells its size is how far it is from obeying a linear
law: a period that depends on the amplitude, or a known torque. So it is sought as the force by
which the machine departs from itself at another size (`size`). Of a small free swing nothing tells
amplitude and scale apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.identification.prediction_error import Fit
from twin.model import Machine
from twin.platform import Platform
from twin.predict.base import BaseParameters, hinge_axis, is_upright
from twin.predict.body import Body
from twin.predict.forces import Perturbation
from twin.predict.logs import Motion, Scaled, first_scaled, sought, unit_of
from twin.predict.response import Segment
from twin.recording import Recording

Array = NDArray[np.float64]


SHOW = {"attitude", "joint_angle", "wheel_speed"}
"""Streams of known scale that show how large a motion is."""
STEP = 1e-4
"""Of a finite difference in the size of a motion."""
ROUNDS = 12
"""Fits with the scale brought up to date, at most."""
SETTLED = 0.02
"""Standard deviations by which the scale may still be off when that ends."""
FARTHEST = 2.0
"""A round changes a scale by this factor at most."""
UNKNOWN = 0.5
"""A scale whose 95 % interval is wider than this share of it to one side is not identified."""


@dataclass(frozen=True)
class Scale:
    """One stream's factor to SI."""

    stream: str
    unit: str
    """SI per unit of the file."""
    value: float
    low: float
    high: float

    @property
    def known(self) -> bool:
        """Whether the logs determine it."""
        return self.high - self.value < UNKNOWN * self.value

    def document(self) -> Mapping[str, Any]:
        """For `--json`."""
        interval = (self.low, self.high) if self.known else (None, None)
        return {
            "value": self.value if self.known else None,
            "low": interval[0],
            "high": interval[1],
            "unit": self.unit,
        }


def scaled_together(recordings: Sequence[Recording], platform: Platform) -> list[Scaled]:
    """First guesses; a stream has one scale in all logs, that of the first log that has it."""
    logs = [first_scaled(recording, platform) for recording in recordings]
    common: dict[str, float] = {}
    for log in logs:
        common = {**log.factor, **common}
    return [log.by({n: common[n] / f for n, f in log.factor.items()}) for log in logs]


def unknown_scales(recordings: Sequence[Recording]) -> tuple[Perturbation, ...]:
    """What to fit: by strength e, the truth is (1 + e) of what is shown, stream by stream."""
    names = tuple(dict.fromkeys(name for recording in recordings for name in sought(recording)))
    if len(names) == 1 and not any(set(recording) & SHOW for recording in recordings):
        return (Perturbation(f"{names[0]}_scale", "1", force=size),)
    return tuple(
        Perturbation(f"{name}_scale", "1", stream=name, shown=lambda _, truth: -truth)
        for name in names
    )


def size(body: Body) -> Array:
    """(S, steps, nv) the force by which a motion of size 1 + e would depart from the model, over e.

    A motion x in readings is s x in truth, and the law is ID(s x) = T, ID the inverse dynamics and
    T the commands. Seen at size 1 this is ID(x) = T - e (T + d ID(s x) / ds - ID(x)).
    """
    grid, machine = body.grid, body.machine
    model, hanging = machine.model, body.motion.position.mean(axis=0)
    data = mujoco.MjData(model)
    forces = np.zeros((grid.segments, grid.steps, model.nv))
    for segment, start in enumerate(grid.starts.tolist()):
        times = start + grid.step * (np.arange(grid.steps) + 0.5)
        motion = body.motion.at(times)
        drive = body.inputs.drive(Segment(start, start + grid.length)).force
        for step, joints in enumerate(zip(*body.inputs.joint_states(times), strict=True)):
            needed: list[Array] = []
            for scale in (1.0 - STEP, 1.0, 1.0 + STEP):
                data.qpos[:], data.qvel[:], data.qacc[:] = (
                    joints[0],
                    *(scale * j for j in joints[1:]),
                )
                swing = motion.position[step] - hanging
                data.qpos[machine.base_qpos] = hanging + scale * swing
                data.qvel[machine.base_dof] = scale * motion.rate[step]
                data.qacc[machine.base_dof] = scale * motion.acceleration[step]
                mujoco.mj_inverse(model, data)
                needed.append(data.qfrc_inverse.copy())
            slope = (needed[2] - needed[0]) / (2.0 * STEP)
            forces[segment, step] = -(drive[step] + slope - needed[1])
    return forces


def change_of(fit: Fit, scales: Sequence[Scale]) -> tuple[dict[str, float], bool]:
    """Factors that take out what a fit found, and whether they are as good as 1."""
    spread, _ = fit.spread()
    change: dict[str, float] = {}
    settled = True
    for i, scale in enumerate(scales):
        row = i - len(scales)
        strength = float(fit.at.strengths[i])
        settled = settled and abs(strength) < SETTLED * float(np.sqrt(spread[row, row]))
        change[scale.stream] = float(np.clip(1.0 + strength, 1.0 / FARTHEST, FARTHEST))
    return change, settled


def scales_of(
    fit: Fit, perturbations: Sequence[Perturbation], scaled: Sequence[Scaled]
) -> tuple[Scale, ...]:
    """What a fit says of the scales, with 95 % intervals."""
    spread, quantile = fit.spread()
    scales: list[Scale] = []
    for i, perturbation in enumerate(perturbations):
        name = perturbation.name.removesuffix("_scale")
        log = _log_of(name, scaled)
        row = i - len(perturbations)
        change = max(1.0 + float(fit.at.strengths[i]), 1.0 / FARTHEST)
        half = quantile * float(np.sqrt(spread[row, row])) / change
        value = abs(log.factor[name] * change)
        unit = f"{log.recording[name].unit} per {unit_of(log.recording, name)}"
        # of the logarithm, which is what is near to normal
        scales.append(Scale(name, unit, value, value * np.exp(-half), value * np.exp(half)))
    return tuple(scales)


def as_taken(scales: Sequence[Scale], scaled: Sequence[Scaled]) -> tuple[Scale, ...]:
    """Scales as logs have them: one that they do not tell is what was guessed, and may be any."""
    return tuple(
        scale
        if scale.known
        else replace(
            scale,
            value=abs(_log_of(scale.stream, scaled).factor[scale.stream]),
            low=0.0,
            high=np.inf,
        )
        for scale in scales
    )


def _log_of(stream: str, scaled: Sequence[Scaled]) -> Scaled:
    """The first that has a stream."""
    return next(log for log in scaled if stream in log.factor)


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
    "mass": "mass",
    "mr_x": "mass moment m r_x",
    "mr_y": "mass moment m r_y",
    "mr_z": "mass moment m r_z",
    "mr_1": "mass moment across the axis (first)",
    "mr_2": "mass moment across the axis (second)",
}


@dataclass(frozen=True)
class Excitation:
    """Excitation of the logs, and how evenly it determines the base."""

    rate: Array
    """(k,) rms over all logs, about the joint's axes [rad/s]."""
    reach: float
    """Largest tilt of a ball, largest angle from the mean of a hinge, or of the heading on a floor
    [rad]."""
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
    turned = position[..., -1]
    return float(np.abs(turned - turned.mean()).max())


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
    if machine.platform.base.kind == "planar":
        return ["one common scale of mass, J and m r: the mass is as stated; needs known thrust"]
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
    """Sentences for the streams whose scale the logs do not determine."""
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
