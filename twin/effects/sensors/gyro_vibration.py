"""A gyro that is shaken at one frequency."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from twin.effects.effect import parameter
from twin.effects.on_series import Array, VibrationEffect


@dataclass(frozen=True)
class GyroVibration(VibrationEffect):
    """It shows w + s sin(2 pi f t) + c cos(2 pi f t), its own axes: a pump shakes its mount."""

    name = "gyro_vibration"
    observable = "a line in the spectrum of the gyro that no other stream shows"
    streams = ("gyro",)
    acts_on = "gyro"

    sine: tuple[float, ...] = parameter(
        "amplitude with the sine of the time, its own axes",
        "rad/s",
        (6e-4, 4e-4, 2e-4),
        source="ASSUMED: 0.04 deg/s beside a pump",
        low=-1.0,
        high=1.0,
    )
    cosine: tuple[float, ...] = parameter(
        "amplitude with its cosine",
        "rad/s",
        (2e-4, 6e-4, 4e-4),
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
        return np.array(self.sine), np.array(self.cosine), self.frequency

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        del gravity
        return (replace(self, frequency=hertz),)
