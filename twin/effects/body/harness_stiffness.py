"""A cable between the platform and the room."""

from dataclasses import dataclass, field, replace
from typing import Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_body import BodyEffect, HingeSpring, TorqueLaw
from twin.platform import Platform


@dataclass(frozen=True)
class HarnessStiffness(BodyEffect):
    """A cable pulls the body back to a reference attitude: torque -k phi, phi from there to here.

    MuJoCo's joint spring: exact at every stage of RK4. Its rest is set in the compiled model.
    """

    name = "harness_stiffness"
    domain = Domain.torque
    observable = "a torque towards one heading, which gravity never gives"
    streams = ("gyro", "attitude")
    reach = 2.0 * np.pi

    stiffness: float = parameter(
        "torque per angle",
        "N m/rad",
        1e-3,
        source="ASSUMED: a few thin wires; a loose cable has ten times as much",
        low=0.0,
        high=1e3,
    )
    reference: tuple[float, ...] | None = field(default=None)
    """Attitude of rest, world from body (w, x, y, z), or an angle [rad]; None: where it starts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reference is None:
            return
        rest = np.asarray(self.reference, dtype=np.float64).ravel()
        if len(rest) not in (1, 4) or (len(rest) == 4 and abs(np.linalg.norm(rest) - 1.0) > 1e-6):
            raise EffectError(
                f"{self.name}: reference is {self.reference!r}; give a unit quaternion "
                "w, x, y, z, or the angle of a hinge"
            )
        object.__setattr__(self, "reference", tuple(rest.tolist()))

    @property
    def follows_start(self) -> bool:
        return self.reference is None

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        numbers = 1 if platform.base.kind == "hinge" else 4
        if missing or self.reference is None or len(self.reference) == numbers:
            return missing
        return (
            f"its reference has {len(self.reference)} numbers; a {platform.base.kind} has {numbers}"
        )

    def variants(self, platform: Platform) -> tuple[Self, ...]:
        """At rest where a log begins; on a hinge with an encoder also at its zero: a spring that
        was let go swings about that."""
        zero = platform.base.kind == "hinge" and "joint_angle" in platform.sensors
        return (self, replace(self, reference=(0.0,))) if zero else (self,)

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        spec.joint(platform.base.joint).stiffness[0] += self.stiffness

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        if self.reference is not None:
            start = int(model.joint(platform.base.joint).qposadr[0])
            model.qpos_spring[start : start + len(self.reference)] = self.reference

    def predicted_torque(self, platform: Platform) -> TorqueLaw | None:
        if self.reference is None or platform.base.kind != "hinge":
            return None
        return HingeSpring(self.stiffness, self.reference[0])
