"""Dry friction in a gimbal's bearing, against which its drive must hold the rate."""

from dataclasses import dataclass, field

import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, columns_of, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class GimbalFriction(SeriesEffect):
    """The rate falls short by friction over the drive's stiffness; a small one does not start it.

    A drive with torque k (command - rate) turns at r - c / k sign(r), and stands where k |r| < c.
    Between gimbal and body the friction itself is taken up by the drive: only the rate tells.
    `undo` takes a gimbal that stands for one that was told to.
    """

    name = "gimbal_friction"
    domain = Domain.actuator
    observable = "the gimbal turns slower than it is told, and not at all at small commands"
    streams = ("gimbal_rate", "command_gimbal_rate")
    order = Order.scale
    acts_on = "command_gimbal_rate"
    takes = "gimbal"

    torque: float = parameter(
        "dry friction",
        "N m",
        0.02,
        source="ASSUMED: a pair of preloaded bearings and a slip ring",
        low=0.0,
        high=100.0,
    )
    stiffness: float = field(default=5.0)
    """Torque of the drive per error of the rate [N m s/rad]. ASSUMED."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.stiffness < np.inf:
            raise EffectError(
                f"{self.name}: stiffness is {self.stiffness!r} N m s/rad; it must lie above 0"
            )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        rate, lost = samples.value, self._lost(platform)
        return with_value(samples, np.sign(rate) * np.maximum(np.abs(rate) - lost, 0.0))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        rate, lost = samples.value, self._lost(platform)
        return with_value(samples, rate + np.sign(rate) * lost)

    def _lost(self, platform: Platform) -> Array:
        own = columns_of(self, platform, self.stream)
        return np.where(own, self.torque / self.stiffness, 0.0)
