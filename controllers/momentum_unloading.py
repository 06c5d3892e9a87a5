"""Hold an attitude with wheels or gyros, and take their momentum off by coils or masses."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.coils import Coils
from twin.controller.exchange import Exchange, exchange_of
from twin.controller.masses import Masses
from twin.controller.pointing import pointing_error
from twin.platform import Platform
from twin.rotation import cross, vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unloading:
    """What the law remembers."""

    position: Array
    """Integral part of each stage's position, (n, stages) [m]: where it balances the body."""
    seen: NDArray[np.bool_]
    """(n,) runs that were seen before: their integral has begun where the stages stood."""
    exchange: Exchange
    by: Coils | Masses
    tick: float
    """[s]."""


@dataclass(frozen=True)
class MomentumUnloading(Controller[Unloading]):
    """Quaternion feedback by wheels or gyros, emptied by magnetorquers, or else by masses.

    tau     = -K_p q_e,vec - K_d w_e = -dh/dt - w x h    torque on the body [N m, body]
    d       = -k B x h / |B|^2                           dipole [A m^2, body], B in the body
    m_j d_j = (g^ x tau_sm)_j / |g|                      or position of stage j [m], for
    tau_sm  = -k h - k_I int h dt                        a torque by the masses [N m, body]

    While the attitude holds, what turns the body from outside changes h alone.

    - Coils, the cross-product law: d x B = -k (h - (h . b) b), b = B / |B|. Across the field h
      decays as exp(-k t), down to m r x g / k; along it, it stays until body or field turn.
    - Masses, where there are no coils: across the vertical h'' + k h' + k_I h = 0, stable for any
      positive k and k_I that are slow beside the attitude loop, critically damped at k_I = k^2 / 4.
      The integral, a position of each stage as in `mass_pid`, ends where the CM is under the CR.
      No mass gives a torque about the vertical: along it h stays.

    Source: none of the papers of docs/design.md unloads wheels. The torque of the masses is that of
    S. Y. Choi, Automatic mass balancing system for the 5-DOF spacecraft simulator, Georgia
    Institute of Technology 2016, eq. 18 and 19; the law for coils is that of spacecraft, as in
    J. R. Wertz (ed.), Spacecraft attitude determination and control, 1978; the attitude law is
    `quaternion_pd`. A table of 0.02 kg m^2 needs K_p and K_d smaller in proportion.
    """

    proportional: float = field(default=5.0, metadata={"unit": "N m"})
    """K_p, per unit of the error quaternion's vector part."""
    derivative: float = field(default=8.0, metadata={"unit": "N m s"})
    """K_d, per rate error."""
    unloading: float = field(default=0.05, metadata={"unit": "1/s"})
    """k."""
    integral: float = field(default=6e-4, metadata={"unit": "1/s^2"})
    """k_I, of the masses."""

    def init(self, platform: Platform, n: int) -> Unloading:
        """No run seen yet."""
        name = "momentum_unloading"
        unload = Coils if platform.magnetorquers else Masses
        return Unloading(
            position=np.zeros((n, len(platform.stages))),
            seen=np.zeros(n, dtype=np.bool_),
            exchange=exchange_of(platform, name),
            by=unload.of(platform, name),
            tick=platform.tick,
        )

    def update(
        self, state: Unloading, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Unloading]:
        """Torques or gimbal rates, and a dipole or stage positions; in a run that was not seen yet
        none, and stages where they are."""
        error, rate_error = pointing_error(estimate, target)
        torque = -self.proportional * error[:, 1:] - self.derivative * rate_error
        held = state.exchange.momentum(estimate)
        change = -torque - cross(estimate.rate_body, held)
        command = state.exchange.command(change, estimate, time)
        wanted, seen = -self.unloading * held, estimate.valid[:, None]
        if isinstance(state.by, Coils):
            dipole = state.by.dipole(estimate.attitude, wanted)
            return command | {"command_dipole": np.where(seen, dipole, 0.0)}, state

        up = vertical_body(estimate.attitude)
        direct = state.by.leaning(wanted, up)
        step = state.by.leaning(-self.integral * state.tick * held, up)
        before = np.where(state.seen[:, None], state.position, estimate.stage_position)
        position, stages = state.by.integrated(before, step, direct)
        command["command_stage_position"] = np.where(seen, stages, before)
        begun = state.seen | estimate.valid
        return command, replace(state, position=np.where(seen, position, before), seen=begun)
