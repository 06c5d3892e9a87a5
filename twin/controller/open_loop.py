"""Open loop: a torque on the body over time, by wheels, gyros or thrusters, whatever it does."""

from dataclasses import dataclass

import numpy as np

from twin.controller.controller import Controller
from twin.controller.exchange import Gyros, Wheels
from twin.controller.thrusters import Nozzles
from twin.errors import ControllerError
from twin.manoeuvre import TorqueProfile
from twin.platform import Platform
from twin.rotation import cross
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class Allocation:
    """What gives the torque, and for how long a command is held."""

    part: Wheels | Gyros | Nozzles
    tick: float
    """[s]."""


@dataclass(frozen=True)
class OpenLoop(Controller[Allocation]):
    """A torque profile sent to the machine; neither attitude nor rate is fed back.

    Of each tick the mean torque tau over it is commanded, so that the profile's impulse is kept:

    wheels     T = -pinv(A) tau on the rotors, as `quaternion_pd` shares it
    gyros      dh/dt = -tau - w x h by the steering of `cmg_pd`, with w and angles as measured
    thrusters  F = arg min sum F_i, M F = tau, F >= 0, as `thruster_pd`, without its shortest pulse;
               beyond a thruster's limit all forces are scaled alike

    Limits of wheels and gimbals cut what is beyond them. Nothing is commanded until the estimate is
    valid: what the profile states before is lost.
    """

    profile: TorqueProfile
    """About the body axes."""
    actuators: str = ""
    """wheels, gyros or thrusters; "": the first of these that the machine has."""

    def init(self, platform: Platform, n: int) -> Allocation:
        """The actuators' shares.

        Raises:
            ControllerError: the machine has none that turn it about three axes.
        """
        if self.actuators == "wheels":
            return Allocation(Wheels.of(platform, "the torque profile"), platform.tick)
        if self.actuators == "gyros":
            return Allocation(Gyros.of(platform, "the torque profile"), platform.tick)
        if self.actuators == "thrusters":
            return Allocation(Nozzles.of(platform, "the torque profile"), platform.tick)
        for part in (Wheels, Gyros, Nozzles):
            try:
                return Allocation(part.of(platform, "the torque profile"), platform.tick)
            except ControllerError:
                continue
        raise ControllerError(
            f"a torque profile needs wheels, gyros or thrusters that turn the body about three "
            f"axes, and {platform.name} has none; choose another platform"
        )

    def update(
        self, state: Allocation, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Allocation]:
        """The mean torque until the next tick, as its actuators' commands."""
        n, part = len(estimate.valid), state.part
        torque = np.tile(self.profile.mean(time, time + state.tick), (n, 1))
        if isinstance(part, Wheels):
            return part.command(-torque, estimate, time), state
        if isinstance(part, Gyros):
            change = -torque - cross(estimate.rate_body, part.momentum(estimate))
            return part.command(change, estimate, time), state
        force = part.forces(torque)
        force = force / np.max(force / part.limit, axis=1, initial=1.0)[:, None]
        return {"command_thruster": np.where(estimate.valid[:, None], force, 0.0)}, state
