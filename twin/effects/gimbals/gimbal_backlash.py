"""Play between a gimbal and the gear that drives it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Live, Order, SeriesEffect, columns_of, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class GimbalBacklash(SeriesEffect):
    """The gimbal follows its gear within a play of the given full width, from its middle.

    Commands are rates, held over a control tick: the gear turns by them, the gimbal by what the
    play lets through. `undo` gives the rates of the gear that lead to those of the gimbal; of many
    within the play it takes the least motion.
    """

    name = "gimbal_backlash"
    domain = Domain.actuator
    observable = "after a reversal the gimbal stands still for a while"
    streams = ("gimbal_angle", "command_gimbal_rate")
    order = Order.filter
    acts_on = "command_gimbal_rate"
    takes = "gimbal"

    width: float = parameter(
        "full width of the play",
        "rad",
        2e-3,
        source="ASSUMED: a tenth of a degree, a good gear",
        low=0.0,
        high=1.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)

        def follow(gear: Array, gimbal: Array) -> Array:
            return np.clip(gimbal, gear - half, gear + half)

        return _Turned(follow, platform.tick)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)
        before = np.zeros_like(samples.value[:, 0])

        def lead(gimbal: Array, gear: Array) -> Array:
            nonlocal before
            turned, before = gimbal - before, gimbal
            return np.where(turned == 0.0, gear, gimbal + np.sign(turned) * half)

        return _Turned(lead, platform.tick)(samples)


class _Turned:
    """Follows an angle that is given by its rate over each tick."""

    def __init__(self, follow: Callable[[Array, Array], Array], tick: float) -> None:
        """Both angles start at 0.

        Args:
            follow: from the leading angle and the last one of what follows to its next.
            tick: [s].
        """
        self._follow = follow
        self._tick = tick
        self._angles: tuple[Array, Array] | None = None

    def __call__(self, samples: Samples) -> Samples:
        """The next rates."""
        rate = np.empty_like(samples.value)
        for i in range(rate.shape[1]):
            if self._angles is None:
                self._angles = np.zeros_like(rate[:, i]), np.zeros_like(rate[:, i])
            lead, follow = self._angles
            lead = lead + samples.value[:, i] * self._tick
            moved = self._follow(lead, follow)
            rate[:, i] = (moved - follow) / self._tick
            self._angles = lead, moved
        return with_value(samples, rate)
