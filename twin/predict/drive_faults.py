"""What gimbals do beside their command, less what a known fault of a drive makes of it.

A fault that the model lacks is no random walk. Taken for one, it would be believed of the drive
that it goes astray at every instant, and no cause could explain what is expected anyhow.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from twin.effects import Effect, SeriesEffect, catalogue
from twin.model import Machine
from twin.predict.profiles import profile
from twin.recording import Series

Array = NDArray[np.float64]

STREAM = "command_gimbal_rate"
ROUNDS = 5
"""Times that the faults' marks are formed, each where the one before found them."""


def less_drive_faults(machine: Machine, told: Series, error: Series) -> Series:
    """The error of gimbals' angles (m, gimbals) that no fault of a drive explains [rad].

    Args:
        machine: compiled.
        told: the commanded rates.
        error: measured angles less those that the commands lead to.
    """
    kinds = [k for k in catalogue() if issubclass(k, SeriesEffect) and k.acts_on == STREAM]
    left = error.value - error.value.mean(axis=0)
    for column, gimbal in enumerate(machine.platform.gimbals):
        faults: list[Effect] = [kind.typical(gimbal.name) for kind in kinds]
        for _ in range(ROUNDS):
            marks = [_mark(machine, fault, told, error.time)[:, column] for fault in faults]
            marks = np.stack([mark - mark.mean() for mark in marks], axis=1)
            sizes, _ = nnls(marks, error.value[:, column] - error.value[:, column].mean())
            left[:, column] = error.value[:, column] - error.value[:, column].mean() - marks @ sizes
            faults = [
                fault.with_values(np.clip(fault.values * max(float(size), 1e-3), *fault.bounds()))
                for fault, size in zip(faults, sizes, strict=True)
            ]
    return replace(error, value=left)


def _mark(machine: Machine, fault: Effect, told: Series, time: Array) -> Array:
    """(m, gimbals) [rad]."""
    faulty = replace(machine, effects=(*machine.effects, fault))
    there, here = (profile(one, STREAM, told)[0] for one in (faulty, machine))
    return there.interpolated_at(time) - here.interpolated_at(time)
