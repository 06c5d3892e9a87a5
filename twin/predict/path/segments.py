"""Where a log is cut into stretches that are each predicted from an initial state of their own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.model import Machine
from twin.predict.log.motion import Motion
from twin.predict.parameters.base import hinge_axis
from twin.predict.sensors.outputs import Grid
from twin.recording import Recording

Array = NDArray[np.float64]

LONGEST = 10.0
"""[s]."""

GROWTH = 3.0
"""An error of the initial state may grow by exp(3) = 20 within a stretch: then a fit is well posed
even where the machine stands on its head. Twice as long it would be 400, and Gauss-Newton, started
from a wrong base, loses its way."""

EDGE = 1e-3
"""Share of a step by which clocks that go together may seem to differ."""
COARSE = 0.025
"""The longest step of a prediction [s]."""


@dataclass(frozen=True)
class Segment:
    """From `start` to `stop` [s]."""

    start: float
    stop: float

    def edges(self, step: float, steps: int) -> Array:
        """Beginnings and end of so many physics steps, (steps + 1,) [s]."""
        return np.asarray(self.start + step * np.arange(steps + 1), dtype=np.float64)


def growth_rate(machine: Machine) -> float:
    """Rate [1/s] at which the machine would fall from upright: sqrt(g abs(m r) / J)."""
    platform = machine.platform
    offset = platform.center_of_mass_offset
    if platform.base.kind == "ball":
        smallest = float(np.linalg.eigvalsh(platform.inertia)[0])
    else:
        axis = hinge_axis(machine)
        offset = offset - (axis @ offset) * axis
        smallest = float(axis @ platform.inertia @ axis)
    return float(np.sqrt(platform.gravity * np.linalg.norm(offset) / smallest))


def command_step(machine: Machine, recording: Recording) -> float:
    """The longest step up to COARSE of which a whole number fits between two commands [s].

    The platform's, where drives are told where to go: their moves are ramps of a few such steps.
    """
    told = "command_stage_position"
    moves = told in recording and bool(np.ptp(recording[told].value, axis=0).any())
    if machine.platform.gimbals or (machine.platform.stages and moves):
        return machine.platform.step
    periods = [
        float(np.median(np.diff(recording[name].time)))
        for name in machine.platform.commands
        if name in recording and len(recording[name]) > 1
    ]
    shortest = min(periods, default=COARSE)
    step = round(float(shortest / np.ceil(shortest / COARSE - 1e-6)), 9)
    return max(step, machine.platform.step)


def grid_of(machine: Machine, recording: Recording, motion: Motion, step: float) -> Grid:
    """Equal segments of at most 10 s and at most exp(3) of growth, their steps in time with the
    commands.

    A command that changed within a step would act a little before it was given. It answers to the
    noise of the sample that was read as it was given, and so would seem to foretell it.
    """
    begin, end = float(motion.time[0]), float(motion.time[-1])
    given = [recording[name].time for name in machine.platform.commands if name in recording]
    if given:
        oftenest = max(given, key=len)
        after = float(oftenest[np.searchsorted(oftenest, begin) % len(oftenest)]) - begin
        after %= step
        begin += 0.0 if step - after < EDGE * step else after
    length = min(LONGEST, GROWTH / max(growth_rate(machine), 1e-9), end - begin)
    steps = max(int(length / step + 1e-9), 1)
    segments = max(int(np.ceil((end - begin) / (steps * step) - 1e-6)), 1)
    return Grid(begin, step, steps, segments)
