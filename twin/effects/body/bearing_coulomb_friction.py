"""Dry friction: dust in the film, a rubbing cable, a cup that touches."""

from dataclasses import dataclass, field

import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_body import Array, BodyEffect, State, TorqueLaw
from twin.platform import Platform

SHORT = 1e-5
"""Of a change of the rate, as a part of that: the mean over it is the middle, to 1e-11."""


@dataclass(frozen=True)
class BearingCoulombFriction(BodyEffect):
    """The bearing brakes at every rate alike: torque -c w / sqrt(w^2 + w_s^2).

    MuJoCo's friction loss holds every axis for itself; this one opposes the rate as a whole, so
    Python evaluates it once a physics step. A sign change that takes less than a step is missed;
    along a path that is known the torque is its mean over each step, which answers to a change of
    the path as dry friction does.
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
        if state.change is None:
            squared = np.einsum("ni,ni->n", state.rate, state.rate)
            size = np.sqrt(squared + self.smoothing**2)
            return -self.torque_size * state.rate / size[:, None]
        return -self.torque_size * _mean_direction(state.rate, state.change, self.smoothing)


def _mean_direction(rate: Array, change: Array, smoothing: float) -> Array:
    """(n, k) mean of w / sqrt(w^2 + w_s^2) over w = rate + s change, s from -1/2 to 1/2.

    Along the change the integrand is the derivative of a root, across it that of an inverse
    hyperbolic sine.
    """
    length = np.linalg.norm(change, axis=1, keepdims=True)
    along = change / np.where(length > 0.0, length, 1.0)
    middle = np.sum(rate * along, axis=1, keepdims=True)
    across = rate - middle * along
    closest = np.sqrt(np.sum(np.square(across), axis=1, keepdims=True) + smoothing**2)
    first, last = middle - 0.5 * length, middle + 0.5 * length
    roots = np.hypot(closest, first) + np.hypot(closest, last)
    # as the change goes to zero, the integrand in the middle
    short = length < SHORT * roots
    swept = np.arcsinh(last / closest) - np.arcsinh(first / closest)
    weight = np.where(short, 2.0 / roots, swept / np.where(short, 1.0, length))
    return along * (2.0 * middle / roots) + across * weight
