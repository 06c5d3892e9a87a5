"""Track an attitude exactly with reaction wheels: modified Rodrigues parameters, fed forward."""

from dataclasses import dataclass, field
from typing import ClassVar

from twin.controller import Controller
from twin.controller.exchange import WheeledBody
from twin.controller.pointing import mrp_of, pointing_error
from twin.platform import Platform
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class MrpTracking(Controller[WheeledBody]):
    """Nonlinear tracking by wheels, for any reference motion.

    A g_a = h_b x w + g_g - J w x w_e - J R w_r' + k_1 w_e + k_2 s_e      torque on the rotors [N m]

    h_b = J w + A h_a     the whole momentum, J without the wheels about their axes
    g_g = m r x g         torque of gravity, with m r as the platform states it and at these stages
    w_e = w - R w_r       error of the rate, R from the target's body frame to the body's
    w_r'                  acceleration of the target, in its own frame
    s_e = q_e,vec / (1 + q_e0)      error in MRPs, with q_e0 >= 0: |s_e| <= 1, never singular

    This leaves J dw_e/dt = -k_1 w_e - k_2 s_e, and

        V = w_e^T J w_e / 2 + 2 k_2 ln(1 + |s_e|^2),   dV/dt = -k_1 |w_e|^2 <= 0:

    the error vanishes for any positive k_1 and k_2, as long as the wheels have torque and momentum
    left. Small errors have the stiffness k_2 / 4 [N m/rad].

    Source: J. L. Schwartz, C. D. Hall, System identification of a spherical air-bearing spacecraft
    simulator, AAS 04-122, eq. 26, after C. D. Hall, P. Tsiotras, H. Shen, J. Astronautical Sciences
    50(3), 2002. Their reference is a rigid body under gravity, w_r' = I_r^-1 (h_r x w_r + g_r);
    ours is any. k_1 and k_2 are not printed: these have the stiffness and damping of
    `quaternion_pd`. Where m r is wrong by d, the body stands off by 4 |d x g| / k_2.
    """

    reference: ClassVar[str] = "multisine"

    rate_gain: float = field(default=8.0, metadata={"unit": "N m s"})
    """k_1, per rate error."""
    attitude_gain: float = field(default=10.0, metadata={"unit": "N m"})
    """k_2, per MRP of the error, which is a quarter of a small angle."""

    def init(self, platform: Platform, n: int) -> WheeledBody:
        """What the platform states of the body."""
        return WheeledBody.of(platform, "mrp_tracking")

    def update(
        self, state: WheeledBody, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, WheeledBody]:
        """Torque on each rotor; none in a run that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        change = state.tracking_torque(estimate, error, rate_error, target)
        change = change + self.rate_gain * rate_error + self.attitude_gain * mrp_of(error)
        return state.wheels.command(change, estimate, time), state
