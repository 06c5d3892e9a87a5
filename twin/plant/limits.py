"""What a machine's actuators can do: from the command that is wished to the one that is applied."""

import numpy as np
from numpy.typing import NDArray

from twin.errors import CommandError, UnknownName
from twin.platform import Platform
from twin.signals import Command

Array = NDArray[np.float64]


class Limits:
    """The limits of one platform's actuators, as arrays."""

    def __init__(self, platform: Platform) -> None:
        self._widths = platform.commands
        self._tick = platform.tick
        wheels, stages = platform.wheels, platform.stages
        self._wheel_inertia = np.array([wheel.inertia for wheel in wheels])
        self._wheel_speed = np.array([wheel.speed_limit for wheel in wheels])
        self._wheel_torque = np.array([wheel.torque_limit for wheel in wheels])
        self._lowest = np.array([stage.travel[0] for stage in stages])
        self._highest = np.array([stage.travel[1] for stage in stages])
        resolution = np.array([stage.resolution for stage in stages])
        self._resolution = np.where(resolution > 0.0, resolution, 1.0)
        self._stepped = resolution > 0.0
        self._joint_torque = platform.base.torque_limit
        self._gimbal_rate = np.array([gimbal.rate for gimbal in platform.gimbals])
        self._force = np.array([thruster.force_limit for thruster in platform.thrusters])
        self._on_off = np.array([thruster.on_off for thruster in platform.thrusters], dtype=bool)
        coils = platform.magnetorquers
        self._dipole = np.array([coil.dipole_limit for coil in coils])
        self._coil_axes = np.array([coil.axis for coil in coils]).reshape(-1, 3)
        self._coil_share = np.linalg.pinv(self._coil_axes.T)

    def check(self, command: Command, n: int) -> None:
        """Refuse what no machine of this kind could take.

        Raises:
            UnknownName: a channel the machine lacks.
            CommandError: no array of real numbers, or one of the wrong shape.
        """
        for name, value in command.items():
            if name not in self._widths:
                raise UnknownName("command channel of this platform", name, self._widths)
            kind = _kind_unless_real(value)
            if kind:
                raise CommandError(
                    f"{name} is of type {kind}; this platform takes a float64 array of shape "
                    f"{(n, self._widths[name])}"
                )
            if value.shape != (n, self._widths[name]):
                raise CommandError(
                    f"{name} has shape {value.shape}; this platform takes {(n, self._widths[name])}"
                )

    def wheel_torque(self, wanted: Array, speed: Array) -> Array:
        """Torque [N m] that keeps within the motor's limit and lets no wheel pass its top speed."""
        reach = self._wheel_inertia / self._tick
        most = np.minimum(self._wheel_torque, reach * (self._wheel_speed - speed))
        least = np.maximum(-self._wheel_torque, reach * (-self._wheel_speed - speed))
        return np.minimum(np.maximum(wanted, least), most)

    def stage_position(self, wanted: Array) -> Array:
        """Position [m] on the drive's grid and within the travel."""
        on_grid = np.where(
            self._stepped, np.round(wanted / self._resolution) * self._resolution, wanted
        )
        return np.clip(on_grid, self._lowest, self._highest)

    def joint_torque(self, wanted: Array) -> Array:
        """Torque [N m] within the motor's limit."""
        return np.clip(wanted, -self._joint_torque, self._joint_torque)

    def gimbal_rate(self, wanted: Array) -> Array:
        """Rate [rad/s] within the drive's limit."""
        return np.clip(wanted, -self._gimbal_rate, self._gimbal_rate)

    def force(self, wanted: Array) -> Array:
        """Force [N] of each thruster: none pulls, and an on-off valve gives all of it or none."""
        if not self._on_off.any():
            return np.clip(wanted, 0.0, self._force)
        whole = np.where(wanted >= 0.5 * self._force, self._force, 0.0)
        return np.where(self._on_off, whole, np.clip(wanted, 0.0, self._force))

    def coils(self, dipole: Array) -> Array:
        """Moment of each coil (n, coils) that gives a dipole (n, 3) [A m^2, body]."""
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        return np.einsum("ci,ni->nc", self._coil_share, dipole)

    def dipole(self, wanted: Array) -> tuple[Array, Array]:
        """Moment of each coil (n, coils) that gives the dipole as far as its limit lets it.

        Also returns the dipole (n, 3) that it gives [A m^2, body].
        """
        coils = np.clip(self.coils(wanted), -self._dipole, self._dipole)
        return coils, np.einsum("nc,ci->ni", coils, self._coil_axes)


def _kind_unless_real(value: object) -> str:
    """What it is where it is no array of real numbers; empty where it is one."""
    if not isinstance(value, np.ndarray):
        return type(value).__name__
    return "" if value.dtype.kind in "fiub" else f"{value.dtype}"
