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

    def check(self, command: Command, n: int) -> None:
        """Refuse what no machine of this kind could take.

        Raises:
            UnknownName: a channel the machine lacks.
            CommandError: an array of the wrong shape.
        """
        for name, value in command.items():
            if name not in self._widths:
                raise UnknownName("command channel of this platform", name, self._widths)
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
