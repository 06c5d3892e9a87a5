"""A stream that is stamped by a clock of its own."""

from dataclasses import dataclass

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Order, SeriesEffect, with_time
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class ClockDrift(SeriesEffect):
    """Its clock runs fast by d: a value true at t is stamped t (1 + d)."""

    name = "clock_drift"
    domain = Domain.clock
    observable = "the stream falls behind the others, or runs ahead, in proportion to time"
    streams = ("gyro", "attitude")
    order = Order.delay
    takes = "stream"

    drift: float = parameter(
        "rate error of its clock",
        "s/s",
        5e-05,
        source="ASSUMED: 50 ppm, a plain quartz",
        low=-0.5,
        high=0.5,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time * (1.0 + self.drift))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time / (1.0 + self.drift))
