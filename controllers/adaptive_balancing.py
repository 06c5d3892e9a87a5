"""Balance while moving: masses adapt to what disturbs a momentum that gyros or wheels hold."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.exchange import Exchange, exchange_of, follow_momentum
from twin.controller.masses import Masses
from twin.platform import Platform
from twin.rotation import cross, vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Adaptation:
    """What the law remembers."""

    position: Array
    """Of each stage, (n, stages) [m]."""
    seen: NDArray[np.bool_]
    """(n,) whether it began: at the stages' positions of the first estimate."""
    masses: Masses
    exchange: Exchange
    mass: float
    """Of everything that floats [kg]."""
    tick: float
    """[s]."""


@dataclass(frozen=True)
class AdaptiveBalancing(Controller[Adaptation]):
    """Momentum tracking by gyros or wheels, and masses that adapt to gravity's part in its error.

    H~    = H_s - H_d,  H_s = J w,  H_d = J w_d                  [N m s, body]         (18, 33)
    tau   = -K H~ + w x H_s + dH_d/dt = -dh/dt - w x h           torque on the body    (35)
    d_dot = Gamma m^2 G^-1 [g x]^T H~,  G = (m_1 u_1 ... m_N u_N)    rate of the stages    (29, 37)

    [g x]^T H~ = H~ x g with g in the body. Where stages are not three, G^-1 is the pseudo-inverse.
    With p = m r of the body as it is (m (r_0 + dr) in the source, which prints r_0 - dr in eq. 23
    and 36 and r + dr in 25), dH~/dt = -K H~ + p x g, dp/dt = Gamma m^2 H~ x g, and

        V = |H~|^2 / 2 + |p|^2 / (2 Gamma m^2),   dV/dt = -K |H~|^2 <= 0:

    stable for any positive K and Gamma, as long as no stage is at a limit. Gamma is not in the
    source, which so adds a momentum to a length and asks for metres a second. Across gravity
    s^2 + K s + b = 0 with b = Gamma m^2 |g|^2. What exceeds a stage's speed slows all stages alike,
    so that the CM keeps its direction; at the end of its travel a stage stands.

    Without excitation (`--reference hold`: H_d = 0) the momentum vanishes, but the CM stops
    anywhere on the vertical through the CR: [g x] has a null vector. A reference that tilts the
    body persistently brings it into the CR; for a small tilt at the frequency f it decays along the
    vertical as exp(-c t),

        c = <tilt^2> b K f^2 / ((b - f^2)^2 + f^2 K^2),   c = <tilt^2> f^2 / K where b = f^2:

    faster stages do not help, they only follow the vertical. The source has sines in roll and
    pitch. It follows the momentum of the reference, not the attitude, which drifts by what is
    adapted.

    Source: J.-J. Kim, B. N. Agrawal, System identification and automatic mass balancing of
    ground-based three-axis spacecraft simulator, eq. 16 to 38. J is that at stage position 0, and
    what the sliding masses carry is left out of H_s (their eq. 18 to 20).
    """

    reference: ClassVar[str] = "multisine:10@0.03"

    gain: float = field(default=0.3, metadata={"unit": "1/s"})
    """K."""
    adaptation: float = field(default=6e-9, metadata={"unit": "s^2/(kg^2 m^2)"})
    """Gamma; with 400 kg b is (0.3 rad/s)^2, about that of the reference's tones."""

    def init(self, platform: Platform, n: int) -> Adaptation:
        """Nothing adapted yet."""
        return Adaptation(
            position=np.zeros((n, len(platform.stages))),
            seen=np.zeros(n, dtype=np.bool_),
            masses=Masses.of(platform, "adaptive_balancing"),
            exchange=exchange_of(platform, "adaptive_balancing"),
            mass=platform.mass,
            tick=platform.tick,
        )

    def update(
        self, state: Adaptation, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Adaptation]:
        """Gimbal rates or motor torques, and stage positions; none in a run not yet seen."""
        error, change = follow_momentum(state.exchange, estimate, target, self.gain)
        masses = state.masses
        gravity = -masses.gravity * vertical_body(estimate.attitude)
        rate = masses.positions(self.adaptation * state.mass**2 * cross(error, gravity))
        excess = np.max(np.abs(rate) / masses.speed, axis=1, initial=1.0)
        low, high = masses.travel
        before = np.where(state.seen[:, None], state.position, estimate.stage_position)
        position = np.clip(before + state.tick * rate / excess[:, None], low, high)
        position = np.where(estimate.valid[:, None], position, before)
        command = state.exchange.command(change, estimate, time)
        command["command_stage_position"] = position
        return command, replace(state, position=position, seen=state.seen | estimate.valid)
