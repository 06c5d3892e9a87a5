"""A panel or antenna that swings on the platform."""

from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_body import CARRIER_INERTIA, CARRIER_MASS, BodyEffect, anchor, set_inertial
from twin.platform import Platform

_STEPS = 20
"""Of a period, that RK4 needs to follow it."""
_CLAMPED = (1.0, 0.985)
"""Clamped frequencies tried for one that a free body shows, in parts of it: of a part far smaller
than the body, and of one of 3 % of its inertia."""
_BROAD = 0.05
"""Damping ratio with which it is sought all over a spectrum."""
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""About which it is sought."""


@dataclass(frozen=True)
class FlexibleAppendage(BodyEffect):
    """A sprung hinge carries part of the inertia: one mode of a panel or an antenna.

    A body on a hinge at the CR, k = I (2 pi f)^2, c = 2 zeta I 2 pi f; the whole keeps the inertia
    that is stated. Free, it rings faster than clamped, by 1 / sqrt(1 - I / J).

    No log shows the length of the axis: a fit leaves one of its components, the largest, as it is.
    """

    name = "flexible_appendage"
    domain = Domain.exchange
    observable = "the rate rings at one frequency after every change of torque"
    streams = ("gyro",)

    frequency: float = parameter(
        "with the bus held fast",
        "Hz",
        2.0,
        source="ASSUMED: a panel half a metre long",
        low=1e-3,
        high=1e3,
        amplitude=False,
    )
    damping_ratio: float = parameter(
        "of the critical damping",
        "1",
        0.01,
        source="ASSUMED: usual for bolted metal",
        low=0.0,
        high=1.0,
        amplitude=False,
    )
    inertia: float = parameter(
        "that swings, about the hinge's axis",
        "kg m^2",
        0.05,
        source="ASSUMED: 0.3 kg at 0.4 m",
        low=0.0,
        high=1e4,
    )
    axis: tuple[float, ...] = parameter(
        "of the hinge, body axes; its length does not count",
        "1",
        (0.0, 0.0, 1.0),
        source="any",
        low=-1.0,
        high=1.0,
        amplitude=False,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.any(self.axis):
            raise EffectError(f"{self.name}: axis is {self.axis}; give a direction")

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """About each body axis, a little slower too: with the bus held fast it is."""
        held = [share * hertz for share in _CLAMPED]
        return tuple(replace(self, frequency=item, axis=axis) for item in held for axis in _AXES)

    def resonating(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """About each body axis."""
        del gravity
        broad = replace(self, frequency=hertz, damping_ratio=_BROAD)
        return tuple(replace(broad, axis=axis) for axis in _AXES)

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        longest = 1.0 / (_STEPS * self.frequency)
        if missing or platform.step <= longest:
            return missing
        return (
            f"a step of {platform.step:g} s cannot follow {self.frequency:g} Hz; "
            f"set simulation.step to {longest:.2g} s or less"
        )

    @property
    def hangs_on(self) -> bool:
        return True

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        inertia = self.inertia + CARRIER_INERTIA
        turn = 2.0 * np.pi * self.frequency
        body = spec.body(platform.base.body).add_body(name=self.label, pos=anchor(spec, platform))
        quat = np.zeros(4)
        mujoco.mju_quatZ2Vec(quat, axis)
        body.quat = quat
        # half as much across: the least that a body may have
        set_inertial(body, CARRIER_MASS, inertia * np.array([0.5, 0.5, 1.0]))
        hinge = body.add_joint(
            name=self.label, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0]
        )
        hinge.stiffness[0] = inertia * turn**2
        hinge.damping[0] = 2.0 * self.damping_ratio * inertia * turn
