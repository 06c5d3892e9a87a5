"""Balance in the plane: masses level the body, magnetorquers damp it."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.coils import Coils
from twin.controller.masses import Masses
from twin.platform import Platform
from twin.rotation import vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Balance:
    """What the law remembers."""

    position: Array
    """Integral part of each stage's position, (n, stages) [m]: where it balances the body."""
    seen: NDArray[np.bool_]
    """(n,) whether it began: at the stages' positions of the first estimate."""
    masses: Masses
    coils: Coils
    tick: float
    """[s]."""


@dataclass(frozen=True)
class MassMagneticPID(Controller[Balance]):
    """Proportional and integral torque by balance masses, derivative torque by magnetorquers.

    g^ = -u, u the upward vertical in body axes; e = u x z, z the body's own axis, upwards

    tau_sm  = -K_p e - K_I int e dt               by the masses [N m, body]            (4)
    m_j d_j = (g^ x tau_sm)_j / |g|               position of stage j [m]              (5)
    tau_mag = -K_d w_perp                         by the coils, w across g^ [N m]      (6)
    d       = B x tau_mag / |B|^2                 dipole [A m^2, body], B in the body  (7)

    The source has z and B point the other way (z along gravity, B a multiple of -g^): e is its
    g^ x z^, and (7) is its K_d / b g^ x w where B stands upright, whichever way it points. The
    integral is kept as a position of each stage, with the same anti-windup as in `mass_pid`.

    Each horizontal axis of small tilt obeys J s^3 + K_d s^2 + (K_p + k) s + K_I = 0 with
    k = -m g r_z: stable by Routh if K_I < K_d (K_p + k) / J.

    Source: the note on in-plane balancing by sliding masses and magnetorquers (paper 003 of
    docs/design.md), eq. 3 to 7, with the gains of its tables; K_I is its K_d K_i.
    """

    proportional: float = field(default=1e-3, metadata={"unit": "N m"})
    """K_p, per sine of the tilt."""
    integral: float = field(default=2e-5, metadata={"unit": "N m/s"})
    """K_I, per sine of the tilt and second."""
    derivative: float = field(default=1.8e-3, metadata={"unit": "N m s"})
    """K_d, per body rate."""

    def init(self, platform: Platform, n: int) -> Balance:
        """Nothing balanced yet."""
        return Balance(
            position=np.zeros((n, len(platform.stages))),
            seen=np.zeros(n, dtype=np.bool_),
            masses=Masses.of(platform, "mass_magnetic_pid"),
            coils=Coils.of(platform, "mass_magnetic_pid"),
            tick=platform.tick,
        )

    def update(
        self, state: Balance, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Balance]:
        """Stage positions and dipole; as they are and none in a run that has not been seen yet."""
        up = vertical_body(estimate.attitude)
        error = np.zeros_like(up)
        error[:, 0], error[:, 1] = up[:, 1], -up[:, 0]  # u x z

        direct = state.masses.leaning(-self.proportional * error, up)
        step = state.masses.leaning(-self.integral * state.tick * error, up)
        before = np.where(state.seen[:, None], state.position, estimate.stage_position)
        position, masses = state.masses.integrated(before, step, direct)
        rate = estimate.rate_body
        across = rate - np.einsum("ni,ni->n", rate, up)[:, None] * up
        dipole = state.coils.dipole(estimate.attitude, -self.derivative * across)

        seen = estimate.valid[:, None]
        command = {
            "command_stage_position": np.where(seen, masses, before),
            "command_dipole": np.where(seen, dipole, 0.0),
        }
        position = np.where(seen, position, before)
        return command, replace(state, position=position, seen=state.seen | estimate.valid)
