"""A rotor whose inertia is not the one that is stated."""

from dataclasses import dataclass

import mujoco

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect, body_of_joint
from twin.platform import Platform


@dataclass(frozen=True)
class WheelInertiaError(BodyEffect):
    """The rotor has (1 + e) of the moments of inertia that are stated; the whole keeps its own.

    Without a target, all wheels have the same error: that cannot be told from a common scale of
    body and mass moment.
    """

    name = "wheel_inertia_error"
    domain = Domain.exchange
    observable = "the wheel's speed and the body's rate exchange in a wrong ratio"
    streams = ("gyro", "wheel_speed")
    takes = "wheel"

    error: float = parameter(
        "of the rotor's moments of inertia",
        "1",
        0.02,
        source="ASSUMED: a CAD value against the real one",
        low=-0.9,
        high=10.0,
    )

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        for name in self.of_parts([wheel.name for wheel in platform.wheels]):
            model.body_inertia[body_of_joint(model, name)] *= 1.0 + self.error
