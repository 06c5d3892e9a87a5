"""Damp the body's rate with magnetorquers, as far as the field lets them."""

from dataclasses import dataclass, field

import numpy as np

from twin.controller import Controller
from twin.controller.coils import Coils
from twin.platform import Platform
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class MagneticDamping(Controller[Coils]):
    """Torque against the rate, by magnetorquers alone.

    d   = B x (-K_d w) / |B|^2 = K_d w x B / |B|^2      dipole [A m^2, body], B in the body
    tau = d x B = -K_d (w - (w . b) b),  b = B / |B|    torque on the body [N m, body]

    The energy of the body never grows: dE/dt = -K_d |w x b|^2 <= 0, for any CM and J, and also
    while coils at right angles to each other are at their limits (each then gives less, not
    otherwise). The rate about the field is left alone; in an upright field a small tilt of a
    hanging body decays as exp(-K_d t / 2 J).

    It follows no target. Source: the note on in-plane balancing by sliding masses and magnetorquers
    (paper 003 of docs/design.md), eq. 6 and 7: its derivative part alone. There B stands upright,
    and w across gravity is w across B; here B is any.
    """

    derivative: float = field(default=1.8e-3, metadata={"unit": "N m s"})
    """K_d, per body rate."""

    def init(self, platform: Platform, n: int) -> Coils:
        """The coils in their field."""
        return Coils.of(platform, "magnetic_damping")

    def update(
        self, state: Coils, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Coils]:
        """Dipole; none in a run that has not been seen yet."""
        dipole = state.dipole(estimate.attitude, -self.derivative * estimate.rate_body)
        return {"command_dipole": np.where(estimate.valid[:, None], dipole, 0.0)}, state
