"""Magnetorquers whose moment is not the one that is stated."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, ScaleEffect
from twin.platform import Platform


@dataclass(frozen=True)
class MagnetorquerGain(ScaleEffect):
    """Of a commanded dipole, (1 + e) arrives, axis by axis of the body."""

    name = "magnetorquer_gain"
    domain = Domain.actuator
    observable = "the body turns into the field by more or less than the command says"
    streams = ("gyro", "attitude", "command_dipole")
    acts_on = "command_dipole"

    error: tuple[float, ...] = parameter(
        "of the scale, body axes",
        "1",
        (0.05, -0.04, 0.03),
        source="ASSUMED: the tolerance of a coil's resistance and core",
        low=-0.9,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return 1.0 + np.array(self.error)
