"""Drag of the room's air on whatever sticks out of the platform."""

from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_body import Array, BodyEffect, State, TorqueLaw
from twin.platform import Platform

VARIANTS = ("axes", "norm")


@dataclass(frozen=True)
class AerodynamicDrag(BodyEffect):
    """The air brakes with the square of the rate: torque -b |w_i| w_i about each axis.

    MuJoCo's joint damping is a polynomial and has the term: exact at every stage of RK4. The
    variant `norm`, torque -b |w| w, is a law that Python evaluates once a physics step.
    """

    name = "aerodynamic_drag"
    domain = Domain.torque
    observable = "the rate decays hyperbolically, fast rates much faster than slow ones"
    streams = ("gyro",)

    drag: float = parameter(
        "torque per squared rate",
        "N m s^2",
        5e-3,
        source="1/2 rho C_d A r^3 of 0.05 m^2 at 0.5 m from the axis, C_d = 1.2",
        low=0.0,
        high=100.0,
    )
    variant: Literal["axes", "norm"] = field(default="axes")
    """Squared axis by axis, or with the norm of the rate."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.variant not in VARIANTS:
            raise EffectError(
                f"{self.name}: variant is {self.variant!r}; use one of 'axes', 'norm'"
            )

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        if self.variant == "axes":
            spec.joint(platform.base.joint).damping[1] += self.drag

    def torque(self, platform: Platform) -> TorqueLaw | None:
        return self._by_norm if self.variant == "norm" else None

    def _by_norm(self, state: State) -> Array:
        size = np.sqrt(np.einsum("ni,ni->n", state.rate, state.rate))
        return -self.drag * size[:, None] * state.rate
