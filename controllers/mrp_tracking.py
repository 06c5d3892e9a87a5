"""Track an attitude exactly with reaction wheels: modified Rodrigues parameters, fed forward."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.exchange import Wheels
from twin.controller.pointing import pointing_error
from twin.platform import Platform
from twin.rotation import conjugate, cross, rotate, vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gyrostat:
    """The machine as the law knows it."""

    wheels: Wheels
    moment: Array
    """(3,) m r at stage position 0 [kg m, body]."""
    slides: Array
    """(stages, 3) what a stage adds to it per position [kg]."""
    gravity: float
    """[m/s^2]."""


@dataclass(frozen=True)
class MrpTracking(Controller[Gyrostat]):
    """Nonlinear tracking by wheels, for any reference motion.

    A g_a = h_b x w + g_g - J w x w_e - J R w_r' + k_1 w_e + k_2 s_e      torque on the rotors [N m]

    h_b = J w + A h_a     the whole momentum, J without the wheels about their axes
    g_g = m r x g         torque of gravity, with m r as the platform states it and at these stages
    w_e = w - R w_r       error of the rate, R from the target's body frame to the body's
    w_r'                  acceleration of the target, in its own frame
    s_e = q_e,vec / (1 + q_e0)      error in MRPs, with q_e0 >= 0: |s_e| <= 1, never singular

    This leaves J dw_e/dt = -k_1 w_e - k_2 s_e, and

        V = w_e^T J w_e / 2 + 2 k_2 ln(1 + |s_e|^2),   dV/dt = -k_1 |w_e|^2 <= 0:

    the error vanishes for any positive k_1 and k_2, as long as the wheels have torque and momentum
    left. Small errors have the stiffness k_2 / 4 [N m/rad].

    Source: J. L. Schwartz, C. D. Hall, System identification of a spherical air-bearing spacecraft
    simulator, AAS 04-122, eq. 26, after C. D. Hall, P. Tsiotras, H. Shen, J. Astronautical Sciences
    50(3), 2002. Their reference is a rigid body under gravity, w_r' = I_r^-1 (h_r x w_r + g_r);
    ours is any. k_1 and k_2 are not printed: these have the stiffness and damping of
    `quaternion_pd`. Where m r is wrong by d, the body stands off by 4 |d x g| / k_2.
    """

    reference: ClassVar[str] = "multisine"

    rate_gain: float = field(default=8.0, metadata={"unit": "N m s"})
    """k_1, per rate error."""
    attitude_gain: float = field(default=10.0, metadata={"unit": "N m"})
    """k_2, per MRP of the error, which is a quarter of a small angle."""

    def init(self, platform: Platform, n: int) -> Gyrostat:
        """What the platform states of the body."""
        slides = np.array([stage.mass * stage.axis for stage in platform.stages]).reshape(-1, 3)
        return Gyrostat(
            wheels=Wheels.of(platform, "mrp_tracking"),
            moment=platform.center_of_mass_offset,
            slides=slides,
            gravity=platform.gravity,
        )

    def update(
        self, state: Gyrostat, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Gyrostat]:
        """Torque on each rotor; none in a run that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        mrp = error[:, 1:] / (1.0 + error[:, :1])
        acceleration = rotate(conjugate(error), target.acceleration_body)
        rate, inertia = estimate.rate_body, state.wheels.inertia

        moment = state.moment + np.einsum("nj,ji->ni", estimate.stage_position, state.slides)
        gravity = cross(moment, -state.gravity * vertical_body(estimate.attitude))
        whole = np.einsum("ij,nj->ni", inertia, rate) + state.wheels.momentum(estimate)
        wanted = np.einsum("ij,nj->ni", inertia, cross(rate, rate_error) + acceleration)
        change = cross(whole, rate) + gravity - wanted
        change = change + self.rate_gain * rate_error + self.attitude_gain * mrp
        return state.wheels.command(change, estimate, time), state
