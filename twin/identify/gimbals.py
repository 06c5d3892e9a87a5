"""Gimbals that do not go where they are told: followed as measured, not as commanded.

Friction, play or a late drive leave a gimbal elsewhere than its command has it. Whose fault that
is, diagnosis asks; who identifies the body needs to know where the gyros really point.
"""

from dataclasses import replace

import numpy as np

from twin.model import Machine
from twin.predict.drive.faults import STREAM, less_drive_faults
from twin.predict.drive.profiles import from_mean, profile
from twin.predict.sensors.outputs import noise_of
from twin.recording import Recording

ANGLE = "gimbal_angle"

WORTHWHILE = 25.0
"""A fault of a drive must explain so much of a gimbal's angle, in log-likelihood, before the
command is not believed."""


def as_measured(recording: Recording, machine: Machine) -> tuple[Recording, tuple[str, ...]]:
    """A log without the gimbals' commands where their angles say otherwise, and a sentence then.

    Args:
        recording: as measured.
        machine: compiled, as stated.
    """
    gimbals = machine.platform.gimbals
    if not gimbals or STREAM not in recording or ANGLE not in recording:
        return recording, ()
    told, seen = recording[STREAM], recording[ANGLE]
    if not len(told) or not len(seen):
        return recording, ()
    there, _ = profile(machine, STREAM, told)
    error = from_mean(seen.value - there.interpolated_at(seen.time))
    left = less_drive_faults(machine, told, there, seen).value
    noise = noise_of(recording, machine.platform, ANGLE)
    explained = 0.5 * np.sum(np.square(error) - np.square(left), axis=0) / np.square(noise)
    astray = explained > WORTHWHILE
    if not astray.any():
        return recording, ()
    names = ", ".join(gimbal.name for gimbal, far in zip(gimbals, astray, strict=True) if far)
    streams = {name: series for name, series in recording.streams.items() if name != STREAM}
    sentence = (
        f"{names} did not go where {STREAM} says (friction, play or a late drive): gimbals are "
        f"taken to stand where {ANGLE} has them"
    )
    return replace(recording, streams=streams), (sentence,)
