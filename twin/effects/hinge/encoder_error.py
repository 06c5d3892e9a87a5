"""An encoder whose scale is uneven around the turn."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ReadingEffect
from twin.platform import Platform


@dataclass(frozen=True)
class EncoderError(ReadingEffect):
    """A hinge's angle a is shown as a + s sin(n a) + c cos(n a), n waves a turn.

    The rate that the same encoder gives is the rate of that. An eccentric disc makes one wave a
    turn, a magnet beside its sensor's axis two; an encoder on a motor behind a gear makes each so
    many times more as the gear reduces.
    """

    name = "encoder_error"
    domain = Domain.sensor
    observable = "angle and rate stray by so many waves in every turn, the rate more at speed"
    streams = ("joint_angle",)
    reads = ("joint_angle", "joint_rate")

    sine: float = parameter(
        "amplitude with the sine of the angle",
        "rad",
        5e-4,
        source="ASSUMED: 0.03 deg, a magnet 0.02 mm beside its sensor's axis",
        low=-0.1,
        high=0.1,
    )
    cosine: float = parameter(
        "amplitude with its cosine",
        "rad",
        3e-4,
        source="ASSUMED: likewise",
        low=-0.1,
        high=0.1,
    )
    waves: float = parameter(
        "in a turn",
        "1",
        2.0,
        source="ASSUMED: a magnet beside its sensor's axis",
        low=0.5,
        high=1000.0,
        amplitude=False,
    )

    def with_waves(self, waves: float) -> tuple[Self, ...]:
        return (self.with_values(np.array([self.sine, self.cosine, waves])),)

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        return missing or ("" if platform.base.kind == "hinge" else "it needs a hinge")

    def error(self, stream: str, position: Array, rate: Array) -> Array:
        turns = self.waves * position
        if stream == "joint_angle":
            return self.sine * np.sin(turns) + self.cosine * np.cos(turns)
        slope = self.waves * (self.sine * np.cos(turns) - self.cosine * np.sin(turns))
        return slope * rate
