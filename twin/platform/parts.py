"""What a machine is made of, as platform.toml states it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from twin.rotation import tilt, vertical_body
from twin.signals import stream_named

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Base:
    """The joint between the room and the floating body."""

    kind: Literal["ball", "hinge", "free", "planar"]
    """A free base is carried by nothing: a body that is thrown. Its CR is its body's origin.
    A planar one is what a locked ball on a planar stage is for a prediction (`on_floor`)."""
    joint: str
    """Its name in the MJCF."""
    body: str
    """The body it carries: the bus."""
    actuator: str | None = None
    """A motor on a hinge that takes `command_joint_torque`; None where there is none."""
    torque_limit: float = np.inf
    """[N m]."""
    planar: tuple[str, ...] = ()
    """Joints of a stage that floats on the floor below the ball: slides along the room's x and y,
    and the hinge of its heading. The ball hangs on the slides, not on the heading: a bearing
    without friction does not feel it, and so the ball's joint is the attitude in the room."""
    locked: tuple[str, ...] = ()
    """Those of `joint` and `planar` that stand still. A locked ball turns with the heading."""
    falls: bool = False
    """Whether a ball is the centre of mass of a body that falls freely (`about_center_of_mass`)."""

    @property
    def travels(self) -> bool:
        """Whether the CR may move in the room."""
        return self.kind in ("free", "planar") or bool(set(self.planar[:2]) - set(self.locked))

    @property
    def on_floor(self) -> bool:
        """Whether the base has three degrees of freedom: it glides on a floor and turns about the
        vertical."""
        free = set(self.planar) - set(self.locked)
        return self.kind == "planar" or (self.joint in self.locked and free == set(self.planar))


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
    """(3,) spin axis in body axes, unit, as the MJCF has it; on a gimbal, at its angle 0."""
    gimbal: str | None = None
    """The gimbal that carries it, as the MJCF has it; None on the body."""
    home: float = 0.0
    """Speed at which a run starts [rad/s]."""

    @property
    def speed_limit(self) -> float:
        """[rad/s]."""
        return self.momentum_limit / self.inertia


@dataclass(frozen=True)
class Rotor:
    """A rotor whose motor holds its speed relative to what carries it: a prescribed joint."""

    name: str
    """Of its joint in the MJCF."""
    inertia: float
    """About the spin axis [kg m^2]."""
    speed: float
    """[rad/s]."""
    axis: Array
    """(3,) spin axis in body axes, unit, at the gimbal's angle 0."""
    gimbal: str | None
    """The gimbal that carries it, as the MJCF has it."""

    @property
    def momentum(self) -> float:
        """Relative to what carries it [N m s]."""
        return self.inertia * self.speed


@dataclass(frozen=True)
class GimbalDrive:
    """Motor and loop that turn a gimbal at a rate (`twin.plant.servo`)."""

    inertia: float
    """Of what the motor turns about its axis, the rotor with it [kg m^2]."""
    proportional: float
    """Torque per error of the rate [N m s/rad]."""
    integral: float
    """Torque per error of the angle [N m/rad]."""
    rate: float
    """Of the loop [Hz]."""
    torque_constant: float
    """At the gimbal [N m/A], and its back voltage per rate [V s/rad]."""
    current_limit: float
    """[A]."""
    voltage: float
    """Of the supply [V]."""
    resistance: float
    """Of the winding [ohm]."""
    friction: float
    """Dry, while it turns [N m]."""
    static_friction: float
    """Below which it sticks [N m]."""
    encoder: float
    """Step of its angle [rad]; 0: none."""


@dataclass(frozen=True)
class Gimbal:
    """The gimbal of a control moment gyro, driven at a rate: a prescribed joint.

    The axis of a wheel or rotor a that it carries stands at a cos(delta) + (g x a) sin(delta).
    """

    name: str
    """Of its joint in the MJCF."""
    rate: float
    """Highest rate [rad/s]."""
    acceleration: float
    """Highest acceleration [rad/s^2]."""
    home: float
    """Angle at which a run starts [rad]."""
    skew: float
    """Turn of the gimbal's axis about its rotor's at angle 0, from where the MJCF has it [rad]."""
    axis: Array
    """(3,) g in body axes, unit, with that turn."""
    drive: GimbalDrive | None = None
    """None: it turns as commanded."""


