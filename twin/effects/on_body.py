"""Effects on the machine itself: what is added to MuJoCo's model, and what only pushes on it.

An effect lives in MuJoCo where MuJoCo has the term (`edit_spec`, or `edit_model` for what an MjSpec
does not hold): exact at every stage of RK4, in one run or a thousand. A push is a force or torque
with axes of the room, on one body, constant or a function of time: exact as well, since MuJoCo
turns with the body. Only what is neither is a torque law, which Python evaluates.
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.effects.effect import Effect
from twin.platform import Platform, Thruster

Array = NDArray[np.float64]

CARRIER_MASS = 1e-9
"""[kg] of a body that is there to be pushed on; MuJoCo has none without mass."""
CARRIER_INERTIA = 1e-12
"""[kg m^2]."""
SHORT = 1e-5
"""Of a change of the rate, as a part of that: the mean over it is the middle, to 1e-11."""


@dataclass(frozen=True)
class Push:
    """Force [N] and torque [N m] on one body, room axes, at its centre of mass."""

    body: str
    wrench: Array | Callable[[Array], Array]
    """(6,), or from times (m,) [s] to (m, 6)."""


@dataclass(frozen=True)
class State:
    """Where a machine stands, in n runs."""

    position: Array
    """(n, 4) attitude of a ball joint, world from body, (n, 1) angle of a hinge [rad], or (n, 3)
    x, y and heading on a floor [m, m, rad]."""
    rate: Array
    """(n, 3) [rad/s], body axes, or (n, 1); on a floor (n, 3) of x, y and heading."""
    wheel_speed: Array
    """(n, wheels) relative to the body [rad/s]."""
    time: Array
    """(n,) [s]."""
    change: Array | None = None
    """(n, 3) or (n, 1) by which the rate changes over the step in whose middle this is, evenly: a
    torque is asked for as its mean over that step. None: for an instant."""


TorqueLaw = Callable[[State], Array]
"""From a state to the torque on the base joint, (n, 3) in body axes or (n, 1) [N m]."""


@dataclass(frozen=True)
class HingeSpring:
    """The torque law of a spring on a hinge, k (q0 - q), which MuJoCo's joint has as well."""

    stiffness: float
    """k [N m/rad]."""
    reference: float
    """q0 [rad]."""

    def __call__(self, state: State) -> Array:
        """(n, 1) [N m]."""
        return self.stiffness * (self.reference - state.position)


MomentLaw = Callable[[State], Array]
"""From a state to a part of m r, (n, 3) in body axes [kg m]."""


@dataclass(frozen=True)
class BodyEffect(Effect, abc.ABC):
    """Acts on the machine. Gives what it needs of the eight; each is nothing by default."""

    on_floor: ClassVar[bool] = False
    """Whether a machine that glides on a floor, its ball locked, is predicted with it. The torque
    law of one that needs a floor takes x, y and heading, their rates, and gives force along x and y
    and the torque about the vertical, (n, 3) [N, N m]."""

    def unfit(self, platform: Platform) -> str:
        """Of what acts on a body that turns in its bearing a machine on a floor has nothing."""
        missing = super().unfit(platform)
        if missing or self.on_floor or platform.base.kind != "planar":
            return missing
        return "it acts on a body that turns in a bearing"

    @property
    def follows_start(self) -> bool:
        """Whether the base joint's spring is at rest where a run starts."""
        return False

    @property
    def hangs_on(self) -> bool:
        """Whether it adds a part that moves by itself."""
        return False

    @property
    def changes_machine(self) -> bool:
        """Whether a machine can be another with it; else it only pushes, or is a torque."""
        edits = ("edit_spec", "edit_model", "edit_thruster")
        return any(getattr(type(self), name) is not getattr(BodyEffect, name) for name in edits)

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        """Change the model before it is compiled."""
        del spec, platform

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        """Change what only the compiled model holds."""
        del model, platform

    def edit_thruster(self, thruster: Thruster) -> Thruster:
        """Change a thruster whose force is a torque: on a bearing that stands."""
        return thruster

    def pushes(self, platform: Platform) -> tuple[Push, ...]:
        """Forces with axes of the room."""
        del platform
        return ()

    def torque(self, platform: Platform) -> TorqueLaw | None:
        """A torque on the base that depends on the state."""
        del platform
        return None

    def predicted_torque(self, platform: Platform) -> TorqueLaw | None:
        """What it changes in MuJoCo's model, as a torque on the base that answers to the state.

        A prediction takes other changes as forces along a motion that is known, which converges
        where they hardly change it: not with a spring over many periods.
        """
        del platform
        return None

    def mass_moment(self, platform: Platform) -> MomentLaw | None:
        """What a push or torque of it stands for as m r: it only tells the truth, and acts nowhere.

        What bodies in the model weigh, on slides and hinges too, is known without it.
        """
        del platform
        return None


