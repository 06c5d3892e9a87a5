"""Magnetorquers whose moment is not the one that is stated."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class MagnetorquerGain(SeriesEffect):
    """Of a commanded dipole, (1 + e) arrives, axis by axis of the body."""

    name = "magnetorquer_gain"
    domain = Domain.actuator
    observable = "the body turns into the field by more or less than the command says"
    streams = ("gyro", "attitude", "command_dipole")
    order = Order.scale
    acts_on = "command_dipole"

    error: tuple[float, ...] = parameter(
        "of the scale, body axes",
        "1",
        (0.05, -0.04, 0.03),
        source="ASSUMED: the tolerance of a coil's resistance and core",
        low=-0.9,
        high=10.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value * (1.0 + np.array(self.error)))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value / (1.0 + np.array(self.error)))
