"""Turn with the other machines of a run: their attitudes, received by radio, tracked by wheels."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from twin.controller import Controller
from twin.controller.exchange import WheeledBody
from twin.controller.pointing import mrp_of, pointing_error
from twin.platform import Platform
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class RelativeTracking(Controller[WheeledBody]):
    """Nonlinear tracking of a reference and of the other machines, in one sum.

    A g_a = h_b x w + g_g - J w x w_e - J R w_r' + k_1 w_e + k_2 s_e
            + sum_j (c_1 w_ij + c_2 s_ij)                             torque on the rotors [N m]

    w_e, s_e      error of the rate, and of the attitude in MRPs, from the reference
    w_ij, s_ij    likewise from machine j, as its newest message has it

    The other terms are those of `mrp_tracking`. This leaves

        J dw_e/dt = -k_1 w_e - k_2 s_e - sum_j (c_1 w_ij + c_2 s_ij)

    With k_1 = k_2 = 0 a machine follows those that it hears and nothing else: one that hears a
    leader or a station that stands still has, about each principal axis, the relative error of
    J s^2 + c_1 s + c_2 / 4. Two that hear each other without delay have that of
    M s^2 + c_1 s + c_2 / 4 with M = J_1 J_2 / (J_1 + J_2); their common momentum stays as it is.
    Late messages cost phase: two equal ones become unstable at the delay
    (2 / w) atan(4 c_1 w / c_2), w^2 = c_2 / (2 J).

    A message that is older than `oldest`, and a machine of which none has come, count for nothing:
    with the radio cut this is `mrp_tracking`. A machine can only follow within its stops.

    Source: the two terms are the station-keeping and the formation-keeping behaviour of M. C.
    VanDyke, Decentralized Coordinated Attitude Control of a Formation of Spacecraft, M.S. thesis,
    Virginia Tech, 2004, hdl.handle.net/10919/10015, written for the laboratory of AAS 04-122; the
    gyrostat's terms are that paper's eq. 26. The gains are those of `mrp_tracking`.
    """

    reference: ClassVar[str] = "hold"

    rate_gain: float = field(default=8.0, metadata={"unit": "N m s"})
    """k_1, per rate error from the reference."""
    attitude_gain: float = field(default=10.0, metadata={"unit": "N m"})
    """k_2, per MRP of the error from the reference, which is a quarter of a small angle."""
    relative_rate_gain: float = field(default=8.0, metadata={"unit": "N m s"})
    """c_1, per rate relative to each machine that is heard."""
    relative_attitude_gain: float = field(default=10.0, metadata={"unit": "N m"})
    """c_2, per MRP of the attitude relative to each machine that is heard."""
    oldest: float = field(default=10.0, metadata={"unit": "s"})
    """Age beyond which a message is not followed: by then a body at 1 deg/s is 10 deg off."""

    def init(self, platform: Platform, n: int) -> WheeledBody:
        """What the platform states of the body."""
        return WheeledBody.of(platform, "relative_tracking")

    def update(
        self, state: WheeledBody, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, WheeledBody]:
        """Torque on each rotor; none in a run that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        change = state.tracking_torque(estimate, error, rate_error, target)
        change = change + self.rate_gain * rate_error + self.attitude_gain * mrp_of(error)
        for other in estimate.received.values():
            fresh = other.valid & (time - other.time <= self.oldest)
            there = replace(target, attitude=other.attitude, rate_body=other.rate_body)
            turned, turning = pointing_error(estimate, there)
            pull = self.relative_rate_gain * turning + self.relative_attitude_gain * mrp_of(turned)
            change = change + np.where(fresh[:, None], pull, 0.0)
        return state.wheels.command(change, estimate, time), state
