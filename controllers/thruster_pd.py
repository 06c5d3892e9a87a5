"""Hold or follow an attitude with cold-gas thrusters that are on or off, each pulse counted."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.pointing import pointing_error
from twin.controller.thrusters import Nozzles
from twin.platform import Platform
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Firing:
    """What the law remembers."""

    owed: Array
    """(n, 3) impulse of torque that was asked for and not given yet [N m s, body]."""
    nozzles: Nozzles
    tick: float
    """[s]."""


@dataclass(frozen=True)
class ThrusterPD(Controller[Firing]):
    """Quaternion feedback by thrusters.

    tau = -K_p q_e,vec - K_d w_e            torque on the body [N m, body]
    L   = tau T + L_owed                    impulse of the coming tick T [N m s]
    F   = arg min sum F_i, M F = L / T, F >= 0      forces with the least gas [N]

    - Beyond a thruster's limit all forces are scaled alike, so that the torque keeps its axis.
    - A valve opens for `pulse` at least, or not at all: a mean force over the tick below
      F_max pulse / T is not given, but owed, L_owed = L - T M F. So what a pulse is too coarse for
      is saved until it fills one, and the impulse given is that of the feedback within one pulse
      of every thruster that pushes: the error stays within what these pulses do to the loop
      J s^2 + K_d s + K_p / 2, whatever their pattern. What is beyond the limits is not owed.

    On a base that can slide the thrusters push in couples, without a net force but for what pulses
    are too coarse for.

    Source: S. Y. Choi, Automatic mass balancing system for the 5-DOF spacecraft simulator, Georgia
    Institute of Technology 2016, section 1.2, which has twelve thrusters and an allocation, and
    prints neither its equations nor the shortest pulse.
    """

    proportional: float = field(default=5.0, metadata={"unit": "N m"})
    """K_p, per unit of the error quaternion's vector part."""
    derivative: float = field(default=8.0, metadata={"unit": "N m s"})
    """K_d, per rate error."""
    pulse: float = field(default=0.01, metadata={"unit": "s"})
    """Shortest opening of a valve; usual for solenoid valves, no paper prints it. 0 for none."""

    def init(self, platform: Platform, n: int) -> Firing:
        """Nothing owed."""
        nozzles = Nozzles.of(platform, "thruster_pd")
        return Firing(np.zeros((n, 3)), nozzles, platform.tick)

    def update(
        self, state: Firing, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Firing]:
        """Mean force of each thruster over the tick; none in a run that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        torque = -self.proportional * error[:, 1:] - self.derivative * rate_error
        seen, limit = estimate.valid[:, None], state.nozzles.limit
        asked = torque + state.owed / state.tick
        force = state.nozzles.forces(asked)
        excess = np.max(force / limit, axis=1, initial=1.0)[:, None]
        force = force / excess
        force = np.where(force < limit * min(self.pulse / state.tick, 1.0), 0.0, force)
        owed = state.tick * (asked / excess - state.nozzles.torque(force))
        command = {"command_thruster": np.where(seen, force, 0.0)}
        return command, replace(state, owed=np.where(seen, owed, state.owed))
