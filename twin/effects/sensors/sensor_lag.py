"""A low-pass filter in a sensor."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Live, Order, Recursion, SeriesEffect
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class SensorLag(SeriesEffect):
    """A first-order low-pass: T dy/dt + y = x, from y = x at the first sample.

    Between samples x is taken as a straight line, so that `undo` is its exact inverse. On slow
    signals it is a clock lag of T.
    """

    name = "sensor_lag"
    domain = Domain.sensor
    observable = "the stream comes late and its fast parts are smaller"
    streams = ("gyro", "attitude")
    order = Order.filter
    takes = "stream"

    constant: float = parameter(
        "time constant",
        "s",
        0.02,
        source="ASSUMED: a low-pass of 8 Hz",
        low=0.0,
        high=100.0,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        if missing or self.target != "attitude":
            return missing
        return "an attitude is no number to be filtered; use clock_lag:attitude"

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        return Recursion(self._forward)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return Recursion(self._backward)(samples)

    def _forward(self, step: Array, before: Array, shown: Array, now: Array) -> Array:
        decay, first, second = self._weights(step)
        return decay * shown + first * before + second * now

    def _backward(self, step: Array, shown: Array, before: Array, now: Array) -> Array:
        decay, first, second = self._weights(step)
        return (now - decay * shown - first * before) / second

    def _weights(self, step: Array) -> tuple[Array, Array, Array]:
        """Of the last output, the last input and this input, for x a straight line."""
        if self.constant == 0.0:
            return np.zeros_like(step), np.zeros_like(step), np.ones_like(step)
        ratio = step / self.constant
        decay = np.exp(-ratio)
        mean = -np.expm1(-ratio) / np.where(ratio > 0.0, ratio, 1.0)
        return decay, mean - decay, 1.0 - mean
