"""A rate sensor on a hinge that is shaken at one frequency."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from twin.effects.effect import parameter
from twin.effects.on_series import Array, VibrationEffect


@dataclass(frozen=True)
class JointRateVibration(VibrationEffect):
    """It shows w + s sin(2 pi f t) + c cos(2 pi f t): the frame shakes, and the sensor with it."""

    name = "joint_rate_vibration"
    observable = "a line in the spectrum of the rate that no other stream shows"
    streams = ("joint_rate",)
    acts_on = "joint_rate"

    sine: float = parameter(
        "amplitude with the sine of the time",
        "rad/s",
        6e-4,
        source="ASSUMED: 0.04 deg/s beside a pump",
        low=-1.0,
        high=1.0,
    )
    cosine: float = parameter(
        "amplitude with its cosine",
        "rad/s",
        4e-4,
        source="ASSUMED: likewise",
        low=-1.0,
        high=1.0,
    )
    frequency: float = parameter(
        "of the sinusoid",
        "Hz",
        25.0,
        source="ASSUMED: a motor of 1500 turns a minute",
        low=1.0,
        high=1e4,
        amplitude=False,
    )

    def sinusoid(self) -> tuple[Array, Array, float]:
        return np.array([self.sine]), np.array([self.cosine]), self.frequency

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        del gravity
        return (replace(self, frequency=hertz),)
