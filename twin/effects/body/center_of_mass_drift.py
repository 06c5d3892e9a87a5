"""A CM that wanders: gas that is used up, a structure that warms."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import Array, CoupleEffect, MomentLaw
from twin.platform import Platform

_REACH = 1e5
"""Seconds of drift by which the couple stands apart; only their product acts."""


@dataclass(frozen=True)
class CenterOfMassDrift(CoupleEffect):
    """The mass moment moves steadily: m r += rate t, in the gravity torque.

    A couple of vertical forces that grow with time, held over each physics step at its middle. The
    inertia stays: what moves weighs grams.
    """

    name = "center_of_mass_drift"
    domain = Domain.torque
    observable = "a gravity torque that grows with time"
    streams = ("gyro", "attitude")

    rate: tuple[float, ...] = parameter(
        "change of m r per second, body axes",
        "kg m/s",
        (8e-7, -4e-7, 2e-7),
        source="ASSUMED: 0.1 g of gas a minute from a tank 0.5 m off",
        low=-1.0,
        high=1.0,
    )

    def apart(self) -> Array:
        return _REACH * np.array(self.rate)

    def pull(self, platform: Platform) -> Callable[[Array], Array]:
        per_second = np.array([0.0, 0.0, -platform.gravity / _REACH])
        return lambda time: time[:, None] * per_second

    def mass_moment(self, platform: Platform) -> MomentLaw:
        rate = np.array(self.rate)
        return lambda state: state.time[:, None] * rate
