"""Liquid in a tank that is not full."""

from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import (
    CARRIER_INERTIA,
    CARRIER_MASS,
    BodyEffect,
    anchor,
    needs_ball,
    set_inertial,
)
from twin.platform import Platform

_STEPS = 20
"""Of a period, that RK4 needs to follow it."""
_BROAD = 0.05
"""Damping ratio with which it is sought: what rings longer is out of step with what rings but a
hundredth faster, and a line is not known so well."""
_ARM = 0.4
"""Distance from the CR at which its pivot is sought [m]: nearer to it, a turn of the body hardly
makes it ring, and what it does besides is what another base does."""


@dataclass(frozen=True)
class LiquidSlosh(BodyEffect):
    """Part of the mass swings like a pendulum: the first mode of a liquid.

    A point mass on two crossed hinges, each with its damping. At rest in the body it hangs along
    the body's z axis; there the whole has the mass properties that are stated.

    A body that turns slowly shows m l alone, which takes m l g off its pendulum's stiffness, as a
    structural sag of m l / g does: it capsizes where its m r is less. Mass, length, damping and
    pivot show each for itself only where torques that change at once make the liquid ring.
    """

    name = "liquid_slosh"
    domain = Domain.exchange
    observable = "after a turn the rate rings slowly, at sqrt(g / l) / 2 pi"
    streams = ("gyro", "attitude")

    mass: float = parameter(
        "that swings",
        "kg",
        0.2,
        source="ASSUMED: a third of a filled half-litre tank",
        low=0.0,
        high=1e4,
    )
    length: float = parameter(
        "of the pendulum",
        "m",
        0.05,
        source="ASSUMED: a tank 10 cm wide",
        low=1e-3,
        high=2.0,
        amplitude=False,
    )
    damping_ratio: float = parameter(
        "of the critical damping of small swings",
        "1",
        0.01,
        source="ASSUMED: water in a smooth tank",
        low=0.0,
        high=1.0,
        amplitude=False,
    )
    pivot: tuple[float, ...] = parameter(
        "where it hangs, from the CR, body axes",
        "m",
        (0.1, 0.0, -0.1),
        source="ASSUMED: a tank beside the bearing",
        low=-10.0,
        high=10.0,
        amplitude=False,
    )

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """A pendulum of that frequency, hung beside the CR, below and above it."""
        length = gravity / (2.0 * np.pi * hertz) ** 2
        places = [(_ARM, 0.0, 0.0), (0.0, _ARM, 0.0), (0.0, 0.0, -_ARM), (0.0, 0.0, _ARM)]
        return tuple(
            replace(self, length=length, damping_ratio=_BROAD, pivot=place) for place in places
        )

    def resonating(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """Likewise: it is broad already."""
        return self.at_frequency(hertz, gravity)

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform) or needs_ball(platform)
        if missing:
            return missing
        if platform.gravity <= 0.0:
            return "without weight nothing brings a liquid back to its place"
        longest = 2.0 * np.pi * np.sqrt(self.length / platform.gravity) / _STEPS
        if platform.step <= longest:
            return ""
        return (
            f"a step of {platform.step:g} s cannot follow a pendulum of {self.length:g} m; "
            f"set simulation.step to {longest:.2g} s or less"
        )

    @property
    def hangs_on(self) -> bool:
        return True

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        mass = self.mass + CARRIER_MASS
        turn = np.sqrt(platform.gravity / self.length)
        damping = 2.0 * self.damping_ratio * mass * self.length**2 * turn
        place = anchor(spec, platform) + np.array(self.pivot)
        outer = spec.body(platform.base.body).add_body(name=f"{self.label}/x", pos=place)
        set_inertial(outer, CARRIER_MASS, np.full(3, CARRIER_INERTIA))
        swing = outer.add_joint(name=f"{self.label}/x", type=hinge, axis=[1.0, 0.0, 0.0])
        swing.damping[0] = damping
        inner = outer.add_body(name=self.label)
        set_inertial(inner, mass, np.full(3, CARRIER_INERTIA))
        inner.ipos = [0.0, 0.0, -self.length]
        swing = inner.add_joint(name=f"{self.label}/y", type=hinge, axis=[0.0, 1.0, 0.0])
        swing.damping[0] = damping
