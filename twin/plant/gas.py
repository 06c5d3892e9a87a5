"""Thrusters on a bearing that stands, and the tanks that feed them."""

import numpy as np
from numpy.typing import NDArray

from twin.effects import BodyEffect
from twin.model import Machine
from twin.platform import Gas
from twin.units import STANDARD_GRAVITY

Array = NDArray[np.float64]


def thruster_arms(machine: Machine) -> Array:
    """(thrusters, 3) torque about the CR per force of each [m], body axes, effects and all."""
    arms: list[Array] = []
    for thruster in machine.platform.thrusters:
        for effect in machine.effects:
            if isinstance(effect, BodyEffect):
                thruster = effect.edit_thruster(thruster)
        arms.append(np.cross(thruster.point, thruster.direction))
    return np.array(arms).reshape(-1, 3)


class Tanks:
    """Gas left in n runs. A thruster's force F takes F / (I_sp g_0) kilograms a second.

    What has left is not taken off the machine's mass: that is an effect of its own.
    """

    def __init__(self, gas: Gas, n: int) -> None:
        self.mass = np.full(n, gas.mass)
        """(n,) [kg]."""
        self._gas = gas
        self._exhaust_speed = gas.specific_impulse * STANDARD_GRAVITY

    @property
    def pressure(self) -> Array:
        """(n,) at constant temperature [Pa]."""
        return self._gas.pressure * self.mass / self._gas.mass

    def fed(self, force: Array) -> Array:
        """The force (n, thrusters) [N] that there is gas for: none once the tanks are empty."""
        return np.where(self.mass[:, None] > 0.0, force, 0.0)

    def draw(self, force: Array, duration: float) -> None:
        """Take out what the force (n, thrusters) [N], held for `duration` [s], needs."""
        used = force.sum(axis=1) * (duration / self._exhaust_speed)
        self.mass = np.maximum(self.mass - used, 0.0)
