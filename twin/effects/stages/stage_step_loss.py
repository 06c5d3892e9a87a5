"""A stepper motor that misses steps."""

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
class StageStepLoss(SeriesEffect):
    """Of every move in the positive direction a share is lost; the way back is whole.

    Where the command starts, the mass is where it should be.
    """

    name = "stage_step_loss"
    domain = Domain.actuator
    observable = "the position falls behind the command, more with every move to and fro"
    streams = ("stage_position", "command_stage_position")
    order = Order.scale
    acts_on = "command_stage_position"
    takes = "stage"

    share: float = parameter(
        "of the steps of a positive move",
        "1",
        0.02,
        source="ASSUMED: a drive near its torque limit",
        low=0.0,
        high=0.99,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        kept = 1.0 - self.share * columns_of(self, platform, self.stream)

        def follow(_: Array, before: Array, shown: Array, now: Array) -> Array:
            return shown + (now - before) * np.where(now > before, kept, 1.0)

        return Recursion(follow)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        kept = 1.0 - self.share * columns_of(self, platform, self.stream)

        def lead(_: Array, before: Array, shown: Array, now: Array) -> Array:
            return shown + (now - before) / np.where(now > before, kept, 1.0)

        return Recursion(lead)(samples)
