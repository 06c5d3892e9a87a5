"""Air currents of the room: an air conditioner, a door, a person walking by."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import Array, CoupleEffect
from twin.platform import Platform


@dataclass(frozen=True)
class RoomDraft(CoupleEffect):
    """A push fixed in the room that comes and goes: torque p x R^T F sin(2 pi f t + phase).

    A couple of forces, held over each physics step at its middle. A steady draft is the twin of a
    residual dipole.

    No log tells a strong force on a short arm from a weak one on a long arm: a fit leaves one
    component of the point, the largest, as it is.
    """

    name = "room_draft"
    domain = Domain.torque
    observable = "a torque with one line in its spectrum that no command explains"
    streams = ("gyro", "attitude")

    point: tuple[float, ...] = parameter(
        "where it acts, from the CR, body axes",
        "m",
        (0.1, 0.0, 0.3),
        source="ASSUMED: where the platform is widest",
        low=-10.0,
        high=10.0,
        amplitude=False,
    )
    force: tuple[float, ...] = parameter(
        "amplitude, room axes",
        "N",
        (6e-4, 2e-4, 0.0),
        source="1/2 rho v^2 A of 0.1 m/s on 0.1 m^2; at most 0.5 m/s on 0.7 m^2",
        low=-0.1,
        high=0.1,
    )
    frequency: float = parameter(
        "of the sinusoid",
        "Hz",
        0.05,
        source="ASSUMED: a fan that swings in 20 s; air does not push to and fro twice a second",
        low=1e-4,
        high=2.0,
        amplitude=False,
    )
    phase: float = parameter(
        "of the sinusoid at time 0",
        "rad",
        0.5,
        source="any",
        low=-2.0 * np.pi,
        high=2.0 * np.pi,
        amplitude=False,
    )

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """At four phases, where it is thought to act and where those axes are other ones: no force
        turns a body about the line to its point."""
        phases = np.linspace(0.0, np.pi, 4, endpoint=False).tolist()
        x, y, z = self.point
        return tuple(
            replace(self, point=point, frequency=hertz, phase=phase)
            for point in ((x, y, z), (z, x, y))
            for phase in phases
        )

    def apart(self) -> Array:
        return np.array(self.point)

    def pull(self, platform: Platform) -> Callable[[Array], Array]:
        del platform

        def force(time: Array) -> Array:
            turn = 2.0 * np.pi * self.frequency * time + self.phase
            return np.sin(turn)[:, None] * np.array(self.force)

        return force
