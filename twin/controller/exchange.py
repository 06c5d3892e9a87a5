"""What exchanges momentum with the body, wheels or control moment gyros, behind one interface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.controller.gyros import Gyros
from twin.errors import ControllerError
from twin.platform import Platform
from twin.signals import Command, Estimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wheels:
    """Reaction wheels; h = A h_a, with each wheel's whole momentum about its axis.

    h_a,i = I_i (Omega_i + a_i . w) changes by the motor's torque alone. With it goes the inertia
    of the body less what the wheels have about their axes, J - sum I_i a_i a_i^T: then

    J w + h is the whole momentum and  J dw/dt + w x (J w + h) = -dh/dt + torque from outside.
    """

    axes: Array
    """(wheels, 3) a_i."""
    spin: Array
    """(wheels,) I_i [kg m^2]."""
    share: Array
    """pinv(A), (wheels, 3): least sum of squares."""
    inertia: Array
    """(3, 3) of the body, without the wheels about their axes [kg m^2]."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "Wheels":
        """Those of the platform.

        Raises:
            ControllerError: they do not turn the body about three axes, as `law` does, or some of
                them stand in gimbals.
        """
        axes = fixed_axes(platform, law)
        spin = np.array([wheel.inertia for wheel in platform.wheels])
        share = np.asarray(np.linalg.pinv(axes.T), dtype=np.float64)
        return cls(axes, spin, share, platform.inertia - (axes.T * spin) @ axes)

    def momentum(self, estimate: Estimate) -> Array:
        """h, (n, 3) [N m s, body]."""
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        turning = np.einsum("wi,ni->nw", self.axes, estimate.rate_body)
        return np.einsum("wi,nw->ni", self.axes, self.spin * (estimate.wheel_speed + turning))

    def command(self, change: Array, estimate: Estimate, time: float) -> Command:
        """Motor torques for a change of h (n, 3) [N m, body]; none in a run not yet seen."""
        torque = np.einsum("wi,ni->nw", self.share, change)
        return {"command_wheel_torque": np.where(estimate.valid[:, None], torque, 0.0)}


def fixed_axes(platform: Platform, law: str) -> Array:
    """Axes of the wheels, (wheels, 3), which stay where they are in the body.

    Raises:
        ControllerError: they do not turn the body about three axes, as `law` does, or some of them
            stand in gimbals.
    """
    axes = np.array([w.axis for w in platform.wheels if w.gimbal is None]).reshape(-1, 3)
    if np.linalg.matrix_rank(axes) < 3:
        raise ControllerError(
            f"{law} turns the body about three axes, but the {len(axes)} wheels of "
            f"{platform.name} do not; choose a platform whose wheels do"
        )
    carried = ", ".join(wheel.name for wheel in platform.wheels if wheel.gimbal is not None)
    if carried:
        raise ControllerError(
            f"{law} turns the body by wheels that stand still in it, but {carried} of "
            f"{platform.name} turn with a gimbal; choose a platform whose wheels are all fixed"
        )
    return axes


Exchange = Wheels | Gyros


def exchange_of(platform: Platform, law: str) -> Exchange:
    """Gyros where the platform has them, else its wheels.

    Raises:
        ControllerError: neither turns the body about three axes, as `law` does.
    """
    if len(platform.gimbals) >= 3:
        return Gyros.of(platform, law)
    return Wheels.of(platform, law)
