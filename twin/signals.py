"""What travels round the loop: Reading, Estimate, Target, Command; and the streams' units.

Every array has the batch axis n first: a single run is n = 1. SI and radians throughout; frames
and signs as in docs/design.md, section 4.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import UnknownName

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_XYZ = ("x", "y", "z")
_WXYZ = ("w", "x", "y", "z")


@dataclass(frozen=True)
class Stream:
    """What a stream's columns are."""

    unit: str
    columns: tuple[str, ...] = ()
    """Column names; empty: one column a part (wheel, stage, joint axis, thruster), by its name."""
    frame: str = ""


STREAMS: dict[str, Stream] = {
    "gyro": Stream("rad/s", _XYZ, "body"),
    "attitude": Stream("1", _WXYZ, "world from body"),
    "inclinometer": Stream("rad", ("roll", "pitch")),
    "accelerometer": Stream("m/s^2", _XYZ, "body"),
    "magnetometer": Stream("T", _XYZ, "body"),
    "position": Stream("m", _XYZ, "world"),
    "velocity": Stream("m/s", _XYZ, "world"),
    "heading": Stream("rad", ("heading",), "about the world's z"),
    "heading_rate": Stream("rad/s", ("heading",), "about the world's z"),
    "wheel_speed": Stream("rad/s"),
    "gimbal_angle": Stream("rad"),
    "gimbal_rate": Stream("rad/s"),
    "stage_position": Stream("m"),
    "joint_angle": Stream("rad"),
    "joint_rate": Stream("rad/s"),
    "magnetic_field": Stream("T", _XYZ, "world"),
    "air_pressure": Stream("Pa", ("value",)),
    "floating": Stream("1", ("value",)),
    "gas_pressure": Stream("Pa", ("value",)),
    "temperature": Stream("K", ("value",)),
    "battery_voltage": Stream("V", ("value",)),
    "command_wheel_torque": Stream("N m"),
    "command_wheel_speed": Stream("rad/s"),
    "command_stage_position": Stream("m"),
    "command_dipole": Stream("A m^2", _XYZ, "body"),
    "command_gimbal_rate": Stream("rad/s"),
    "command_thruster": Stream("N"),
    "command_joint_torque": Stream("N m"),
    "command_wheel_duty": Stream("1"),
    "truth_attitude": Stream("1", _WXYZ, "world from body"),
    "truth_rate": Stream("rad/s", _XYZ, "body"),
    "truth_wheel_speed": Stream("rad/s"),
    "truth_stage_position": Stream("m"),
    "truth_stage_speed": Stream("m/s"),
    "truth_gimbal_angle": Stream("rad"),
    "truth_gimbal_rate": Stream("rad/s"),
    "truth_position": Stream("m", _XYZ, "world"),
    "truth_velocity": Stream("m/s", _XYZ, "world"),
    "truth_heading": Stream("rad", ("value",)),
    "truth_gas_mass": Stream("kg", ("value",)),
    "truth_joint_angle": Stream("rad"),
    "truth_joint_rate": Stream("rad/s"),
    "truth_center_of_mass_offset": Stream("kg m", _XYZ, "body"),
    "truth_inertia": Stream("kg m^2", ("xx", "yy", "zz", "xy", "xz", "yz"), "body"),
    "estimate_attitude": Stream("1", _WXYZ, "world from body"),
    "estimate_rate": Stream("rad/s", _XYZ, "body"),
    "estimate_gyro_bias": Stream("rad/s", _XYZ, "body"),
    "estimate_position": Stream("m", _XYZ, "world"),
    "estimate_velocity": Stream("m/s", _XYZ, "world"),
    "estimate_attitude_sigma": Stream("rad", _XYZ, "world"),
    "estimate_gyro_bias_sigma": Stream("rad/s", _XYZ, "body"),
    "estimate_center_of_mass_offset": Stream("kg m", _XYZ, "body"),
    "estimate_center_of_mass_offset_sigma": Stream("kg m", _XYZ, "body"),
    "estimate_vertical_offset": Stream("m", ("z",), "body"),
    "estimate_vertical_offset_sigma": Stream("m", ("z",), "body"),
    "reference_attitude": Stream("1", _WXYZ, "world from body"),
    "reference_rate": Stream("rad/s", _XYZ, "body"),
    "reference_position": Stream("m", _XYZ, "world"),
    "reference_velocity": Stream("m/s", _XYZ, "world"),
    "loop_time": Stream("s", ("late", "read", "estimate", "control", "write", "record")),
    "relative_attitude": Stream("1", _WXYZ, "the other's body from body"),
    "relative_rate": Stream("rad/s", _XYZ, "body"),
    "relative_position": Stream("m", _XYZ, "world"),
    "relative_velocity": Stream("m/s", _XYZ, "world"),
    "relative_age": Stream("s", ("value",)),
    "truth_relative_attitude": Stream("1", _WXYZ, "the other's body from body"),
    "truth_relative_rate": Stream("rad/s", _XYZ, "body"),
    "truth_relative_position": Stream("m", _XYZ, "world"),
    "truth_relative_velocity": Stream("m/s", _XYZ, "world"),
}
"""The canonical streams (docs/design.md 4.2). `wanted_*` has the unit of its `command_*`, and
`relative_*_to_NAME` is the stream before `_to_`, towards the machine of that name."""

