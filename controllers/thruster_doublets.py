"""Open-loop doublets of thrusters on a floor: along x, along y and about the vertical in turn."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.errors import ControllerError
from twin.platform import Platform
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]
PATTERN = (1, -1, -1, 1)
"""Of a doublet: it leaves neither velocity nor displacement where the pushes are alike."""


@dataclass(frozen=True)
class ThrusterDoublets(Controller[Array]):
    """Every axis is pushed forth, twice back and forth again, one axis after the other.

    A push along a body axis opens all thrusters that point that way; one about the vertical opens
    all that turn the body that way. Nothing is fed back: what the machine does then depends on its
    mass, inertia, mass moment and drag alone, and no sensor's noise enters the commands. The
    standard input of system identification: R. V. Jategaonkar, Flight Vehicle System
    Identification, AIAA 2006, section 2.3.
    """

    width: float = field(default=1.5, metadata={"unit": "s"})
    """Of each push."""

    def init(self, platform: Platform, n: int) -> Array:
        """(3, 2, thrusters) forces that push each axis forth and back [N].

        Raises:
            ControllerError: the machine is on no floor, or its thrusters do not push it both ways.
        """
        del n
        direction = np.array([t.direction for t in platform.thrusters]).reshape(-1, 3)
        point = np.array([t.point for t in platform.thrusters]).reshape(-1, 3)
        limit = np.array([t.force_limit for t in platform.thrusters])
        turn = np.cross(point, direction)[:, 2]
        arm = np.abs(turn).max(initial=0.0)
        along = np.stack([direction[:, 0], direction[:, 1], turn / (arm or 1.0)])
        forces = np.stack([np.where(sign * along > 0.5, limit, 0.0) for sign in (1.0, -1.0)], 1)
        if not platform.base.on_floor or not np.all(forces.any(axis=2)):
            raise ControllerError(
                "thruster_doublets pushes a machine that glides on a floor both ways along x and y "
                f"and about the vertical, which the {len(platform.thrusters)} thrusters of "
                f"{platform.name} do not; choose a platform whose thrusters do"
            )
        return forces

    def update(
        self, state: Array, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Array]:
        """The forces of the push that the time falls into."""
        del target
        push = int(time / self.width + 1e-9)
        axis, part = (push // len(PATTERN)) % 3, PATTERN[push % len(PATTERN)]
        force = state[axis, 0 if part > 0 else 1]
        return {"command_thruster": np.tile(force, (len(estimate.valid), 1))}, state
