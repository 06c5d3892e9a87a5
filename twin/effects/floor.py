"""Effects of the floor and of the pads of a machine that glides on it."""

from dataclasses import dataclass, field

import mujoco
import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_body import (
    Array,
    BodyEffect,
    State,
    TorqueLaw,
    glides,
    mean_direction,
    needs_floor,
)
from twin.platform import Platform


@dataclass(frozen=True)
class FloorSlope(BodyEffect):
    """The floor falls along the room's x and y: acceleration g slope, at the centre of mass.

    A part of MuJoCo's gravity: exact at every stage of RK4. A ball may turn on what glides: the
    room's z is then across the floor.
    """

    name = "floor_slope"
    domain = Domain.torque
    observable = "a machine that nothing pushes gains speed, always towards the same wall"
    streams = ("position",)
    on_floor = True

    down_x: float = parameter(
        "fall of the floor along x",
        "rad",
        2e-4,
        source="ASSUMED: 0.2 mm/m, a levelled table",
        low=-0.1,
        high=0.1,
    )
    down_y: float = parameter(
        "and along y",
        "rad",
        -1e-4,
        source="ASSUMED: likewise",
        low=-0.1,
        high=0.1,
    )

    def unfit(self, platform: Platform) -> str:
        return super().unfit(platform) or glides(platform)

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        model.opt.gravity[0] += platform.gravity * self.down_x
        model.opt.gravity[1] += platform.gravity * self.down_y


@dataclass(frozen=True)
class PadCoulombFriction(BodyEffect):
    """Pads brake at every speed alike: force -F v / sqrt(v^2 + v_s^2), torque likewise of the rate.

    Evaluated once a physics step. A change of sign that takes less than a step is missed; along a
    path that is known the force is its mean over each step.
    """

    name = "pad_coulomb_friction"
    domain = Domain.torque
    observable = "velocity and rate fall linearly, and the machine stops"
    streams = ("position",)
    on_floor = True

    force: float = parameter(
        "force",
        "N",
        0.02,
        source="ASSUMED: a coefficient of 1e-4 under 20 kg",
        low=0.0,
        high=100.0,
    )
    torque_size: float = parameter(
        "torque about the vertical",
        "N m",
        0.004,
        source="ASSUMED: the same at 0.2 m from the middle",
        low=0.0,
        high=100.0,
    )
    slow: float = field(default=1e-3)
    """Speed below which it fades [m/s]."""
    slow_turn: float = field(default=5e-3)
    """Likewise the rate [rad/s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (0.0 < self.slow < np.inf and 0.0 < self.slow_turn < np.inf):
            raise EffectError(
                f"{self.name}: slow is {self.slow!r} m/s and slow_turn {self.slow_turn!r} rad/s; "
                "both must lie above 0"
            )

    def unfit(self, platform: Platform) -> str:
        return super().unfit(platform) or needs_floor(platform)

    def torque(self, platform: Platform) -> TorqueLaw:
        return self._law

    def _law(self, state: State) -> Array:
        velocity, rate = state.rate[:, :2], state.rate[:, 2:]
        if state.change is None:
            speed = np.sqrt(np.sum(np.square(velocity), axis=1, keepdims=True) + self.slow**2)
            along, about = velocity / speed, rate / np.hypot(rate, self.slow_turn)
        else:
            along = mean_direction(velocity, state.change[:, :2], self.slow)
            about = mean_direction(rate, state.change[:, 2:], self.slow_turn)
        return -np.concatenate([self.force * along, self.torque_size * about], axis=1)


@dataclass(frozen=True)
class PadViscousFriction(BodyEffect):
    """Pads brake in proportion to velocity and rate: force -c v, torque -d w.

    Beyond what the MJCF states of its joints; below zero where it states more than there is.
    MuJoCo's joint damping: exact at every stage of RK4.
    """

    name = "pad_viscous_friction"
    domain = Domain.torque
    observable = "velocity and rate decay exponentially, in whatever direction it glides"
    streams = ("position",)
    on_floor = True

    damping: float = parameter(
        "force per velocity",
        "N s/m",
        0.1,
        source="ASSUMED: air of 10 um below three pads of 0.1 m",
        low=-100.0,
        high=100.0,
    )
    turning: float = parameter(
        "torque per rate",
        "N m s",
        0.005,
        source="ASSUMED: the same at 0.2 m from the middle",
        low=-100.0,
        high=100.0,
    )

    def unfit(self, platform: Platform) -> str:
        return super().unfit(platform) or needs_floor(platform)

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        for name in platform.base.planar[:2]:
            spec.joint(name).damping[0] += self.damping
        spec.joint(platform.base.joint).damping[0] += self.turning
