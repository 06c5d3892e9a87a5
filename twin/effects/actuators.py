"""Effects on hinges, gimbals, stages, magnetorquers and thrusters."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import mujoco
import numpy as np

from twin.effects.effect import Domain, EffectError, parameter
from twin.effects.on_body import BodyEffect, body_of_joint
from twin.effects.on_series import (
    Array,
    DelayEffect,
    Live,
    Order,
    ReadingEffect,
    Recursion,
    ScaleEffect,
    ScatterEffect,
    SeriesEffect,
    columns_of,
    with_value,
)
from twin.platform import Platform, Thruster
from twin.rotation import conjugate, from_rotation_vector, least_turn, multiply, rotate
from twin.signals import Samples


@dataclass(frozen=True)
class EncoderError(ReadingEffect):
    """A hinge's angle a is shown as a + s sin(n a) + c cos(n a), n waves a turn.

    The rate that the same encoder gives is the rate of that. An eccentric disc makes one wave a
    turn, a magnet beside its sensor's axis two; an encoder on a motor behind a gear makes each so
    many times more as the gear reduces.
    """

    name = "encoder_error"
    domain = Domain.sensor
    observable = "angle and rate stray by so many waves in every turn, the rate more at speed"
    streams = ("joint_angle",)
    reads = ("joint_angle", "joint_rate")

    sine: float = parameter(
        "amplitude with the sine of the angle",
        "rad",
        5e-4,
        source="ASSUMED: 0.03 deg, a magnet 0.02 mm beside its sensor's axis",
        low=-0.1,
        high=0.1,
    )
    cosine: float = parameter(
        "amplitude with its cosine",
        "rad",
        3e-4,
        source="ASSUMED: likewise",
        low=-0.1,
        high=0.1,
    )
    waves: float = parameter(
        "in a turn",
        "1",
        2.0,
        source="ASSUMED: a magnet beside its sensor's axis",
        low=0.5,
        high=1000.0,
        amplitude=False,
    )

    def with_waves(self, waves: float) -> tuple[Self, ...]:
        return (self.with_values(np.array([self.sine, self.cosine, waves])),)

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        return missing or ("" if platform.base.kind == "hinge" else "it needs a hinge")

    def error(self, stream: str, position: Array, rate: Array) -> Array:
        turns = self.waves * position
        if stream == "joint_angle":
            return self.sine * np.sin(turns) + self.cosine * np.cos(turns)
        slope = self.waves * (self.sine * np.cos(turns) - self.cosine * np.sin(turns))
        return slope * rate


@dataclass(frozen=True)
class JointTorqueGain(ScaleEffect):
    """Of the commanded torque of a hinge, (1 + e) arrives.

    Torque, J and m r have one common factor, which no motion shows: it is seen where platform.toml
    states the standard deviations of J and m r.
    """

    name = "joint_torque_gain"
    domain = Domain.actuator
    observable = "the hinge moves by more or less than the torque says, for the J and m r stated"
    streams = ("joint_angle", "command_joint_torque")
    acts_on = "command_joint_torque"
    exact = True

    error: float = parameter(
        "of the scale",
        "1",
        -0.1,
        source="ASSUMED: what gears lose, and the tolerance of a torque constant",
        low=-0.9,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return np.ones(1) + self.error

    def hidden_from(self, platform: Platform) -> str:
        if platform.inertia_sd is None or platform.center_of_mass_offset_sd is None:
            return "without inertia_sd and center_of_mass_offset_sd J and m r may take it"
        return ""


@dataclass(frozen=True)
class JointTorqueDelay(DelayEffect):
    """A hinge's torque commanded, or read, at t acts at t + tau.

    A drive answers a cycle or two of its bus after the command, and its current, from which a
    torque is read, leads the torque behind a gear that has play. Angle and rate are late together
    against such a torque, which no clock of a sensor explains.
    """

    name = "joint_torque_delay"
    domain = Domain.actuator
    observable = "angle and rate follow the torque later than the model says"
    streams = ("joint_angle", "command_joint_torque")
    acts_on = "command_joint_torque"

    delay: float = parameter(
        "from the command to the torque",
        "s",
        0.02,
        source="ASSUMED: two cycles of a loop at 100 Hz",
        low=-0.5,
        high=0.5,
    )

    def lateness(self) -> float:
        return self.delay


@dataclass(frozen=True)
class GimbalBacklash(SeriesEffect):
    """The gimbal follows its gear within a play of the given full width, from its middle.

    Commands are rates, held over a control tick: the gear turns by them, the gimbal by what the
    play lets through. `undo` gives the rates of the gear that lead to those of the gimbal; of many
    within the play it takes the least motion.
    """

    name = "gimbal_backlash"
    domain = Domain.actuator
    observable = "after a reversal the gimbal stands still for a while"
    streams = ("gimbal_angle", "command_gimbal_rate")
    order = Order.filter
    acts_on = "command_gimbal_rate"
    takes = "gimbal"

    width: float = parameter(
        "full width of the play",
        "rad",
        2e-3,
        source="ASSUMED: a tenth of a degree, a good gear",
        low=0.0,
        high=1.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)

        def follow(gear: Array, gimbal: Array) -> Array:
            return np.clip(gimbal, gear - half, gear + half)

        return _Turned(follow, platform.tick)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)
        before = np.zeros_like(samples.value[:, 0])

        def lead(gimbal: Array, gear: Array) -> Array:
            nonlocal before
            turned, before = gimbal - before, gimbal
            return np.where(turned == 0.0, gear, gimbal + np.sign(turned) * half)

        return _Turned(lead, platform.tick)(samples)


class _Turned:
    """Follows an angle that is given by its rate over each tick."""

    def __init__(self, follow: Callable[[Array, Array], Array], tick: float) -> None:
        """Both angles start at 0.

        Args:
            follow: from the leading angle and the last one of what follows to its next.
            tick: [s].
        """
        self._follow = follow
        self._tick = tick
        self._angles: tuple[Array, Array] | None = None

    def __call__(self, samples: Samples) -> Samples:
        """The next rates."""
        rate = np.empty_like(samples.value)
        for i in range(rate.shape[1]):
            if self._angles is None:
                self._angles = np.zeros_like(rate[:, i]), np.zeros_like(rate[:, i])
            lead, follow = self._angles
            lead = lead + samples.value[:, i] * self._tick
            moved = self._follow(lead, follow)
            rate[:, i] = (moved - follow) / self._tick
            self._angles = lead, moved
        return with_value(samples, rate)


@dataclass(frozen=True)
class GimbalCenterOfMassOffset(BodyEffect):
    """The mass moment of what a gimbal turns has parts across its axis, and so m r turns with it.

    Along the rotor's axis at angle 0, and along the gimbal's axis crossed with it. The whole has
    the stated mass properties at angle 0.
    """

    name = "gimbal_center_of_mass_offset"
    domain = Domain.torque
    observable = "a gravity torque that turns with the gimbal's angle"
    streams = ("gyro", "attitude", "gimbal_angle")
    takes = "gimbal"

    moment: tuple[float, ...] = parameter(
        "mass moment along the rotor's axis at 0, and across it",
        "kg m",
        (1e-3, -5e-4),
        source="ASSUMED: 10 kg whose CM lies 0.1 mm off",
        low=-10.0,
        high=10.0,
    )

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for name in self.of_parts([gimbal.name for gimbal in platform.gimbals]):
            body = body_of_joint(model, name)
            spin = next(p for p in (*platform.wheels, *platform.rotors) if p.gimbal == name)
            along = data.xaxis[model.joint(spin.name).id]
            across = np.cross(data.xaxis[model.joint(name).id], along)
            off = self.moment[0] * along + self.moment[1] * across
            model.body_ipos[body] += data.xmat[body].reshape(3, 3).T @ off / model.body_mass[body]


@dataclass(frozen=True)
class GimbalFriction(SeriesEffect):
    """The rate falls short by friction over the drive's stiffness; a small one does not start it.

    A drive with torque k (command - rate) turns at r - c / k sign(r), and stands where k |r| < c.
    Between gimbal and body the friction itself is taken up by the drive: only the rate tells.
    A drive that the platform states (`[gimbals.drive]`) has the friction in its loop instead.
    `undo` takes a gimbal that stands for one that was told to.
    """

    name = "gimbal_friction"
    domain = Domain.actuator
    observable = "the gimbal turns slower than it is told, and not at all at small commands"
    streams = ("gimbal_rate", "command_gimbal_rate")
    order = Order.scale
    acts_on = "command_gimbal_rate"
    takes = "gimbal"

    torque: float = parameter(
        "dry friction",
        "N m",
        0.02,
        source="ASSUMED: a pair of preloaded bearings and a slip ring",
        low=0.0,
        high=100.0,
    )
    stiffness: float = field(default=5.0)
    """Torque of the drive per error of the rate [N m s/rad]. ASSUMED."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.stiffness < np.inf:
            raise EffectError(
                f"{self.name}: stiffness is {self.stiffness!r} N m s/rad; it must lie above 0"
            )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        rate, lost = samples.value, self._lost(platform)
        return with_value(samples, np.sign(rate) * np.maximum(np.abs(rate) - lost, 0.0))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        rate, lost = samples.value, self._lost(platform)
        return with_value(samples, rate + np.sign(rate) * lost)

    def hidden_from(self, platform: Platform) -> str:
        if any(gimbal.drive is not None for gimbal in platform.gimbals):
            return "the drives' loops take it up"
        return ""

    def on_gimbals(self, platform: Platform) -> Array:
        """(n, gimbals) friction [N m]; n is 1 where it is one for all runs."""
        affected = columns_of(self, platform, self.stream)
        return np.where(affected, np.reshape(self.torque, (-1, 1)), 0.0)

    def _lost(self, platform: Platform) -> Array:
        affected = columns_of(self, platform, self.stream)
        return np.where(affected, self.torque / self.stiffness, 0.0)


