"""What the paper's simulation adds to the model: a torque of which only the bounds are known."""

from dataclasses import dataclass, field

import numpy as np

from twin.effects import BodyEffect, State
from twin.effects.effect import Domain, parameter
from twin.effects.on_body import Array, TorqueLaw
from twin.platform import Platform

HOLD = 0.2
"""[s] for which a draw is held: the paper's step."""


@dataclass(frozen=True)
class UncertainTorque(BodyEffect):
    """Uniform between two bounds about each body axis, drawn anew each 0.2 s, for each run."""

    name = "uncertain_torque"
    domain = Domain.torque
    observable = "a white torque on the body"
    streams = ("gyro",)

    size: float = parameter(
        "bound",
        "N m",
        0.01,
        source='Sharifi and others, "between -0.01 and 0.01 N m"',
        low=0.0,
        high=1.0,
    )
    seed: int = field(default=0)
    """Of the draws."""

    @property
    def intensity(self) -> float:
        """Of a white torque that turns a body as far [(N m)^2 s]."""
        return self.size**2 / 3.0 * HOLD

    def torque(self, platform: Platform) -> TorqueLaw:
        drawn: dict[int, Array] = {}

        def law(state: State) -> Array:
            piece = int(state.time[0] / HOLD + 1e-6)
            if piece not in drawn:
                drawn.clear()
                rng = np.random.default_rng((self.seed, piece))
                drawn[piece] = rng.uniform(-self.size, self.size, (len(state.time), 3))
            return drawn[piece]

        return law
