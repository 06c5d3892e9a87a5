"""A structure that bends under its own weight."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import Array, BodyEffect, MomentLaw, State, TorqueLaw, needs_ball
from twin.platform import Platform
from twin.rotation import vertical_body


@dataclass(frozen=True)
class StructuralSag(BodyEffect):
    """The structure bends sideways as it is tilted: m r += k (g_x, g_y, 0), body axes.

    Its gravity torque is k (g_y g_z, -g_x g_z, 0), quadratic in gravity: Python evaluates it once a
    physics step. The bending itself is taken as immediate.
    """

    name = "structural_sag"
    domain = Domain.torque
    observable = "a pendulum stiffness that falls with tilt; at small tilt it is a lower CM"
    streams = ("gyro", "attitude")

    softness: float = parameter(
        "mass moment per gravity across",
        "kg m/(m/s^2)",
        2.8e-4,
        source="ASSUMED: 10 kg carried by what swings at 30 Hz, m / (2 pi f)^2",
        low=0.0,
        high=1.0,
    )

    def unfit(self, platform: Platform) -> str:
        return super().unfit(platform) or needs_ball(platform)

    def torque(self, platform: Platform) -> TorqueLaw:
        strength = self.softness * platform.gravity**2

        def law(state: State) -> Array:
            x, y, z = vertical_body(state.position).T
            return strength * np.stack([y * z, -x * z, np.zeros_like(z)], axis=-1)

        return law

    def mass_moment(self, platform: Platform) -> MomentLaw:
        strength = self.softness * platform.gravity

        def law(state: State) -> Array:
            x, y, z = vertical_body(state.position).T  # gravity points the other way
            return -strength * np.stack([x, y, np.zeros_like(z)], axis=-1)

        return law