@dataclass(frozen=True)
class GimbalOffset(SeriesEffect):
    """The angle that it shows is a constant too much: delta + b."""

    name = "gimbal_offset"
    domain = Domain.sensor
    observable = "the body feels the gyro's torque about an axis that the angle does not say"
    streams = ("gimbal_angle", "gyro")
    order = Order.bias
    acts_on = "gimbal_angle"
    takes = "gimbal"

    offset: float = parameter(
        "of the angle's zero",
        "rad",
        9e-3,
        source="ASSUMED: half a degree, set by eye",
        low=-3.2,
        high=3.2,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + self._offset(platform))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - self._offset(platform))

    def _offset(self, platform: Platform) -> Array:
        return np.where(columns_of(self, platform, self.stream), self.offset, 0.0)


@dataclass(frozen=True)
class StageBacklash(SeriesEffect):
    """The mass follows within a play of the given full width: x = clip(x, u - b/2, u + b/2).

    It starts in the middle of the play. `undo` gives the command that leads to a position; within
    the play there are many, and it takes the nearest that moves the mass.
    """

    name = "stage_backlash"
    domain = Domain.actuator
    observable = "after a reversal the mass stands still for a while"
    streams = ("stage_position", "command_stage_position")
    order = Order.filter
    acts_on = "command_stage_position"
    takes = "stage"

    width: float = parameter(
        "full width of the play",
        "m",
        2e-5,
        source="003: Table 1 shows masses that scatter by 26 to 30 um",
        low=0.0,
        high=0.1,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)

        def follow(_: Array, before: Array, shown: Array, current: Array) -> Array:
            del before
            return np.clip(shown, current - half, current + half)

        return Recursion(follow)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        half = 0.5 * self.width * columns_of(self, platform, self.stream)

        def lead(_: Array, before: Array, shown: Array, current: Array) -> Array:
            side = np.where(current == before, shown - before, np.sign(current - before) * half)
            return current + side

        return Recursion(lead)(samples)


