"""Hold or follow an attitude with variable-speed control moment gyros, clear of singular states."""

from dataclasses import dataclass, field

from twin.controller import Controller
from twin.controller.exchange import REGULARITY, VariableSpeedGyros
from twin.controller.pointing import pointing_error
from twin.platform import Platform
from twin.rotation import cross
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class VscmgPD(Controller[VariableSpeedGyros]):
    """Quaternion feedback by gyros whose wheels help at singular angles, and null motion.

    tau = -K_p q_e,vec - K_d w_e = -dh/dt - w x h        torque on the body [N m, body]
    y   = M Q^T (Q M Q^T)^-1 dh/dt + k (I - Q^+ Q) (y_0 - y_now)
    Q   = (H_i (b_i cos delta_i - a_i sin delta_i) ...  C_j (a_j cos delta_j + b_j sin delta_j) ...)
    M   = diag(1 ... mu ...),  mu = share exp(-det(A A^T) / (regularity H^6))

    y: the gimbal rates [rad/s], and the wheels' accelerations in parts of their highest speed, so
    that C_j, what a wheel can hold, stands where a gyro has H_i; motor torque T_j = C_j y_j. A are
    the gimbals' columns alone. Away from singular angles mu vanishes and the gimbals do it all,
    near them the wheels give what the gimbals cannot, and the torque is exact in both.

    The null motion leaves h alone, Q (I - Q^+ Q) = 0, and takes angles and speeds home, where the
    array is far from singular: |y_0 - y_now|^2 never grows by it, since I - Q^+ Q is a projection.

    Source: H. Schaub, S. R. Vadali, J. L. Junkins, Feedback control law for variable speed control
    moment gyros, J. Astronautical Sciences 46(3), 1998 (M); H. Schaub, J. L. Junkins, Singularity
    avoidance using null motion and variable-speed control moment gyros, J. Guidance 23(1), 2000;
    for the machine of S. Y. Choi, Automatic mass balancing system for the 5-DOF spacecraft
    simulator, Georgia Institute of Technology 2016, which names the gyros and prints no steering.
    """

    proportional: float = field(default=5.0, metadata={"unit": "N m"})
    """K_p, per unit of the error quaternion's vector part."""
    derivative: float = field(default=8.0, metadata={"unit": "N m s"})
    """K_d, per rate error."""
    share: float = field(default=1.0, metadata={"unit": "1"})
    """mu at a singular state."""
    regularity: float = field(default=REGULARITY, metadata={"unit": "1"})
    """det(A A^T) below which the wheels set in, in parts of H^6."""
    homing: float = field(default=0.1, metadata={"unit": "1/s"})
    """k, of the null motion; 0 for none."""

    def init(self, platform: Platform, n: int) -> VariableSpeedGyros:
        """Where the gyros stand."""
        return VariableSpeedGyros.of(platform, "vscmg_pd")

    def update(
        self, state: VariableSpeedGyros, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, VariableSpeedGyros]:
        """Gimbal rates and motor torques; none in a run that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        torque = -self.proportional * error[:, 1:] - self.derivative * rate_error
        change = -torque - cross(estimate.rate_body, state.momentum(estimate))
        command = state.steered(
            change, estimate, share=self.share, regularity=self.regularity, homing=self.homing
        )
        return command, state
