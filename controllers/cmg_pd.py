"""Hold or follow an attitude with control moment gyros: quaternion feedback and gimbal steering."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import conjugate, cross, multiply, rotate
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gyros:
    """The array of gyros: at gimbal angle delta, h_i = H_i (a_i cos delta + b_i sin delta)."""

    spin: Array
    """(gimbals, 3) a_i, at angle 0."""
    across: Array
    """(gimbals, 3) b_i = g_i x a_i."""
    momentum: Array
    """(gimbals,) H_i of a rotor at constant speed, 0 for a wheel [N m s]."""
    wheel: Array
    """(gimbals, wheels) inertia of the wheel that a gimbal carries [kg m^2]."""
    torque_scale: float
    """(sum of H_i^2)^(1/2), or of what the wheels can hold [N m s]."""


@dataclass(frozen=True)
class CmgPD(Controller[Gyros]):
    """Quaternion feedback by control moment gyros.

    q_e    = q_d^* q, taken with q_e0 >= 0             error of the body from the target
    tau    = -K_p q_e,vec - K_d w_e                    torque on the body [N m, body]
    dh/dt  = -tau - w x h,  h = sum h_i                what the array has to do
    ddelta = A^T (A A^T + lambda I)^-1 dh/dt           gimbal rates [rad/s]
    A      = columns H_i (b_i cos delta_i - a_i sin delta_i)

    lambda = damping H^2 exp(-det(A A^T) / (regularity H^6)) leaves the inverse exact away from
    singular angles and bounded near them, at the price of a torque that errs there.

    Source: J.-J. Kim, B. N. Agrawal, System identification and automatic mass balancing of
    ground-based three-axis spacecraft simulator, eq. 1 and 39 to 42; the damped inverse after
    Y. Nakamura and H. Hanafusa, 1986. Where a gimbal carries a wheel, its momentum is as measured.
    """

    proportional: float = field(default=12.0, metadata={"unit": "N m"})
    """K_p, per unit of the error quaternion's vector part."""
    derivative: float = field(default=30.0, metadata={"unit": "N m s"})
    """K_d, per rate error."""
    damping: float = field(default=0.05, metadata={"unit": "1"})
    """lambda at a singular state, in parts of H^2."""
    regularity: float = field(default=1e-3, metadata={"unit": "1"})
    """det(A A^T) below which the damping sets in, in parts of H^6."""

    def init(self, platform: Platform, n: int) -> Gyros:
        """Where the gyros stand."""
        gimbals, wheels = platform.gimbals, platform.wheels
        carried = {part.gimbal: part for part in (*platform.rotors, *wheels)}
        if len(gimbals) < 3:
            raise ControllerError(
                f"cmg_pd turns the body by three gimbals or more; {platform.name} has "
                f"{len(gimbals)}: choose a platform with control moment gyros"
            )
        spin = np.array([carried[gimbal.name].axis for gimbal in gimbals])
        axis = np.array([gimbal.axis for gimbal in gimbals])
        fixed = {rotor.gimbal: rotor.momentum for rotor in platform.rotors}
        momentum = np.array([fixed.get(gimbal.name, 0.0) for gimbal in gimbals])
        wheel = np.array(
            [[w.inertia * (w.gimbal == gimbal.name) for w in wheels] for gimbal in gimbals]
        ).reshape(len(gimbals), len(wheels))
        most = np.array([w.momentum_limit for w in wheels if w.gimbal is not None])
        scale = float(np.sqrt(np.sum(momentum**2) + np.sum(most**2)))
        return Gyros(spin, cross(axis, spin), momentum, wheel, scale)

    def update(
        self, state: Gyros, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Gyros]:
        """Rate of each gimbal; none in a run that has not been seen yet."""
        error = multiply(conjugate(target.attitude), estimate.attitude)
        shortest = np.copysign(1.0, error[:, :1])
        rate_error = estimate.rate_body - rotate(conjugate(error), target.rate_body)
        torque = -self.proportional * shortest * error[:, 1:] - self.derivative * rate_error

        sine, cosine = np.sin(estimate.gimbal_angle), np.cos(estimate.gimbal_angle)
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        size = state.momentum + np.einsum("gw,nw->ng", state.wheel, estimate.wheel_speed)
        along = cosine[..., None] * state.spin + sine[..., None] * state.across
        turning = cosine[..., None] * state.across - sine[..., None] * state.spin
        momentum = np.einsum("ng,ngi->ni", size, along)
        columns = size[..., None] * turning  # A^T, (n, gimbals, 3)
        wanted = -torque - cross(estimate.rate_body, momentum)

        scale = state.torque_scale**2
        square = np.einsum("ngi,ngj->nij", columns, columns) / scale
        near = np.exp(-np.linalg.det(square) / self.regularity)
        square = square + (self.damping * near)[:, None, None] * np.eye(3)
        share = np.linalg.solve(square, wanted[..., None])[..., 0] / scale
        rates = np.einsum("ngi,ni->ng", columns, share)
        return {"command_gimbal_rate": np.where(estimate.valid[:, None], rates, 0.0)}, state