@dataclass(frozen=True)
class CoupleEffect(BodyEffect, abc.ABC):
    """Two opposite forces with axes of the room, on points that are apart in the bus.

    A force F on one and -F on the other is the torque apart x R^T F, and nothing else.
    """

    @abc.abstractmethod
    def apart(self) -> Array:
        """(3,) from the point that is pushed back to the other, body axes [m]."""

    @abc.abstractmethod
    def pull(self, platform: Platform) -> Array | Callable[[Array], Array]:
        """(3,) force on the other, room axes [N]; or from times (m,) [s] to (m, 3)."""

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        for end, place in (("", self.apart()), ("/back", np.zeros(3))):
            where = anchor(spec, platform) + place
            body = spec.body(platform.base.body).add_body(name=self.label + end, pos=where)
            set_inertial(body, CARRIER_MASS, np.full(3, CARRIER_INERTIA))

    def pushes(self, platform: Platform) -> tuple[Push, ...]:
        pull = self.pull(platform)
        if not callable(pull):
            wrench = np.concatenate([pull, np.zeros(3)])
            return Push(self.label, wrench), Push(f"{self.label}/back", -wrench)

        def push(time: Array) -> Array:
            return np.pad(pull(time), ((0, 0), (0, 3)))

        return Push(self.label, push), Push(f"{self.label}/back", lambda time: -push(time))


def set_inertial(body: mujoco.MjsBody, mass: float, moments: Array) -> None:
    """Mass [kg] at the body's origin, principal moments [kg m^2] about its axes."""
    body.explicitinertial = True
    body.mass = mass
    body.ipos = np.zeros(3)
    body.inertia = moments


def anchor(spec: mujoco.MjSpec, platform: Platform) -> Array:
    """(3,) the CR in the frame of the bus [m]."""
    return np.array(spec.joint(platform.base.joint).pos)


def needs_floor(platform: Platform) -> str:
    """Why a platform that does not glide on a floor cannot have an effect."""
    if platform.base.on_floor:
        return ""
    return "it needs a machine of three degrees of freedom on a floor"


def glides(platform: Platform) -> str:
    """Why a platform whose stage does not glide along x and y cannot have an effect."""
    base = platform.base
    if base.kind == "planar" or set(base.planar[:2]) - set(base.locked):
        return ""
    return "it needs a machine that glides on a floor"


def needs_ball(platform: Platform) -> str:
    """Why a platform without a ball joint cannot have an effect."""
    return "" if platform.base.kind == "ball" else "it needs a ball joint"


def body_of_joint(model: mujoco.MjModel, joint: str) -> int:
    """The body that a joint moves."""
    return int(model.jnt_bodyid[model.joint(joint).id])


def mean_direction(rate: Array, change: Array, smoothing: float) -> Array:
    """(n, k) mean of w / sqrt(w^2 + w_s^2) over w = rate + s change, s from -1/2 to 1/2.

    Along the change the integrand is the derivative of a root, across it that of an inverse
    hyperbolic sine.
    """
    length = np.linalg.norm(change, axis=1, keepdims=True)
    along = change / np.where(length > 0.0, length, 1.0)
    middle = np.sum(rate * along, axis=1, keepdims=True)
    across = rate - middle * along
    closest = np.sqrt(np.sum(np.square(across), axis=1, keepdims=True) + smoothing**2)
    first, last = middle - 0.5 * length, middle + 0.5 * length
    roots = np.hypot(closest, first) + np.hypot(closest, last)
    # as the change goes to zero, the integrand in the middle
    short = length < SHORT * roots
    swept = np.arcsinh(last / closest) - np.arcsinh(first / closest)
    weight = np.where(short, 2.0 / roots, swept / np.where(short, 1.0, length))
    return along * (2.0 * middle / roots) + across * weight
