"""Tanks that lose more gas than the thrusters use."""

from dataclasses import dataclass

from twin.effects.effect import Domain, parameter
from twin.effects.on_series import Array, Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.signals import Samples


@dataclass(frozen=True)
class GasConsumption(SeriesEffect):
    """A valve leaks: the pressure falls by p_0 c t / m_0 beside what the thrusters take.

    At constant temperature, while the tanks are not empty. What has left is not taken off the
    machine's mass: `center_of_mass_drift` has that.
    """

    name = "gas_consumption"
    domain = Domain.actuator
    observable = "the pressure falls while no thruster fires"
    streams = ("gas_pressure", "command_thruster")
    order = Order.bias
    acts_on = "gas_pressure"

    rate: float = parameter(
        "gas lost per second",
        "kg/s",
        1e-5,
        source="ASSUMED: a tank of 0.5 kg empty overnight",
        low=0.0,
        high=1.0,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        return missing or ("" if platform.gas else "it states no gas")

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - self._lost(samples, platform))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + self._lost(samples, platform))

    def _lost(self, samples: Samples, platform: Platform) -> Array:
        assert platform.gas is not None
        return self.rate * platform.gas.pressure / platform.gas.mass * samples.time[..., None]
