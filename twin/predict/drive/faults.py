"""What gimbals do beside their command, less what a known fault of a drive makes of it.

A fault that the model lacks is no random walk. Taken for one, it would be believed of the drive
that it goes astray at every instant, and no cause could explain what is expected anyhow.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from twin.effects import Effect, SeriesEffect, catalogue
from twin.model import Machine
from twin.predict.drive.profiles import from_mean, profile
from twin.recording import Series

Array = NDArray[np.float64]

STREAM = "command_gimbal_rate"
ROUNDS = 5
"""Times that the faults' marks are formed, each where the one before found them."""


def less_drive_faults(machine: Machine, told: Series, there: Series, seen: Series) -> Series:
    """What gimbals' angles (m, gimbals) are beside their command, and no fault explains [rad].

    Args:
        machine: compiled.
        told: the commanded rates.
        there: the angles that they lead to.
        seen: the measured angles.
    """
    kinds = [k for k in catalogue() if issubclass(k, SeriesEffect) and k.acts_on == STREAM]
    gimbals = [gimbal.name for gimbal in machine.platform.gimbals]
    error = from_mean(seen.value - there.interpolated_at(seen.time))
    left = error
    # one of each kind on each gimbal, which is felt there alone
    faults: list[list[Effect]] = [[kind.typical(name) for name in gimbals] for kind in kinds]
    for _ in range(ROUNDS):
        marks = [_mark(machine, every, told, there, seen.time) for every in faults]
        sizes = np.stack(
            [
                nnls(np.stack([mark[:, i] for mark in marks], axis=1), error[:, i])[0]
                for i in range(len(gimbals))
            ],
            axis=1,
        )
        left = error - sum(mark * size for mark, size in zip(marks, sizes, strict=True))
        faults = [
            [_sized(fault, float(one)) for fault, one in zip(every, size, strict=True)]
            for every, size in zip(faults, sizes, strict=True)
        ]
    return replace(seen, value=left)


def _mark(
    machine: Machine, faults: Sequence[Effect], told: Series, there: Series, time: Array
) -> Array:
    """(m, gimbals) [rad]."""
    faulty = replace(machine, effects=(*machine.effects, *faults))
    astray = profile(faulty, STREAM, told)[0]
    return from_mean(astray.interpolated_at(time) - there.interpolated_at(time))


def _sized(fault: Effect, size: float) -> Effect:
    return fault.with_values(np.clip(fault.values * max(size, 1e-3), *fault.bounds()))
