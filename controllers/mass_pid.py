"""Balance in the plane: sliding masses level the body and so bring its CM under the CR."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import cross, vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Balance:
    """What the law remembers."""

    position: Array
    """Integral part of each stage's position, (n, stages) [m]: where it balances the body."""
    allocation: Array
    """Stage position per mass moment, (stages, 3) [1/kg]."""
    travel: Array
    """Lowest and highest position, (2, stages) [m]."""
    gravity: float
    """[m/s^2]."""
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
        """Stages at their zero."""
        stages = platform.stages
        axes = np.array([stage.axis for stage in stages]).reshape(-1, 3)
        if np.linalg.matrix_rank(axes[:, :2]) < 2:
            raise ControllerError(
                f"mass_pid moves the CM in both horizontal directions, but the {len(axes)} stages "
                f"of {platform.name} do not; choose a platform whose stages do"
            )
        masses = np.array([stage.mass for stage in stages])
        return Balance(
            position=np.zeros((n, len(stages))),
            allocation=np.linalg.pinv(axes.T) / masses[:, None],
            travel=np.array([stage.travel for stage in stages]).T,
            gravity=platform.gravity,
            tick=platform.tick,
        )

    def update(
        self, state: Balance, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Balance]:
        """Position of each stage; its zero in a run that has not been seen yet."""
        up = vertical_body(estimate.attitude)
        wanted_up = vertical_body(target.attitude)
        cosine = np.einsum("...i,...i->...", up, wanted_up)[:, None]
        # Zero only upside down, where no shortest turn exists.
        error = cross(up, wanted_up) / np.sqrt(np.maximum(2.0 * (1.0 + cosine), 1e-12))

        damped = -self.proportional * error - self.derivative * estimate.rate_body
        direct = _positions(state, damped, up)
        step = _positions(state, -self.integral * state.tick * error, wanted_up)
        low, high = state.travel
        asked = state.position + step + direct
        beyond = ((asked > high) & (step > 0.0)) | ((asked < low) & (step < 0.0))
        seen = estimate.valid[:, None]
        position = np.where(seen & ~beyond, state.position + step, state.position)
        command = np.where(seen, np.clip(position + direct, low, high), 0.0)
        return {"command_stage_position": command}, replace(state, position=position)


def _positions(state: Balance, torque: Array, up: Array) -> Array:
    """Equation 19: stage positions (n, stages) [m] that give the torque's horizontal part."""
    moment = cross(torque, up) / state.gravity  # g x tau / |g|^2 with g = -|g| up  [kg m]
    # einsum rather than @: a row's last bits must not depend on how many runs there are.
    return np.einsum("ij,nj->ni", state.allocation, moment)
