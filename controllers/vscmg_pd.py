"""Hold or follow an attitude with variable-speed control moment gyros, clear of singular states."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.exchange import REGULARITY, Gyros
from twin.controller.pointing import pointing_error
from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import cross
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Steered:
    """The gyros, and what their wheels can do."""

    gyros: Gyros
    carried: Array
    """(gimbals, wheels) 1 where a gimbal carries a wheel."""
    capacity: Array
    """(wheels,) what a wheel can hold [N m s]: the unit of its acceleration below."""
    speed: Array
    """(wheels,) at which it holds that [rad/s]."""
    home: Array
    """(gimbals + wheels,) angles [rad], and speeds in parts of that, at the start of a run."""


@dataclass(frozen=True)
class VscmgPD(Controller[Steered]):
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

    def init(self, platform: Platform, n: int) -> Steered:
        """Where the gyros stand."""
        gyros, wheels = Gyros.of(platform, "vscmg_pd"), platform.wheels
        carried = np.array(
            [[float(w.gimbal == g.name) for w in wheels] for g in platform.gimbals]
        ).reshape(len(platform.gimbals), len(wheels))
        if not len(wheels) or not carried.any(axis=0).all():
            raise ControllerError(
                f"vscmg_pd drives gimbals and the wheels on them, but {platform.name} has "
                f"{int(carried.sum())} wheels on gimbals of {len(wheels)}: choose `cmg_pd` for "
                "rotors at constant speed"
            )
        speed = np.array([wheel.speed_limit for wheel in wheels])
        angles = np.array([gimbal.home for gimbal in platform.gimbals])
        speeds = np.array([wheel.home for wheel in wheels]) / speed
        capacity = np.array([wheel.momentum_limit for wheel in wheels])
        return Steered(gyros, carried, capacity, speed, np.concatenate([angles, speeds]))

    def update(
        self, state: Steered, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Steered]:
        """Gimbal rates and motor torques; none in a run that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        torque = -self.proportional * error[:, 1:] - self.derivative * rate_error
        gyros = state.gyros
        change = -torque - cross(estimate.rate_body, gyros.momentum(estimate))

        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        spinning = np.einsum("gw,ngi->nwi", state.carried, gyros.along(estimate))
        spinning = state.capacity[:, None] * spinning
        columns = np.concatenate([gyros.columns(estimate), spinning], axis=1)  # Q^T
        gimbals = len(state.carried)
        mu = self.share * np.exp(-gyros.regularity(estimate) / self.regularity)
        weight = np.ones(columns.shape[:2])
        weight[:, gimbals:] = mu[:, None]
        steering = weight * _inverse(columns, weight, change)

        now = np.concatenate([estimate.gimbal_angle, estimate.wheel_speed / state.speed], axis=1)
        away = self.homing * (state.home - now)
        seen = np.einsum("nki,nk->ni", columns, away)
        moved = steering + away - _inverse(columns, np.ones_like(weight), seen)
        moved = np.where(estimate.valid[:, None], moved, 0.0)
        return {
            "command_gimbal_rate": moved[:, :gimbals],
            "command_wheel_torque": state.capacity * moved[:, gimbals:],
        }, state


def _inverse(columns: Array, weight: Array, change: Array) -> Array:
    """Q^T (Q M Q^T)^-1 of a change of momentum, (n, k)."""
    square = np.einsum("nki,nk,nkj->nij", columns, weight, columns)
    # So small that it only keeps an array at rest, with nothing to turn, from dividing by zero.
    share = np.linalg.solve(square + 1e-12 * np.eye(3), change[..., None])[..., 0]
    return np.einsum("nki,ni->nk", columns, share)
