"""Balance in the plane: sliding masses level the body and so bring its CM under the CR."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.masses import Masses
from twin.platform import Platform
from twin.rotation import cross, vertical_body
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
    tick: float
    """[s]."""


@dataclass(frozen=True)
class MassPID(Controller[Balance]):
    """Quaternion PID by balance masses.

    tau = -K_q q_e,vec - K_I int q_e,vec dt - K_w w         torque asked for [N m, body]  (22)
    d_j = (g x tau)_j / (m_j |g|^2),  g = R^T (0, 0, -g)    position of stage j [m]       (19)

    For stages whose axes are not orthogonal, the component along axis j becomes pinv(u_1 ... u_N).
    q_e is the error without its yaw: the shortest turn from the target's vertical to the body's.
    Masses give no torque about the vertical, and with the full quaternion a free yaw would turn
    the correction away from the tilt. The integral is kept as a position of each stage, with
    g where the target has it: the same for small tilts, it leaves a vertical stage alone, and its
    windup stops stage by stage, while a stage is asked to go beyond its travel.

    With k = -m g r_z (CM below the CR: k > 0) each horizontal axis of small tilt obeys
    J s^3 + K_w s^2 + (K_q / 2 + k) s + K_I / 2 = 0, stable by Routh if K_q + 2 k > 0 and

        K_I < K_w (K_q + 2 k) / J.

    Source: S. Y. Choi, Automatic mass balancing system for the 5-DOF spacecraft simulator, Georgia
    Institute of Technology 2016, eq. 19 and 22, with K_q = 1 and K_w = 5. K_I = 1 as printed there
    breaks the bound (0.44 about its roll axis). 0.1 keeps it on `sads` too: 0.44 at J = 12 kg m^2
    and k = 0.03 N m/rad as shipped, and until the CM is 0.4 mm above the CR (95 kg).
    """

    proportional: float = field(default=1.0, metadata={"unit": "N m"})
    """K_q, per unit of the error quaternion's vector part."""
    integral: float = field(default=0.1, metadata={"unit": "N m/s"})
    """K_I, per unit of the error quaternion's vector part and second."""
    derivative: float = field(default=5.0, metadata={"unit": "N m s"})
    """K_w, per body rate."""

    def init(self, platform: Platform, n: int) -> Balance:
        """Nothing balanced yet."""
        masses = Masses.of(platform, "mass_pid")
        position, seen = np.zeros((n, len(platform.stages))), np.zeros(n, dtype=np.bool_)
        return Balance(position, seen, masses, platform.tick)

    def update(
        self, state: Balance, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Balance]:
        """Position of each stage; where it is in a run that has not been seen yet."""
        up = vertical_body(estimate.attitude)
        wanted_up = vertical_body(target.attitude)
        cosine = np.einsum("...i,...i->...", up, wanted_up)[:, None]
        # Zero only upside down, where no shortest turn exists.
        error = cross(up, wanted_up) / np.sqrt(np.maximum(2.0 * (1.0 + cosine), 1e-12))

        damped = -self.proportional * error - self.derivative * estimate.rate_body
        direct = state.masses.leaning(damped, up)
        step = state.masses.leaning(-self.integral * state.tick * error, wanted_up)
        before = np.where(state.seen[:, None], state.position, estimate.stage_position)
        position, command = state.masses.integrated(before, step, direct)
        seen = estimate.valid[:, None]
        position, command = np.where(seen, position, before), np.where(seen, command, before)
        begun = state.seen | estimate.valid
        return {"command_stage_position": command}, replace(state, position=position, seen=begun)
