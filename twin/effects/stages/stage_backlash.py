"""Play between a lead screw and its nut."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import (
    Array,
    Live,
    Order,
    Recursion,
    SeriesEffect,
    columns_of,
)
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class StageBacklash(SeriesEffect):
    """The mass follows within a play of the given full width: x = clip(x, u - b/2, u + b/2).

    It starts in the middle of the play. `undo` gives the command that leads to a position; within
    the play there are many, and it takes the nearest that moves the mass.
    """

    name = "stage_backlash"
    domain = Domain.actuator
    observable = "after a reversal the mass stands still for a while"
    streams = ("stage_position", "command_stage_position")
    order = Order.filter
    acts_on = "command_stage_position"
    takes = "stage"

    width: float = parameter(
        "full width of the play",
        "m",
        2e-5,
        source="003: Table 1 shows masses that scatter by 26 to 30 um",
        low=0.0,
        high=0.1,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)

        def follow(_: Array, before: Array, shown: Array, now: Array) -> Array:
            del before
            return np.clip(shown, now - half, now + half)

        return Recursion(follow)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)

        def lead(_: Array, before: Array, shown: Array, now: Array) -> Array:
            side = np.where(now == before, shown - before, np.sign(now - before) * half)
            return now + side

        return Recursion(lead)(samples)
