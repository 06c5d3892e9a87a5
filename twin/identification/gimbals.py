"""Gimbals that do not go where they are told: followed as measured, not as commanded.

Friction, play or a late drive leave a gimbal elsewhere than its command has it. Whose fault that
is, diagnosis asks; who identifies the body needs to know where the gyros really point.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.model import Machine
from twin.predict.profiles import STREAM, from_mean, less_drive_faults, profile
from twin.predict.sensors import digits_of, noise_of
from twin.recording import Recording

Array = NDArray[np.float64]

ANGLE = "gimbal_angle"

WORTHWHILE = 25.0
"""A fault of a drive must explain so much of a gimbal's angle, in log-likelihood, before the
command is not believed. What an encoder's steps may round away speaks for no fault: a gimbal that
moves by less than a step seems to stand."""


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
    digit = digits_of(seen, machine.platform, ANGLE)
    error = _beyond(seen.value - there.interpolated_at(seen.time), digit)
    left = _beyond(less_drive_faults(machine, told, there, seen).value, digit)
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


def _beyond(error: Array, digit: Array) -> Array:
    """(m, k) what of an error (m, k) from its mean is more than rounding to a step (k,) makes."""
    error = from_mean(error)
    return np.sign(error) * np.maximum(np.abs(error) - digit, 0.0)
