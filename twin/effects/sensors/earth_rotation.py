"""The Earth's rotation: a gyro reads it, and it turns the momentum of body and wheels."""

from dataclasses import dataclass

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect, State, TorqueLaw
from twin.effects.on_series import Array, ReadingEffect
from twin.platform import Platform
from twin.recording.environment import EARTH_RATE
from twin.rotation import conjugate, cross, rotate


@dataclass(frozen=True)
class EarthRotation(BodyEffect, ReadingEffect):
    """The room turns at W against inertial space: a gyro shows w + R^T W.

    In the room's axes the momentum J w + h of body and wheels then changes by -W x (J w + h)
    besides, and the body is turned by -w x J W + (J - J_wheels) (w x W). Terms in W squared, below
    1e-7 N m, and the wheels' own acceleration by w x W are left out.
    """

    name = "earth_rotation"
    domain = Domain.sensor
    observable = "the gyro shows a constant rate in the room's axes, whatever the attitude"
    streams = ("gyro", "attitude")
    reads = ("gyro",)
    exact = True

    rate: tuple[float, ...] = parameter(
        "of the room, in its axes",
        "rad/s",
        (4.7e-5, 0.0, 5.6e-5),
        source="the Earth at 50 deg of northern latitude, x to the north (WGS 84)",
        low=-EARTH_RATE,
        high=EARTH_RATE,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        if missing or platform.base.kind != "ball":
            return missing or "it needs a ball joint"
        return "rotors in gimbals are not modelled beside it" if platform.gimbals else ""

    def error(self, stream: str, position: Array, rate: Array) -> Array:
        del stream, rate
        return rotate(conjugate(position), self._room[:, None])

    def torque(self, platform: Platform) -> TorqueLaw:
        axes = np.array([wheel.axis for wheel in platform.wheels]).reshape(-1, 3)
        spin = np.array([wheel.inertia for wheel in platform.wheels])[:, None] * axes
        inertia = platform.inertia
        without_wheels = inertia - spin.T @ axes

        def law(state: State) -> Array:
            room = rotate(conjugate(state.position), self._room)
            momentum = state.rate @ inertia + state.wheel_speed @ spin
            carried = cross(room, momentum) + cross(state.rate, room @ inertia)
            return cross(state.rate, room) @ without_wheels - carried

        return law

    @property
    def _room(self) -> Array:
        # one for all runs of a batch, or one for each
        return np.reshape(self.rate, (-1, 3))