OF_MOTION = ("attitude", "inclinometer", "gyro", "joint_angle", "joint_rate")
"""Streams that show how the base moves."""

POSITIONS = ("stage_position", "gimbal_angle")
"""Measured parts from where laws begin: none begins before they were seen. Wheel speeds may come
once a second, and nobody waits for the first: nothing would hold a floating body meanwhile."""

TOWARDS = "_to_"
"""Between the name of a relative stream and that of the other machine."""
PREDICTED, RESIDUAL = "predicted_", "residual_"
"""Before the name of a stream: what a model makes of it, and what that leaves."""
DERIVED = (
    *("command_", "wanted_", "truth_", "estimate_", "reference_", "loop_", "relative_"),
    *(PREDICTED, RESIDUAL),
)
"""Streams that no sensor measured begin so: their scatter is no noise."""


LOGGED = tuple(
    name for name in STREAMS if not name.startswith(DERIVED) or name.startswith("command_")
)
"""Streams that a log of a lab may have: what was measured, and what was commanded."""


def stream_named(name: str) -> Stream:
    """The canonical stream of that name.

    Raises:
        UnknownName: no such stream.
    """
    key = "command_" + name.removeprefix("wanted_") if name.startswith("wanted_") else name
    if key.removeprefix("truth_").startswith("relative_"):
        key = key.partition(TOWARDS)[0]
    if key not in STREAMS:
        raise UnknownName("stream", name, STREAMS)
    return STREAMS[key]


@dataclass(frozen=True, slots=True)
class Samples:
    """All samples of one stream that arrived between two ticks."""

    value: Array
    """Shape (n, m, k)."""
    time: Array
    """When each value was true, host seconds, shape (n, m)."""
    valid: Mask
    """False: this run lost the sample (dropout, stopped run), shape (n, m)."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Every sample that arrived since the last tick, stream by stream.

    A stream without a new sample is absent. Several samples stand in the order of their times.
    """

    time: float
    """The tick [s]."""
    streams: Mapping[str, Samples]


def valid_rows(reading: Reading, stream: str) -> list[tuple[float, Array]]:
    """Times [s] and values (k,) of what is valid of a stream in the reading of a single run."""
    samples = reading.streams.get(stream)
    if samples is None:
        return []
    good = np.flatnonzero(samples.valid[0])
    return [(float(samples.time[0, i]), samples.value[0, i]) for i in good]


class Quantity(NamedTuple):
    """Something that an estimator states, with its standard deviation.

    It is recorded as the streams `estimate_NAME` and `estimate_NAME_sigma`.
    """

    value: Array | None
    """(n, k); None where `Estimate` has it by that name."""
    sigma: Array
    """(n, k) 1 sigma; of an attitude (n, 3) about the room's axes [rad]."""
    unit: str
    """Of both, in SI."""
    columns: tuple[str, ...]
    """Names of the k columns."""


