"""Effects on the body: its bearing, its surroundings, what hangs on it and what moves in it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_body import (
    CARRIER_INERTIA,
    CARRIER_MASS,
    Array,
    BodyEffect,
    CoupleEffect,
    HingeSpring,
    MomentLaw,
    Push,
    State,
    TorqueLaw,
    anchor,
    mean_direction,
    needs_ball,
    set_inertial,
)
from twin.platform import Platform
from twin.rotation import vertical_body

VARIANTS = ("axes", "norm")


@dataclass(frozen=True)
class AerodynamicDrag(BodyEffect):
    """The air brakes with the square of the rate: torque -b |w_i| w_i about each axis.

    MuJoCo's joint damping is a polynomial and has the term: exact at every stage of RK4. The
    variant `norm`, torque -b |w| w, is a law that Python evaluates once a physics step.
    """

    name = "aerodynamic_drag"
    domain = Domain.torque
    observable = "the rate decays hyperbolically, fast rates much faster than slow ones"
    streams = ("gyro",)

    drag: float = parameter(
        "torque per squared rate",
        "N m s^2",
        5e-3,
        source="1/2 rho C_d A r^3 of 0.05 m^2 at 0.5 m from the axis, C_d = 1.2",
        low=0.0,
        high=100.0,
    )
    variant: Literal["axes", "norm"] = field(default="axes")
    """Squared axis by axis, or with the norm of the rate."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.variant not in VARIANTS:
            raise EffectError(
                f"{self.name}: variant is {self.variant!r}; use one of 'axes', 'norm'"
            )

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        if self.variant == "axes":
            spec.joint(platform.base.joint).damping[1] += self.drag

    def torque(self, platform: Platform) -> TorqueLaw | None:
        return self._by_norm if self.variant == "norm" else None

    def _by_norm(self, state: State) -> Array:
        size = np.sqrt(np.einsum("ni,ni->n", state.rate, state.rate))
        return -self.drag * size[:, None] * state.rate


@dataclass(frozen=True)
class BearingCoulombFriction(BodyEffect):
    """The bearing brakes at every rate alike: torque -c w / sqrt(w^2 + w_s^2).

    MuJoCo's friction loss holds every axis for itself; this one opposes the rate as a whole, so
    Python evaluates it once a physics step. A sign change that takes less than a step is missed;
    along a path that is known the torque is its mean over each step, which answers to a change of
    the path as dry friction does.
    """

    name = "bearing_coulomb_friction"
    domain = Domain.torque
    observable = "the rate falls linearly and stops; small swings die first"
    streams = ("gyro",)

    torque_size: float = parameter(
        "torque",
        "N m",
        1e-4,
        source="ASSUMED: as much as 95 kg whose CM stands 0.1 um off",
        low=0.0,
        high=10.0,
    )
    smoothing: float = field(default=1e-4)
    """Rate below which it fades [rad/s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.smoothing < np.inf:
            raise EffectError(
                f"{self.name}: smoothing is {self.smoothing!r} rad/s; it must lie above 0"
            )

    def torque(self, platform: Platform) -> TorqueLaw:
        return self._law

    def _law(self, state: State) -> Array:
        if state.change is None:
            squared = np.einsum("ni,ni->n", state.rate, state.rate)
            size = np.sqrt(squared + self.smoothing**2)
            return -self.torque_size * state.rate / size[:, None]
        return -self.torque_size * mean_direction(state.rate, state.change, self.smoothing)


@dataclass(frozen=True)
class BearingSwirlTorque(BodyEffect):
    """The bearing's air turns the body about the vertical: torque R^T (0, 0, k).

    A torque with the room's axes on the bus: exact at every stage of RK4.
    """

    name = "bearing_swirl_torque"
    domain = Domain.torque
    observable = "momentum about the vertical grows steadily, whatever the attitude"
    streams = ("gyro", "attitude")

    strength: float = parameter(
        "torque about the vertical",
        "N m",
        2e-5,
        source="ASSUMED: turns 12 kg m^2 by 1 deg in 2.4 min",
        low=-10.0,
        high=10.0,
    )

    def pushes(self, platform: Platform) -> tuple[Push, ...]:
        wrench = np.array([0.0, 0.0, 0.0, 0.0, 0.0, self.strength])
        return (Push(platform.base.body, wrench),)


@dataclass(frozen=True)
class BearingViscousFriction(BodyEffect):
    """The bearing brakes in proportion to the rate: torque -c w.

    MuJoCo's joint damping: exact at every stage of RK4.
    """

    name = "bearing_viscous_friction"
    domain = Domain.torque
    observable = "the rate decays exponentially, about every axis alike"
    streams = ("gyro",)

    damping: float = parameter(
        "torque per rate",
        "N m s",
        1e-3,
        source="ASSUMED: 12 kg m^2 slow down to 1/e in 3.3 h",
        low=0.0,
        high=10.0,
    )

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        spec.joint(platform.base.joint).damping[0] += self.damping


_REACH = 1e5
"""Seconds of drift by which the couple stands apart; only their product acts."""


@dataclass(frozen=True)
class CenterOfMassDrift(CoupleEffect):
    """The mass moment moves steadily: m r += rate t, in the gravity torque.

    A couple of vertical forces that grow with time, held over each physics step at its middle. The
    inertia stays: what moves weighs grams.
    """

    name = "center_of_mass_drift"
    domain = Domain.torque
    observable = "a gravity torque that grows with time"
    streams = ("gyro", "attitude")

    rate: tuple[float, ...] = parameter(
        "change of m r per second, body axes",
        "kg m/s",
        (8e-7, -4e-7, 2e-7),
        source="ASSUMED: 0.1 g of gas a minute from a tank 0.5 m off",
        low=-1.0,
        high=1.0,
    )

    def apart(self) -> Array:
        return _REACH * np.array(self.rate)

    def pull(self, platform: Platform) -> Callable[[Array], Array]:
        per_second = np.array([0.0, 0.0, -platform.gravity / _REACH])
        return lambda time: time[:, None] * per_second

    def mass_moment(self, platform: Platform) -> MomentLaw:
        rate = np.array(self.rate)
        return lambda state: state.time[:, None] * rate


_STEPS = 20
"""Of a period, that RK4 needs to follow it."""
_CLAMPED = (1.0, 0.985)
"""Clamped frequencies tried for one that a free body shows, in parts of it: of a part far smaller
than the body, and of one of 3 % of its inertia."""
_BROAD = 0.05
"""Damping ratio with which it is sought all over a spectrum: what rings longer is out of step with
what rings but a hundredth faster, and a line is not known so well."""
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""About which it is sought."""


