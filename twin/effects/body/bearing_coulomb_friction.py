"""Dry friction: dust in the film, a rubbing cable, a cup that touches."""

from dataclasses import dataclass, field

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.errors import EffectError
from twin.effects.on_body import Array, BodyEffect, State, TorqueLaw
from twin.platform import Platform


@dataclass(frozen=True)
class BearingCoulombFriction(BodyEffect):
    """The bearing brakes at every rate alike: torque -c w / sqrt(w^2 + w_s^2).

    MuJoCo's friction loss holds every axis for itself; this one opposes the rate as a whole, so
    Python evaluates it once a physics step. A sign change that takes less than a step is missed.
    """

    name = "bearing_coulomb_friction"
    domain = Domain.torque
    observable = "the rate falls linearly and stops; small swings die first"
    streams = ("gyro",)

    torque_size: float = parameter(
        "torque",
        "N m",
        1e-4,
        source="ASSUMED: as much as 95 kg whose CM stands 0.1 um off",
        low=0.0,
        high=10.0,
    )
    smoothing: float = field(default=1e-4)
    """Rate below which it fades [rad/s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.smoothing < np.inf:
            raise EffectError(
                f"{self.name}: smoothing is {self.smoothing!r} rad/s; it must lie above 0"
            )

    def torque(self, platform: Platform) -> TorqueLaw:
        return self._law

    def _law(self, state: State) -> Array:
        squared = np.einsum("ni,ni->n", state.rate, state.rate)
        size = np.sqrt(squared + self.smoothing**2)
        return -self.torque_size * state.rate / size[:, None]