@dataclass(frozen=True, slots=True)
class Received:
    """The newest message of another machine that has come over the radio."""

    time: Array
    """(n,) when its content was true [s]; NaN in a run that has received none yet."""
    attitude: Array
    """(n, 4), world from body, as that machine estimates it."""
    rate_body: Array
    """(n, 3) [rad/s], in that machine's body axes."""
    position: Array | None = None
    """(n, 3) of its CR in the room of the machine that has received it [m]; None where either of
    them stays in its place."""
    velocity: Array | None = None
    """(n, 3) [m/s], world; with the position."""
    extra: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """What its law adds (`Controller.message`), (n, k) each."""

    @property
    def valid(self) -> Mask:
        """(n,) whether a message has come."""
        return np.isfinite(self.time)


@dataclass(slots=True)
class Estimate:
    """What is believed about the machine at a tick.

    Parts the machine does not have are arrays of width zero.
    """

    time: float
    attitude: Array
    """(n, 4), world from body."""
    rate_body: Array
    """(n, 3) [rad/s]."""
    wheel_speed: Array
    """(n, wheels) [rad/s]."""
    stage_position: Array
    """(n, stages) [m]."""
    joint_angle: Array
    """(n, base-joint axes of a hinge) [rad]; width zero on a ball joint."""
    joint_rate: Array
    """(n, base-joint axes of a hinge) [rad/s]."""
    gyro_bias: Array
    """(n, 3) [rad/s]."""
    valid: Mask
    """(n,): False until the run's attitude, or joint angle, has been seen, and the positions of its
    stages and gimbals as far as the machine measures them."""
    gimbal_angle: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n, gimbals) [rad]; empty where there is none."""
    covariance: Array | None = None
    """(n, 6, 6) of attitude error [rad, body] and gyro bias [rad/s], where there is one."""
    oriented: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """(n,): whether attitude or joint angle has been seen; for estimators."""
    awaited: Mapping[str, Mask] = field(default_factory=dict[str, Mask])
    """Measured positions -> (n,) runs of which no sample has come yet; empty once all have."""
    position: Array | None = None
    """(n, 3) of the CR in the room [m], NaN in a run until it has been seen; None: of a machine
    that stays in its place, or whose place no camera shows."""
    velocity: Array | None = None
    """(n, 3) likewise [m/s]."""
    disturbance: Array | None = None
    """(n, 3) acceleration of the CR that no command explains, likewise [m/s^2]."""
    received: Mapping[str, Received] = field(default_factory=dict[str, Received])
    """By the name of each other machine of the run that this one has heard; the loop sets it."""

    def at(self, time: float) -> "Estimate":
        """The same estimate, stamped `time`."""
        return replace(self, time=time)

    def quantities(self) -> dict[str, Quantity]:
        """What it states beside the motion, or of it with a standard deviation, by name."""
        return {}


@dataclass(frozen=True, slots=True)
class Target:
    """Where the reference wants the body to be; shapes broadcast against (n, ...)."""

    attitude: Array
    """(4,) or (n, 4), world from body."""
    rate_body: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) or (n, 3) [rad/s], in the target's own body frame."""
    acceleration_body: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) or (n, 3) [rad/s^2], in the target's own body frame."""
    position: Array | None = None
    """(3,) or (n, 3) of the CR in the room [m]; None: the reference asks for no place."""
    velocity: Array | None = None
    """(3,) or (n, 3) [m/s], world; given with the position."""
    acceleration: Array | None = None
    """(3,) or (n, 3) [m/s^2], world; given with the position."""


Command = dict[str, Array]
"""Command stream (`command_wheel_torque`, ...) -> (n, k); what is absent keeps its last value."""


class Tick(NamedTuple):
    """One round of the loop, as its observers see it.

    Nobody may write to its arrays afterwards: they are read when many ticks have come together.
    """

    reading: Reading
    estimate: Estimate
    target: Target
    wanted: Command
    applied: Command
    """What was really applied, after limits."""
    truth: Mapping[str, Samples]
    """A simulation's true states, one sample each; empty on hardware."""
    cycle: Array | None = None
    """(6,) what it cost, as `loop_time` has it; None where time is simulated."""
    relative: Mapping[str, Samples] = {}
    """Attitude, rate and place relative to each other machine of the run, as `relative_*_to_NAME`
    by the estimates and `truth_relative_*_to_NAME` in a simulation, one sample each."""