@dataclass(frozen=True)
class Magnetorquer:
    """A coil; its moment crossed with the magnetic field turns the body."""

    name: str
    """Of its site and its actuator in the MJCF."""
    dipole_limit: float
    """[A m^2]."""
    axis: Array
    """(3,) of its moment in body axes, unit: from the CR to its site in the MJCF."""


@dataclass(frozen=True)
class Thruster:
    """A cold-gas thruster; its command is the mean force over a control tick."""

    name: str
    """Of its site and its motor in the MJCF."""
    force_limit: float
    """[N]."""
    point: Array
    """(3,) where the force acts, from the CR, body axes [m]."""
    direction: Array
    """(3,) of the force on the body, body axes, unit."""
    delay: float = 0.0
    """From the command to the force [s]."""
    on_off: bool = False
    """Whether its valve is open or shut for a whole tick; else it is open for a part of it."""


@dataclass(frozen=True)
class Tank:
    """A vessel of gas on the floating body: its gas is a point there, and falls as all tanks'."""

    place: Array
    """(3,) of its middle from the CR, body axes [m]."""
    volume: float = 1.0
    """By which the tanks share the gas, in whatever unit."""


@dataclass(frozen=True)
class Gas:
    """What feeds the thrusters."""

    mass: float
    """In full tanks [kg]."""
    pressure: float
    """Of full tanks [Pa]; it falls in proportion to what is left."""
    specific_impulse: float
    """[s]."""
    tanks: tuple[Tank, ...] = ()
    """What holds it; without any, what leaves is not taken off the machine's mass."""

    @property
    def moment(self) -> Array:
        """(3,) m r of a kilogram of it, spread over the tanks, body axes [m]."""
        share, places = self._spread
        return share @ places

    @property
    def inertia(self) -> Array:
        """(3, 3) of a kilogram of it about the CR, each tank a point [m^2]."""
        share, places = self._spread
        squares = np.einsum("ti,ti->t", places, places)
        return (share @ squares) * np.eye(3) - np.einsum("t,ti,tj->ij", share, places, places)

    @property
    def _spread(self) -> tuple[Array, Array]:
        volume = np.array([tank.volume for tank in self.tanks])
        return volume / np.sum(volume), np.array([tank.place for tank in self.tanks])


@dataclass(frozen=True)
class Stage:
    """A sliding balance mass on a lead screw: a prescribed joint."""

    name: str
    """Of its joint in the MJCF."""
    mass: float
    """All that slides on it, stages stacked on it too [kg]."""
    travel: tuple[float, float]
    """Lowest and highest position [m]; 0 is MJCF's qpos 0."""
    speed: float
    """Highest speed [m/s]."""
    acceleration: float
    """Highest acceleration [m/s^2]."""
    resolution: float
    """Smallest step of the commanded position [m]; 0: continuous."""
    response: float
    """From a command to the start of the move, in whole ticks [s]."""
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
    cutoff: float = np.inf
    """Of a Butterworth low-pass before the noise [Hz]; inf: none."""
    order: int = 4
    """Of that filter."""
    site: str = ""
    """Of the MJCF, at which specific force is felt; of accelerometers and inclinometers."""
    window: float = 0.0
    """Of the same: over which they take the mean change of the velocity, at least a physics step
    [s]."""