@dataclass(frozen=True)
class FlexibleAppendage(BodyEffect):
    """A sprung hinge carries part of the inertia: one mode of a panel or an antenna.

    A body on a hinge at the CR, k = I (2 pi f)^2, c = 2 zeta I 2 pi f; the whole keeps the inertia
    that is stated. Free, it rings faster than clamped, by 1 / sqrt(1 - I / J).

    No log shows the length of the axis: a fit leaves one of its components, the largest, as it is.
    """

    name = "flexible_appendage"
    domain = Domain.exchange
    observable = "the rate rings at one frequency after every change of torque"
    streams = ("gyro",)

    frequency: float = parameter(
        "with the bus held fast",
        "Hz",
        2.0,
        source="ASSUMED: a panel half a metre long",
        low=1e-3,
        high=1e3,
        amplitude=False,
    )
    damping_ratio: float = parameter(
        "of the critical damping",
        "1",
        0.01,
        source="ASSUMED: usual for bolted metal",
        low=0.0,
        high=1.0,
        amplitude=False,
    )
    inertia: float = parameter(
        "that swings, about the hinge's axis",
        "kg m^2",
        0.05,
        source="ASSUMED: 0.3 kg at 0.4 m",
        low=0.0,
        high=1e4,
    )
    axis: tuple[float, ...] = parameter(
        "of the hinge, body axes; its length does not count",
        "1",
        (0.0, 0.0, 1.0),
        source="any",
        low=-1.0,
        high=1.0,
        amplitude=False,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.any(self.axis):
            raise EffectError(f"{self.name}: axis is {self.axis}; give a direction")

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """About each body axis, a little slower too: with the bus held fast it is."""
        held = [share * hertz for share in _CLAMPED]
        return tuple(replace(self, frequency=item, axis=axis) for item in held for axis in _AXES)

    def resonating(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """About each body axis."""
        del gravity
        broad = replace(self, frequency=hertz, damping_ratio=_BROAD)
        return tuple(replace(broad, axis=axis) for axis in _AXES)

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        longest = 1.0 / (_STEPS * self.frequency)
        if missing or platform.step <= longest:
            return missing
        return (
            f"a step of {platform.step:g} s cannot follow {self.frequency:g} Hz; "
            f"set simulation.step to {longest:.2g} s or less"
        )

    @property
    def hangs_on(self) -> bool:
        return True

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        inertia = self.inertia + CARRIER_INERTIA
        turn = 2.0 * np.pi * self.frequency
        body = spec.body(platform.base.body).add_body(name=self.label, pos=anchor(spec, platform))
        quat = np.zeros(4)
        mujoco.mju_quatZ2Vec(quat, axis)
        body.quat = quat
        # half as much across: the least that a body may have
        set_inertial(body, CARRIER_MASS, inertia * np.array([0.5, 0.5, 1.0]))
        hinge = body.add_joint(
            name=self.label, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0]
        )
        hinge.stiffness[0] = inertia * turn**2
        hinge.damping[0] = 2.0 * self.damping_ratio * inertia * turn


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


_ARM = 0.4
"""Distance from the CR at which its pivot is sought [m]: nearer to it, a turn of the body hardly
makes it ring, and what it does besides is what another base does."""


@dataclass(frozen=True)
class LiquidSlosh(BodyEffect):
    """Part of the mass swings like a pendulum: the first mode of a liquid.

    A point mass on two crossed hinges, each with its damping. At rest in the body it hangs along
    the body's z axis; there the whole has the mass properties that are stated.

    A body that turns slowly shows m l alone, which takes m l g off its pendulum's stiffness, as a
    structural sag of m l / g does: it capsizes where its m r is less. Mass, length, damping and
    pivot show each for itself only where torques that change at once make the liquid ring.
    """

    name = "liquid_slosh"
    domain = Domain.exchange
    observable = "after a turn the rate rings slowly, at sqrt(g / l) / 2 pi"
    streams = ("gyro", "attitude")

    mass: float = parameter(
        "that swings",
        "kg",
        0.2,
        source="ASSUMED: a third of a filled half-litre tank",
        low=0.0,
        high=1e4,
    )
    length: float = parameter(
        "of the pendulum",
        "m",
        0.05,
        source="ASSUMED: a tank 10 cm wide",
        low=1e-3,
        high=2.0,
        amplitude=False,
    )
    damping_ratio: float = parameter(
        "of the critical damping of small swings",
        "1",
        0.01,
        source="ASSUMED: water in a smooth tank",
        low=0.0,
        high=1.0,
        amplitude=False,
    )
    pivot: tuple[float, ...] = parameter(
        "where it hangs, from the CR, body axes",
        "m",
        (0.1, 0.0, -0.1),
        source="ASSUMED: a tank beside the bearing",
        low=-10.0,
        high=10.0,
        amplitude=False,
    )

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """A pendulum of that frequency, hung beside the CR, below and above it."""
        length = gravity / (2.0 * np.pi * hertz) ** 2
        places = [(_ARM, 0.0, 0.0), (0.0, _ARM, 0.0), (0.0, 0.0, -_ARM), (0.0, 0.0, _ARM)]
        return tuple(
            replace(self, length=length, damping_ratio=_BROAD, pivot=place) for place in places
        )

    def resonating(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """Likewise: it is broad already."""
        return self.at_frequency(hertz, gravity)

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform) or needs_ball(platform)
        if missing:
            return missing
        if platform.gravity <= 0.0:
            return "without weight nothing brings a liquid back to its place"
        longest = 2.0 * np.pi * np.sqrt(self.length / platform.gravity) / _STEPS
        if platform.step <= longest:
            return ""
        return (
            f"a step of {platform.step:g} s cannot follow a pendulum of {self.length:g} m; "
            f"set simulation.step to {longest:.2g} s or less"
        )

    @property
    def hangs_on(self) -> bool:
        return True

    def edit_spec(self, spec: mujoco.MjSpec, platform: Platform) -> None:
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        mass = self.mass + CARRIER_MASS
        turn = np.sqrt(platform.gravity / self.length)
        damping = 2.0 * self.damping_ratio * mass * self.length**2 * turn
        place = anchor(spec, platform) + np.array(self.pivot)
        outer = spec.body(platform.base.body).add_body(name=f"{self.label}/x", pos=place)
        set_inertial(outer, CARRIER_MASS, np.full(3, CARRIER_INERTIA))
        swing = outer.add_joint(name=f"{self.label}/x", type=hinge, axis=[1.0, 0.0, 0.0])
        swing.damping[0] = damping
        inner = outer.add_body(name=self.label)
        set_inertial(inner, mass, np.full(3, CARRIER_INERTIA))
        inner.ipos = [0.0, 0.0, -self.length]
        swing = inner.add_joint(name=f"{self.label}/y", type=hinge, axis=[0.0, 1.0, 0.0])
        swing.damping[0] = damping


@dataclass(frozen=True)
class ResidualDipole(CoupleEffect):
    """A magnetic moment fixed in the body turns into the room's field: torque m x R^T B.

    A couple of forces along B, 1 A m apart by m: exact at every stage of RK4.
    """

    name = "residual_dipole"
    domain = Domain.torque
    observable = "a torque like that of a mass moment, but about the field instead of the vertical"
    streams = ("gyro", "attitude")

    moment: tuple[float, ...] = parameter(
        "magnetic moment, body axes",
        "A m^2",
        (0.05, -0.02, 0.03),
        source="ASSUMED: a few hundredths, as a table with motors and batteries has",
        low=-100.0,
        high=100.0,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        if missing or np.any(platform.magnetic_field):
            return missing
        return "its environment has no magnetic field (environment.magnetic_field)"

    def apart(self) -> Array:
        return np.array(self.moment)

    def pull(self, platform: Platform) -> Array:
        return platform.magnetic_field


@dataclass(frozen=True)
class RoomDraft(CoupleEffect):
    """A push fixed in the room that comes and goes: torque p x R^T F sin(2 pi f t + phase).

    A couple of forces, held over each physics step at its middle. A steady draft is the twin of a
    residual dipole.

    No log tells a strong force on a short arm from a weak one on a long arm: a fit leaves one
    component of the point, the largest, as it is.
    """

    name = "room_draft"
    domain = Domain.torque
    observable = "a torque with one line in its spectrum that no command explains"
    streams = ("gyro", "attitude")

    point: tuple[float, ...] = parameter(
        "where it acts, from the CR, body axes",
        "m",
        (0.1, 0.0, 0.3),
        source="ASSUMED: where the platform is widest",
        low=-10.0,
        high=10.0,
        amplitude=False,
    )
    force: tuple[float, ...] = parameter(
        "amplitude, room axes",
        "N",
        (6e-4, 2e-4, 0.0),
        source="1/2 rho v^2 A of 0.1 m/s on 0.1 m^2; at most 0.5 m/s on 0.7 m^2",
        low=-0.1,
        high=0.1,
    )
    frequency: float = parameter(
        "of the sinusoid",
        "Hz",
        0.05,
        source="ASSUMED: a fan that swings in 20 s; air does not push to and fro twice a second",
        low=1e-4,
        high=2.0,
        amplitude=False,
    )
    phase: float = parameter(
        "of the sinusoid at time 0",
        "rad",
        0.5,
        source="any",
        low=-2.0 * np.pi,
        high=2.0 * np.pi,
        amplitude=False,
    )

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """At four phases, where it is thought to act and where those axes are other ones: no force
        turns a body about the line to its point."""
        phases = np.linspace(0.0, np.pi, 4, endpoint=False).tolist()
        x, y, z = self.point
        return tuple(
            replace(self, point=point, frequency=hertz, phase=phase)
            for point in ((x, y, z), (z, x, y))
            for phase in phases
        )

    def apart(self) -> Array:
        return np.array(self.point)

    def pull(self, platform: Platform) -> Callable[[Array], Array]:
        del platform

        def force(time: Array) -> Array:
            turn = 2.0 * np.pi * self.frequency * time + self.phase
            return np.sin(turn)[:, None] * np.array(self.force)

        return force


@dataclass(frozen=True)
class StructuralSag(BodyEffect):
    """The structure bends sideways as it is tilted: m r += k (g_x, g_y, 0), body axes.

    Its gravity torque is k (g_y g_z, -g_x g_z, 0), quadratic in gravity: Python evaluates it once a
    physics step. The bending itself is taken as immediate.
    """

    name = "structural_sag"
    domain = Domain.torque
    observable = "a pendulum stiffness that falls with tilt; at small tilt it is a lower CM"
    streams = ("gyro", "attitude")

    softness: float = parameter(
        "mass moment per gravity across",
        "kg m/(m/s^2)",
        2.8e-4,
        source="ASSUMED: 10 kg carried by what swings at 30 Hz, m / (2 pi f)^2",
        low=0.0,
        high=1.0,
    )

    def unfit(self, platform: Platform) -> str:
        return super().unfit(platform) or needs_ball(platform)

    def torque(self, platform: Platform) -> TorqueLaw:
        strength = self.softness * platform.gravity**2

        def law(state: State) -> Array:
            x, y, z = vertical_body(state.position).T
            return strength * np.stack([y * z, -x * z, np.zeros_like(z)], axis=-1)

        return law

    def mass_moment(self, platform: Platform) -> MomentLaw:
        strength = self.softness * platform.gravity

        def law(state: State) -> Array:
            x, y, z = vertical_body(state.position).T  # gravity points the other way
            return -strength * np.stack([x, y, np.zeros_like(z)], axis=-1)

        return law
