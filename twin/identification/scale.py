"""The factor to SI of a stream that nobody calibrated, fitted beside the base.

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

from twin.identification.prediction_error import Fit
from twin.platform import Platform
from twin.predict.body import Body
from twin.predict.forces import Perturbation
from twin.predict.logs import Scaled, first_scaled, sought, unit_of
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
        """Whether the logs tell it."""
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


def change_of(found: Fit, scales: Sequence[Scale]) -> tuple[dict[str, float], bool]:
    """Factors that take out what a fit found, and whether they are as good as 1."""
    spread, _ = found.spread()
    change: dict[str, float] = {}
    settled = True
    for i, scale in enumerate(scales):
        row = i - len(scales)
        strength = float(found.at.strengths[i])
        settled = settled and abs(strength) < SETTLED * float(np.sqrt(spread[row, row]))
        change[scale.stream] = float(np.clip(1.0 + strength, 1.0 / FARTHEST, FARTHEST))
    return change, settled


def scales_of(
    found: Fit, perturbations: Sequence[Perturbation], scaled: Sequence[Scaled]
) -> tuple[Scale, ...]:
    """What a fit says of the scales, with 95 % intervals."""
    spread, quantile = found.spread()
    scales: list[Scale] = []
    for i, one in enumerate(perturbations):
        name = one.name.removesuffix("_scale")
        log = _log_of(name, scaled)
        row = i - len(perturbations)
        change = max(1.0 + float(found.at.strengths[i]), 1.0 / FARTHEST)
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
