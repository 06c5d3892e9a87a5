"""Follow a momentum with wheels or control moment gyros, whatever the attitude."""

from dataclasses import dataclass, field
from typing import ClassVar

from twin.controller import Controller
from twin.controller.exchange import Exchange, exchange_of, follow_momentum
from twin.platform import Platform
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class MomentumTracking(Controller[Exchange]):
    """The momentum of the body follows that of the reference motion.

    H_s = J w,  H_d = J w_d                     of the body and its aim, body axes [N m s]
    tau = -K (H_s - H_d) + w x H_s + dH_d/dt    torque on the body [N m, body]

    By wheels or gyros, dh/dt = -tau - w x h. The error obeys d(H_s - H_d)/dt = -K (H_s - H_d) +
    m r x g: on a balanced body it vanishes as exp(-K t), V = |H_s - H_d|^2 / 2 never growing; else
    gravity leaves |m r x g| / K of it, and the attitude, which nothing holds, drifts with that.

    Source: J.-J. Kim, B. N. Agrawal, System identification and automatic mass balancing of
    ground-based three-axis spacecraft simulator, eq. 33 to 35. There it is half of the adaptive
    balancing (`adaptive_balancing`), not a law of its own: here the masses stand still.
    """

    reference: ClassVar[str] = "multisine"

    gain: float = field(default=1.0, metadata={"unit": "1/s"})
    """K."""

    def init(self, platform: Platform, n: int) -> Exchange:
        """Gyros or wheels."""
        return exchange_of(platform, "momentum_tracking")

    def update(
        self, state: Exchange, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Exchange]:
        """Gimbal rates or motor torques; none in a run that has not been seen yet."""
        _, change = follow_momentum(state, estimate, target, self.gain)
        return state.command(change, estimate, time), state
