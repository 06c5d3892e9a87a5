"""A machine moved twice in the same way, without an effect and with it, and what that changes.

The motion is open loop: torques on waves, masses to and fro, the body let go with a rate. A control
law would hide in its commands what the effect does to the motion, a tilt stop would exaggerate it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.clock import SimulatedClock
from twin.controller import Controller
from twin.effects import Effect, ScatterEffect, able, effect_named, with_effects
from twin.estimators.estimator import Passthrough
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.recording import Recording, Series
from twin.reference import Hold
from twin.signals import Command, Estimate, Target
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]

SECONDS = 60.0
EDGE = 1.0
"""Seconds at either end that are not compared: a late stream has nothing there."""

ROUND_OFF = 1e-9
"""Of a stream's size: what two computations of one thing may differ by."""

_PERIODS = (7.0, 11.0, 13.0, 17.0)
"""Of the parts' waves, in turn [s]; cosines, so that none gives the body a mean rate."""


@dataclass(frozen=True)
class ExcitingLaw(Controller[Platform]):
    """Moves everything that a machine has, whatever the motion."""

    wheel_torque: float = 0.1
    """Share of the limit."""
    stage_travel: float = 0.01
    """Share of the travel, to either side."""
    joint_torque: float = 0.1
    """Share of the limit."""
    gimbal_rate: float = 0.1
    """Share of the limit."""
    dipole: float = 0.5
    """Share of the limit of the weakest coil."""
    thrust: float = 0.02
    """Share of the limit."""

    def init(self, platform: Platform, n: int) -> Platform:
        """The machine that it moves."""
        return platform

    def update(
        self, state: Platform, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Platform]:
        """Functions of time."""
        platform = state
        rows = (len(estimate.valid), 1)
        command: Command = {}
        if "command_wheel_torque" in platform.commands:
            size = self.wheel_torque * np.array([w.torque_limit for w in platform.wheels])
            command["command_wheel_torque"] = np.tile(size * _waves(len(size), time), rows)
        if "command_stage_position" in platform.commands:
            reach = np.array([min(-s.travel[0], s.travel[1]) for s in platform.stages])
            side = np.sign(_waves(len(reach), time))
            command["command_stage_position"] = np.tile(self.stage_travel * reach * side, rows)
        if "command_joint_torque" in platform.commands:
            size = np.array([self.joint_torque * platform.base.torque_limit])
            command["command_joint_torque"] = np.tile(size * _waves(1, time), rows)
        if "command_gimbal_rate" in platform.commands:
            size = self.gimbal_rate * np.array([g.rate for g in platform.gimbals])
            command["command_gimbal_rate"] = np.tile(size * _waves(len(size), time), rows)
        if "command_dipole" in platform.commands:
            size = self.dipole * min(m.dipole_limit for m in platform.magnetorquers)
            command["command_dipole"] = np.tile(size * _waves(3, time), rows)
        if "command_thruster" in platform.commands:
            size = self.thrust * np.array([t.force_limit for t in platform.thrusters])
            wave = _waves(len(size), time)
            push = np.maximum(size * wave, 0.0)
            on_off = np.array([t.on_off for t in platform.thrusters])
            push[on_off & (wave > 0.5)] = size[on_off & (wave > 0.5)] / self.thrust
            command["command_thruster"] = np.tile(push, rows)
        return command, state


@dataclass(frozen=True)
class Difference:
    """What an effect changes in one stream."""

    stream: str
    unit: str
    columns: tuple[str, ...]
    """k names; x y z of an attitude, whose difference is a turn about body axes."""
    noise: float
    """1 sigma a sample of the sensor, root mean square of its columns."""
    time: Array
    """(m,) [s]."""
    value: Array
    """(m, k) with the effect, less without."""
    size: float
    """The largest value of the stream itself."""

    @property
    def significant(self) -> bool:
        """Whether it is more than arithmetic leaves."""
        return self.worst > ROUND_OFF * self.size

    @property
    def rms(self) -> float:
        """Root mean square of a sample's whole difference."""
        return float(np.sqrt(np.mean(np.sum(np.square(self.value), axis=1))))

    @property
    def worst(self) -> float:
        """The largest whole difference of a sample."""
        return float(np.sqrt(np.sum(np.square(self.value), axis=1)).max())


