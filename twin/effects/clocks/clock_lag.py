"""A stream whose stamps are late: buffers, a slow bus, another computer."""

from dataclasses import dataclass

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Order, SeriesEffect, with_time
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class ClockLag(SeriesEffect):
    """A value stamped t was true at t - tau; positive: the data come late."""

    name = "clock_lag"
    domain = Domain.clock
    observable = "the stream follows the others after a constant time"
    streams = ("gyro", "attitude")
    order = Order.delay
    takes = "stream"

    lag: float = parameter(
        "of the stream behind the others",
        "s",
        0.17,
        source="002: +0.17 s on wheel_speed",
        low=-60.0,
        high=60.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time + self.lag)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time - self.lag)
