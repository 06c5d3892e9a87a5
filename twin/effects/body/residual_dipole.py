"""Magnetic moment of the platform itself: motors, batteries, current loops."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import Array, CoupleEffect
from twin.platform import Platform


@dataclass(frozen=True)
class ResidualDipole(CoupleEffect):
    """A magnetic moment fixed in the body turns into the room's field: torque m x R^T B.

    A couple of forces along B, 1 A m apart by m: exact at every stage of RK4.
    """

    name = "residual_dipole"
    domain = Domain.torque
    observable = "a torque like that of a mass moment, but about the field instead of the vertical"
    streams = ("gyro", "attitude")

    moment: tuple[float, ...] = parameter(
        "magnetic moment, body axes",
        "A m^2",
        (0.05, -0.02, 0.03),
        source="ASSUMED: a few hundredths, as a table with motors and batteries has",
        low=-100.0,
        high=100.0,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        if missing or np.any(platform.magnetic_field):
            return missing
        return "its environment has no magnetic field (environment.magnetic_field)"

    def apart(self) -> Array:
        return np.array(self.moment)

    def pull(self, platform: Platform) -> Array:
        return platform.magnetic_field