@dataclass(frozen=True)
class StageScale(ScaleEffect):
    """The mass goes to (1 + e) of the position that is commanded."""

    name = "stage_scale"
    domain = Domain.actuator
    observable = "position and mass moment change by more or less than the command says"
    streams = ("stage_position", "command_stage_position")
    acts_on = "command_stage_position"
    takes = "stage"

    error: float = parameter(
        "of the scale",
        "1",
        0.01,
        source="ASSUMED: a percent of pitch",
        low=-0.9,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return np.where(columns_of(self, platform, self.stream), 1.0 + self.error, 1.0)


@dataclass(frozen=True)
class StageStepLoss(SeriesEffect):
    """Of every move in the positive direction a share is lost; the way back is whole.

    Where the command starts, the mass is where it should be.
    """

    name = "stage_step_loss"
    domain = Domain.actuator
    observable = "the position falls behind the command, more with every move to and fro"
    streams = ("stage_position", "command_stage_position")
    order = Order.scale
    acts_on = "command_stage_position"
    takes = "stage"

    share: float = parameter(
        "of the steps of a positive move",
        "1",
        0.02,
        source="ASSUMED: a drive near its torque limit",
        low=0.0,
        high=0.99,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        kept = 1.0 - self.share * columns_of(self, platform, self.stream)

        def follow(_: Array, before: Array, shown: Array, current: Array) -> Array:
            return shown + (current - before) * np.where(current > before, kept, 1.0)

        return Recursion(follow)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        kept = 1.0 - self.share * columns_of(self, platform, self.stream)

        def lead(_: Array, before: Array, shown: Array, current: Array) -> Array:
            return shown + (current - before) / np.where(current > before, kept, 1.0)

        return Recursion(lead)(samples)


@dataclass(frozen=True)
class StageVibration(ScatterEffect):
    """White noise on the gyro, as strong as the stages are fast (root of the sum of squares)."""

    name = "stage_vibration"
    domain = Domain.sensor
    observable = "the gyro scatters more while a mass moves"
    streams = ("gyro", "stage_position")
    takes = "stage"
    acts_on = "gyro"
    cause = "stage_speed"

    gain: float = parameter(
        "1 sigma a sample, per stage speed",
        "(rad/s)/(m/s)",
        1.0,
        source="003: 0.006 to 0.019 rad/s would account for Table 1; at some 10 mm/s",
        low=0.0,
        high=1e4,
    )

    def sigma(self, cause: Array, platform: Platform) -> Array:
        affected = cause[..., columns_of(self, platform, "stage_position")]
        return self.gain * np.sqrt(np.sum(np.square(affected), axis=-1, keepdims=True))


@dataclass(frozen=True)
class MagnetorquerGain(ScaleEffect):
    """Of a commanded dipole, (1 + e) arrives, axis by axis of the body."""

    name = "magnetorquer_gain"
    domain = Domain.actuator
    observable = "the body turns into the field by more or less than the command says"
    streams = ("gyro", "attitude", "command_dipole")
    acts_on = "command_dipole"

    error: tuple[float, ...] = parameter(
        "of the scale, body axes",
        "1",
        (0.05, -0.04, 0.03),
        source="ASSUMED: the tolerance of a coil's resistance and core",
        low=-0.9,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return 1.0 + np.array(self.error)


@dataclass(frozen=True)
class GasConsumption(SeriesEffect):
    """A valve leaks: the pressure falls by p_0 c t / m_0 beside what the thrusters take.

    At constant temperature, while the tanks are not empty. Where platform.toml says where the tanks
    are, its mass, m r and J leave with it; else that is a `center_of_mass_drift`.
    """

    name = "gas_consumption"
    domain = Domain.actuator
    observable = "the pressure falls while no thruster fires"
    streams = ("gas_pressure", "command_thruster")
    order = Order.bias
    acts_on = "gas_pressure"

    rate: float = parameter(
        "gas lost per second",
        "kg/s",
        1e-5,
        source="ASSUMED: a tank of 0.5 kg empty overnight",
        low=0.0,
        high=1.0,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        return missing or ("" if platform.gas else "it states no gas")

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - self._lost(samples, platform))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + self._lost(samples, platform))

    def _lost(self, samples: Samples, platform: Platform) -> Array:
        assert platform.gas is not None
        return self.rate * platform.gas.pressure / platform.gas.mass * samples.time[..., None]


@dataclass(frozen=True)
class NozzleGain(ScaleEffect):
    """Of the commanded force of one thruster, (1 + e) arrives; -1: none, its valve stays shut."""

    name = "nozzle_gain"
    domain = Domain.actuator
    observable = "the machine answers to one thruster otherwise than to its neighbours"
    streams = ("gyro", "command_thruster")
    acts_on = "command_thruster"
    takes = "thruster"
    exact = True

    error: float = parameter(
        "of the scale",
        "1",
        -0.2,
        source="ASSUMED: what nozzles of one kind differ by, and more where one is clogged",
        low=-10.0,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return np.where(columns_of(self, platform, self.stream), 1.0 + self.error, 1.0)


@dataclass(frozen=True)
class ThrusterDelay(DelayEffect):
    """A force commanded at t acts at t + tau, beyond the delay that platform.toml states."""

    name = "thruster_delay"
    domain = Domain.actuator
    observable = "the machine answers to every command after a constant time"
    streams = ("gyro", "command_thruster")
    acts_on = "command_thruster"

    delay: float = parameter(
        "from the command to the force",
        "s",
        0.05,
        source="ASSUMED: a solenoid valve and half a metre of hose",
        low=-1.0,
        high=1.0,
    )

    def lateness(self) -> float:
        return self.delay


@dataclass(frozen=True)
class ThrusterGain(ScaleEffect):
    """Of the commanded force of every thruster, (1 + e) arrives.

    Force, mass, J and m r have one common factor, which no motion shows: weak thrusters move a
    machine as more mass does. It is seen where platform.toml states how well the mass is known.
    """

    name = "thruster_gain"
    domain = Domain.actuator
    observable = "the machine moves by more or less than the thrust says, for the mass stated"
    streams = ("gyro", "command_thruster")
    acts_on = "command_thruster"
    exact = True

    error: float = parameter(
        "of the scale",
        "1",
        -0.1,
        source="ASSUMED: what the pressure falls by while several valves are open",
        low=-0.9,
        high=10.0,
    )

    def gain(self, platform: Platform) -> Array:
        return np.ones(1) + self.error

    def hidden_from(self, platform: Platform) -> str:
        known = platform.mass_sd if platform.base.on_floor else platform.inertia_sd
        if known is not None:
            return ""
        if platform.base.on_floor:
            return "without mass_sd the mass may take it, and J and m r with it"
        return "without inertia_sd J and m r may take it"


@dataclass(frozen=True)
class ThrusterMisalignment(BodyEffect):
    """The force of a thruster is turned by phi, about the point where it acts.

    A turn about its own direction does nothing.
    """

    name = "thruster_misalignment"
    domain = Domain.actuator
    observable = "a thruster turns the body about other axes, too"
    streams = ("gyro", "command_thruster")
    takes = "thruster"

    rotation: tuple[float, ...] = parameter(
        "of the force, body axes",
        "rad",
        (0.02, -0.01, 0.03),
        source="ASSUMED: 1 to 2 deg of mounting",
        low=-1.5,
        high=1.5,
    )

    def least(self, platform: Platform) -> Self:
        axes = [
            thruster.direction for thruster in platform.thrusters if thruster.name == self.target
        ]
        if not axes:  # of all, which have no axis in common
            return self
        return self.if_possible(least_turn(np.array(self.rotation), axes[0]))

    def edit_model(self, model: mujoco.MjModel, platform: Platform) -> None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for name in self.of_parts([thruster.name for thruster in platform.thrusters]):
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
            if site < 0:  # on a bearing that stands it is a torque, which `edit_thruster` turns
                continue
            carrier = data.xquat[model.site_bodyid[site]]
            local = multiply(conjugate(carrier), multiply(self._turn, carrier))
            model.site_quat[site] = multiply(local, model.site_quat[site])
            model.site_sameframe[site] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE

    def edit_thruster(self, thruster: Thruster) -> Thruster:
        if not self.of_parts([thruster.name]):
            return thruster
        return replace(thruster, direction=rotate(self._turn, thruster.direction))

    @property
    def _turn(self) -> Array:
        return from_rotation_vector(np.array(self.rotation))
