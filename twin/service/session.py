"""An armed machine, tick by tick, for moves that follow no control law."""

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench
from twin.errors import SafetyError
from twin.signals import Command, Reading
from twin.stop import check

Array = NDArray[np.float64]
_Found = TypeVar("_Found")

LONGEST = 3600.0
"""Of all moves together [s]."""

POSITION, MOVE = "stage_position", "command_stage_position"


class Session:
    """Watches, arms, and then goes on one tick a step; leaving the bench makes it safe."""

    def __init__(self, bench: Bench) -> None:
        """Arm it, by the word that the bench was opened with.

        Raises:
            SafetyError: why it is not armed.
            DeviceError: a device refuses.
        """
        self.bench = bench
        self.platform = bench.platform
        self.tick = bench.platform.tick
        self._ticks = bench.begin().ticks(self.tick, LONGEST)
        self.readings: list[Reading] = []
        """All since it was armed."""
        self.applied: list[tuple[float, Command]] = []
        """What was applied from each step's time [s] on."""
        self.now = 0.0
        """Of the last step [s]."""

    def step(self, command: Command) -> None:
        """Read what came with the next tick, then let the command out within the rules.

        Raises:
            SafetyError: the guard has stopped it.
            Stopped: a stop was requested.
        """
        check()
        self.now = next(self._ticks)
        self.readings.append(self.bench.read(self.now))
        self.applied.append((self.now, self.bench.write(command)))
        if self.bench.safe_reason:
            raise SafetyError(
                f"it was stopped: {self.bench.safe_reason}", "look at the machine, then try again"
            )

    def watch(self, command: Command, seconds: float) -> None:
        """Go on under that command for so long [s]; raises as `step`."""
        for _ in range(round(seconds / self.tick)):
            self.step(command)

    def meanwhile(self, work: Callable[["Session"], _Found], command: Command) -> _Found:
        """What some work finds in all that was read so far; raises as `step`.

        The session goes on under that command, for set-points run out sooner than the work may be
        done; in lockstep time stands still.
        """
        if self.bench.in_lockstep:
            return work(self)
        so_far = copy.copy(self)
        so_far.readings, so_far.applied = self.readings.copy(), self.applied.copy()
        with ThreadPoolExecutor(1) as thread:
            result = thread.submit(work, so_far)
            while not result.done():
                self.step(command)
        return result.result()

    @property
    def places(self) -> Array:
        """(stages,) where they read to be [m].

        Raises:
            SafetyError: nothing has told it.
        """
        place = self.bench.guard.seen.stage_position
        if place is None:
            raise SafetyError("no position of the stages was measured", "home them, captured")
        return place.copy()