@dataclass(frozen=True)
class Contrast:
    """A machine with and without an effect."""

    platform: Platform
    """As it was moved: perhaps with a shorter step than its own."""
    effect: Effect
    differences: tuple[Difference, ...]
    """Of all measured streams, the sensors' own noise left out."""


def contrast(platform: Platform, effect: Effect) -> Contrast:
    """Move a machine with and without an effect.

    Raises:
        EffectError: the platform cannot have it, whatever its step.
    """
    fine = able(platform, effect)
    quiet = undisturbed(fine)
    without = moved(quiet, (), SECONDS)
    changed = moved(quiet, (effect,), SECONDS)
    differences = tuple(
        _difference(fine, stream, without[stream], changed[stream])
        for stream in fine.sensors
        if stream in without and stream in changed
    )
    return Contrast(fine, effect, differences)


def undisturbed(platform: Platform) -> Platform:
    """The platform without a tilt stop, its sensors without noise, bias or loss.

    Its own effects stay, but for those that are noise.
    """
    sensors = {
        name: replace(
            sensor,
            noise=np.zeros_like(sensor.noise),
            bias=np.zeros_like(sensor.bias),
            resolution=0.0,
            dropout=0.0,
        )
        for name, sensor in platform.sensors.items()
    }
    kinds = [effect.made_by or effect_named(effect.name) for effect in platform.effects]
    known = zip(platform.effects, kinds, strict=True)
    effects = tuple(item for item, kind in known if not issubclass(kind, ScatterEffect))
    return replace(platform, sensors=sensors, effects=effects, tilt_limit=np.pi)


def moved(
    platform: Platform,
    effects: Sequence[Effect],
    seconds: float,
    seed: int = 0,
    law: Controller[Platform] | None = None,
) -> Recording:
    """A platform's run under the excitation, or under another law of time."""
    start = InitialState(
        rate_body=np.array([0.004, -0.002, 0.05]),
        joint_angle=0.5,
        wheel_speed=0.05 * np.array([wheel.speed_limit for wheel in platform.wheels]),
    )
    memory = MemoryRecorder(platform)
    plant = SimulatedPlant(with_effects(platform, effects), initial=start, seed=seed)
    fly(
        plant,
        Passthrough(),
        law or ExcitingLaw(),
        Hold(),
        SimulatedClock(),
        duration=seconds,
        observers=[memory],
    )
    return memory.recording()


def difference(stream: str, reference: Series, other: Series, time: Array) -> Array:
    """(m, k) `other` less `one` at times (m,), between samples by straight lines."""
    before, after = reference.interpolated_at(time), other.interpolated_at(time)
    if stream != "attitude":
        return after - before
    turn = rotation.multiply(
        rotation.conjugate(rotation.normalized(before)), rotation.normalized(after)
    )
    return rotation.to_rotation_vector(turn)


def _difference(platform: Platform, stream: str, reference: Series, other: Series) -> Difference:
    inside = (reference.time >= reference.time[0] + EDGE) & (
        reference.time <= reference.time[-1] - EDGE
    )
    time = reference.time[inside]
    attitude = stream == "attitude"
    return Difference(
        stream,
        "rad" if attitude else reference.unit,
        ("x", "y", "z") if attitude else reference.columns,
        float(np.sqrt(np.mean(np.square(platform.sensors[stream].noise)))),
        time,
        difference(stream, reference, other, time),
        1.0 if attitude else float(np.abs(reference.value).max()),
    )


def _waves(count: int, time: float) -> Array:
    periods = np.array([_PERIODS[i % len(_PERIODS)] for i in range(count)])
    return np.cos(2.0 * np.pi * time / periods)
