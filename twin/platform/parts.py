"""What a machine is made of, as platform.toml states it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from twin.errors import UnknownName
from twin.signals import STREAMS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Base:
    """The joint between the room and the floating body."""

    kind: Literal["ball", "hinge"]
    joint: str
    """Its name in the MJCF."""
    body: str
    """The body it carries: the bus."""
    actuator: str | None = None
    """A motor on a hinge that takes `command_joint_torque`; None where there is none."""
    torque_limit: float = np.inf
    """[N m]."""


@dataclass(frozen=True)
class Wheel:
    """A reaction wheel; it spins about its MJCF axis, right-handed."""

    name: str
    """Of its joint and its motor in the MJCF."""
    inertia: float
    """About the spin axis [kg m^2]."""
    momentum_limit: float
    """[N m s]."""
    torque_limit: float
    """[N m]."""
    axis: Array
    """(3,) spin axis in body axes, unit, as the MJCF has it."""

    @property
    def speed_limit(self) -> float:
        """[rad/s]."""
        return self.momentum_limit / self.inertia


@dataclass(frozen=True)
class Stage:
    """A sliding balance mass on a lead screw: a prescribed joint."""

    name: str
    """Of its joint in the MJCF."""
    mass: float
    """[kg]."""
    travel: tuple[float, float]
    """Lowest and highest position [m]; 0 is MJCF's qpos 0."""
    speed: float
    """Highest speed [m/s]."""
    acceleration: float
    """Highest acceleration [m/s^2]."""
    resolution: float
    """Smallest step of the commanded position [m]; 0: continuous."""
    axis: Array
    """(3,) direction of positive travel in body axes, unit, as the MJCF has it."""


@dataclass(frozen=True)
class Sensor:
    """How a stream is measured; faults come in the order of the fields, latency after dropout."""

    stream: str
    rate: float
    """[Hz]."""
    noise: Array
    """White noise, 1 sigma a sample, one number a column, in the stream's unit. On `attitude`:
    three numbers [rad], a rotation about the body axes."""
    bias: Array
    """1 sigma of a constant drawn once a run, as `noise`."""
    resolution: float = 0.0
    """Quantisation step in the stream's unit; 0: none."""
    range: float = np.inf
    """Readings saturate at plus and minus this."""
    latency: float = 0.0
    """From the instant a value is true to its arrival [s]."""
    dropout: float = 0.0
    """Probability that a sample never arrives."""


@dataclass(frozen=True)
class StatedEffect:
    """An effect as it is stated; `twin.effects` knows what it does."""

    name: str
    target: str
    """The stream or part it acts on; empty without one."""
    values: Mapping[str, Any]
    """Of its parameters, by name, SI."""
    line: int | None = None
    """Where platform.toml states it."""
    made_by: type[Any] | None = None
    """Its class, where it was not read from platform.toml."""


@dataclass(frozen=True)
class Platform:
    """A machine: the MJCF beside it and what MJCF cannot say."""

    name: str
    """`sads`, or `sads:table1` for a variant."""
    title: str
    folder: Path
    model_path: Path
    """The MJCF."""
    step: float
    """Physics step [s]; a whole number of them fits a control tick."""
    control_rate: float
    """[Hz]."""
    mass: float
    """Of everything that floats [kg]."""
    inertia: Array
    """(3, 3) about the CR, body axes [kg m^2], stages at 0, wheels locked (docs/design.md 4.1)."""
    center_of_mass_offset: Array
    """(3,) m r from CR to CM at stage position 0, body axes [kg m]."""
    base: Base
    wheels: tuple[Wheel, ...]
    stages: tuple[Stage, ...]
    sensors: Mapping[str, Sensor]
    """By stream."""
    gravity: float
    """[m/s^2], along -z of the world; the MJCF's own is overwritten with it."""
    magnetic_field: Array
    """(3,) world [T]."""
    tilt_limit: float
    """Where the tilt stop touches [rad]; inf without one."""
    paper_from_body: Array
    """Quaternion that turns our body axes into the source's own; identity unless stated."""
    effects: tuple[StatedEffect, ...] = ()
    """What the machine has beyond its parts (docs/design.md 4.4)."""

    @property
    def tick(self) -> float:
        """Control period [s]."""
        return 1.0 / self.control_rate

    @property
    def steps_per_tick(self) -> int:
        """Physics steps in a control period."""
        return round(self.tick / self.step)

    @property
    def commands(self) -> dict[str, int]:
        """Command streams this machine takes, with their widths."""
        widths = {
            "command_wheel_torque": len(self.wheels),
            "command_stage_position": len(self.stages),
            "command_joint_torque": int(self.base.actuator is not None),
        }
        return {name: width for name, width in widths.items() if width}

    def columns(self, stream: str) -> tuple[str, ...]:
        """Column names of a canonical stream on this machine.

        Raises:
            UnknownName: no such stream.
        """
        if stream not in STREAMS and not stream.startswith("wanted_"):
            raise UnknownName("stream", stream, STREAMS)
        fixed = STREAMS[stream].columns if stream in STREAMS else ()
        if fixed:
            return fixed
        if "wheel" in stream:
            return tuple(wheel.name for wheel in self.wheels)
        if "stage" in stream:
            return tuple(stage.name for stage in self.stages)
        if "joint" in stream:
            return (self.base.joint,) if self.base.kind == "hinge" else ()
        return ()
