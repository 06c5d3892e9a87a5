"""Write a control law, and hold it against a shipped one on the same flight."""

from dataclasses import dataclass, field

import numpy as np

import twin
from twin.controller.exchange import fixed_axes
from twin.controller.pointing import pointing_error


@dataclass(frozen=True)
class Saturated(twin.Controller[np.ndarray]):
    """Quaternion feedback whose answer to a large error is bounded.

    Fields are gains. Every array has the batch axis first: one law flies one run or a thousand.
    """

    proportional: float = field(default=5.0, metadata={"unit": "N m"})
    derivative: float = field(default=8.0, metadata={"unit": "N m s"})
    largest: float = field(default=0.05, metadata={"unit": "1"})
    """Of the error quaternion's vector part that is answered."""

    def init(self, platform, n):
        """What the law remembers: the share of each wheel in a torque on the body."""
        return -np.linalg.pinv(fixed_axes(platform, "saturated").T)

    def update(self, state, estimate, target, time):
        """Torque on each rotor [N m], and the state after it."""
        error, rate_error = pointing_error(estimate, target)
        vector = np.clip(error[:, 1:], -self.largest, self.largest)
        torque = -self.proportional * vector - self.derivative * rate_error
        wheels = np.einsum("ij,nj->ni", state, torque)
        return {"command_wheel_torque": wheels * estimate.valid[:, None]}, state


for law in ("quaternion_pd", Saturated(), Saturated(largest=0.02)):
    run = twin.fly("sads", law, reference="hold:0,0,40", duration=60.0)
    print(f"{law}: most momentum {np.max(run.metrics['wheel_momentum_max_N_m_s']):.2f} N m s")
    print(run)