@dataclass(frozen=True)
class PitchStop:
    """Limits the elevation of one body axis and leaves the turn about it free, as a dumbbell's."""

    axis: Array
    """(3,) body axes, unit; horizontal when level."""
    angle: float
    """At which it touches, up and down [rad]."""


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
    rotors: tuple[Rotor, ...]
    gimbals: tuple[Gimbal, ...]
    magnetorquers: tuple[Magnetorquer, ...]
    thrusters: tuple[Thruster, ...]
    gas: Gas | None
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
    pitch_stop: PitchStop | None = None
    """In place of a tilt stop."""
    inertia_sd: Array | None = None
    """(6,) standard deviations of xx yy zz xy xz yz as they were measured [kg m^2]; None where
    nobody stated them."""
    center_of_mass_offset_sd: Array | None = None
    """(3,) of m r [kg m]."""
    estimators: tuple[str, ...] = ()
    """Names of `twin.estimators` in order of preference: it flies on the first that its measured
    streams suffice for. Empty: the usual order."""
    mass_sd: float | None = None
    """Of the mass [kg]."""

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
            "command_gimbal_rate": len(self.gimbals),
            "command_dipole": 3 if self.magnetorquers else 0,
            "command_thruster": len(self.thrusters),
        }
        return {name: width for name, width in widths.items() if width}

    @property
    def stop_angle(self) -> float:
        """Where its stop touches, of tilt or pitch [rad]; inf without one."""
        return self.tilt_limit if self.pitch_stop is None else self.pitch_stop.angle

    def lean(self, attitude: Array) -> Array:
        """What the stop limits, at attitudes (..., 4): tilt or pitch, (...,) [rad]."""
        if self.pitch_stop is None:
            return tilt(attitude)
        sine = np.abs(vertical_body(attitude) @ self.pitch_stop.axis)
        return np.arcsin(np.minimum(sine, 1.0))

    @property
    def largest_torque(self) -> float:
        """Torque that actuators and gravity can give the body, all at once and alike [N m]."""
        reach = sum(stage.mass * max(map(abs, stage.travel)) for stage in self.stages)
        torque = self.gravity * (float(np.linalg.norm(self.center_of_mass_offset)) + reach)
        torque += sum(wheel.torque_limit for wheel in self.wheels)
        rates = {gimbal.name: gimbal.rate for gimbal in self.gimbals}
        torque += sum(
            rates[wheel.gimbal] * wheel.momentum_limit for wheel in self.wheels if wheel.gimbal
        )
        torque += sum(
            rates[rotor.gimbal] * abs(rotor.momentum) for rotor in self.rotors if rotor.gimbal
        )
        torque += sum(
            thruster.force_limit
            * float(np.linalg.norm(np.cross(thruster.point, thruster.direction)))
            for thruster in self.thrusters
        )
        field = float(np.linalg.norm(self.magnetic_field))
        return torque + sum(coil.dipole_limit for coil in self.magnetorquers) * field

    def columns(self, stream: str) -> tuple[str, ...]:
        """Column names of a canonical stream on this machine.

        Raises:
            UnknownName: no such stream.
        """
        fixed = stream_named(stream).columns
        if fixed:
            return fixed
        if "wheel" in stream:
            return tuple(wheel.name for wheel in self.wheels)
        if "stage" in stream:
            return tuple(stage.name for stage in self.stages)
        if "gimbal" in stream:
            return tuple(gimbal.name for gimbal in self.gimbals)
        if "thruster" in stream:
            return tuple(thruster.name for thruster in self.thrusters)
        if "joint" in stream:
            return (self.base.joint,) if self.base.kind == "hinge" else ()
        return ()


def files_of(platform: Platform) -> dict[str, Path]:
    """platform.toml, calibration.toml, the MJCF and the files that it names, by their way from the
    folder.

    Whatever else lies there (notes, pictures, logs, campaigns) has no say in what is flown. A file
    counts as named if an attribute of the MJCF, or of one that it includes, ends in its name:
    where MuJoCo looks for it depends on directories that several elements state, and one too many
    does no harm.
    """
    below = [path for path in platform.folder.rglob("*") if path.is_file()]
    result = {platform.folder / "platform.toml", platform.model_path}
    result |= {path for path in below if path == platform.folder / "calibration.toml"}
    unread = [platform.model_path]
    while unread:
        named = _names_in(unread.pop())
        more = {path for path in below if path.name in named} - result
        result |= more
        unread += more
    return {path.relative_to(platform.folder).as_posix(): path for path in sorted(result)}


def _names_in(path: Path) -> set[str]:
    """Last parts of what the attributes of an MJCF say; none where it is a mesh or a picture."""
    try:
        # `load_platform` has refused document types, in which entities could grow without bound
        elements = list(ElementTree.parse(path).iter())
    except (ElementTree.ParseError, LookupError, ValueError):  # the last two: its encoding
        return set()
    # a Windows path may be written with strokes of either kind
    return {
        PureWindowsPath(value).name for element in elements for value in element.attrib.values()
    }
