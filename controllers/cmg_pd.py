"""Hold or follow an attitude with control moment gyros: quaternion feedback and gimbal steering."""

from dataclasses import dataclass, field

import numpy as np

from twin.controller import Controller
from twin.controller.exchange import DAMPING, DITHER, REGULARITY, Gyros
from twin.controller.pointing import pointing_error
from twin.platform import Platform
from twin.rotation import cross
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class CmgPD(Controller[Gyros]):
    """Quaternion feedback by control moment gyros.

    q_e    = q_d^* q, taken with q_e0 >= 0             error of the body from the target
    tau    = -K_p q_e,vec - K_d w_e                    torque on the body [N m, body]
    dh/dt  = -tau - w x h,  h = sum h_i                what the array has to do
    ddelta = A^T (A A^T + lambda E)^-1 dh/dt           gimbal rates [rad/s]
    A      = columns H_i (b_i cos delta_i - a_i sin delta_i)

    The inverse is exact away from singular angles and bounded near them, at the price of a torque
    that errs there; lambda and E are in `twin.controller.exchange.Gyros.rates`. With damping 0 it
    is the source's plain inverse, which cannot leave a singular state. E leads out
    slowly, the sooner the smaller lambda, and not where two directions are lost at once, as at
    delta = 0 with a skew of 90 deg, or where the momentum asked for is beyond the array's.

    Source: J.-J. Kim, B. N. Agrawal, System identification and automatic mass balancing of
    ground-based three-axis spacecraft simulator, eq. 1 and 39 to 42 (eq. 39 agrees with A only
    with -cos(beta) sin(delta_2), or at a skew beta of 90 deg). Where a gimbal carries a wheel, its
    momentum is as measured.
    """

    proportional: float = field(default=12.0, metadata={"unit": "N m"})
    """K_p, per unit of the error quaternion's vector part."""
    derivative: float = field(default=30.0, metadata={"unit": "N m s"})
    """K_d, per rate error."""
    damping: float = field(default=DAMPING, metadata={"unit": "1"})
    """lambda at a singular state, in parts of H^2."""
    regularity: float = field(default=REGULARITY, metadata={"unit": "1"})
    """det(A A^T) below which the damping sets in, in parts of H^6."""
    dither: float = field(default=DITHER, metadata={"unit": "1"})
    """Of E beside its diagonal: what leads out of a singular state."""

    def init(self, platform: Platform, n: int) -> Gyros:
        """Where the gyros stand."""
        return Gyros.of(platform, "cmg_pd")

    def update(
        self, state: Gyros, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Gyros]:
        """Rate of each gimbal; none in a run that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        torque = -self.proportional * error[:, 1:] - self.derivative * rate_error
        rates = state.rates(
            -torque - cross(estimate.rate_body, state.momentum(estimate)),
            estimate,
            time,
            damping=self.damping,
            regularity=self.regularity,
            dither=self.dither,
        )
        return {"command_gimbal_rate": np.where(estimate.valid[:, None], rates, 0.0)}, state
