"""Effects on sensors: bias, scale, mounting, drift and lag; and on the clocks of streams."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from twin.effects.effect import Domain, parameter
from twin.effects.on_body import BodyEffect, State, TorqueLaw
from twin.effects.on_series import (
    Array,
    BiasEffect,
    DelayEffect,
    Live,
    Order,
    ReadingEffect,
    Recursion,
    ScaleEffect,
    SeriesEffect,
    VibrationEffect,
    with_time,
    with_value,
)
from twin.platform import Platform
from twin.recording.environment import EARTH_RATE
from twin.rotation import conjugate, cross, from_rotation_vector, multiply, rotate
from twin.signals import Samples


@dataclass(frozen=True)
class _Bias(BiasEffect):
    """A constant error of each axis of one sensor."""

    domain = Domain.sensor
    bias: tuple[float, ...]

    def error(self) -> Array:
        return np.array(self.bias)


@dataclass(frozen=True)
class _Scale(ScaleEffect):
    """An error of the scale of each axis of one sensor."""

    domain = Domain.sensor
    error: tuple[float, ...]

    def gain(self, platform: Platform) -> Array:
        return 1.0 + np.array(self.error)


@dataclass(frozen=True)
class AccelerometerBias(_Bias):
    """It shows a constant too much: x + b."""

    name = "accelerometer_bias"
    observable = "the length of the measured gravity changes with attitude"
    streams = ("accelerometer", "attitude")
    acts_on = "accelerometer"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "m/s^2",
        (0.05, -0.03, 0.02),
        source="ASSUMED: 5 mg, usual for MEMS",
        low=-50.0,
        high=50.0,
    )


@dataclass(frozen=True)
class AccelerometerScale(_Scale):
    """Each axis shows (1 + e) of what it should."""

    name = "accelerometer_scale"
    observable = "the measured gravity has another length on each axis"
    streams = ("accelerometer", "attitude")
    acts_on = "accelerometer"

    error: tuple[float, ...] = parameter(
        "error of each axis's scale",
        "1",
        (5e-3, -3e-3, 4e-3),
        source="ASSUMED: half a percent, usual for MEMS",
        low=-0.9,
        high=0.9,
    )


@dataclass(frozen=True)
class AttitudeMisalignment(SeriesEffect):
    """Its axes are the body's turned by phi: it shows q exp(phi / 2)."""

    name = "attitude_misalignment"
    domain = Domain.sensor
    observable = "the attitude turns about other axes than the gyro"
    streams = ("attitude", "gyro")
    order = Order.geometry
    acts_on = "attitude"

    rotation: tuple[float, ...] = parameter(
        "from the body's axes to the sensor's",
        "rad",
        (0.01, -0.02, 0.015),
        source="ASSUMED: 1 deg, markers placed by eye",
        low=-3.2,
        high=3.2,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, multiply(samples.value, self._turn))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(
            samples,
            multiply(samples.value, conjugate(self._turn)),
        )

    @property
    def _turn(self) -> Array:
        return from_rotation_vector(np.array(self.rotation))


@dataclass(frozen=True)
class AttitudeReferenceTilt(SeriesEffect):
    """Its reference is the world turned by delta about level axes: it shows exp(-delta / 2) q.

    Gravity alone gives it away, which pulls along another line than the one that is shown as
    vertical; a turn about that line is a heading, and shows nowhere.
    """

    name = "attitude_reference_tilt"
    domain = Domain.sensor
    observable = "gravity pulls along a line that is fixed in the room and not the vertical shown"
    streams = ("attitude",)
    order = Order.geometry
    acts_on = "attitude"

    about_x: float = parameter(
        "from the world's axes to the reference's, about x",
        "rad",
        0.005,
        source="ASSUMED: 0.3 deg, a calibration square on a floor that is not level",
        low=-1.0,
        high=1.0,
    )
    about_y: float = parameter(
        "and about y",
        "rad",
        -0.003,
        source="ASSUMED: likewise",
        low=-1.0,
        high=1.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, multiply(conjugate(self._turn), samples.value))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, multiply(self._turn, samples.value))

    @property
    def _turn(self) -> Array:
        # numbers, or arrays with the runs of a batch in front
        x, y = np.atleast_1d(self.about_x, self.about_y)
        return from_rotation_vector(np.concatenate([x, y, np.zeros_like(x)], axis=-1))


@dataclass(frozen=True)
class EarthRotation(BodyEffect, ReadingEffect):
    """The room turns at W against inertial space: a gyro shows w + R^T W.

    In the room's axes the momentum J w + h of body and wheels then changes by -W x (J w + h)
    besides, and the body is turned by -w x J W + (J - J_wheels) (w x W). Terms in W squared, below
    1e-7 N m, and the wheels' own acceleration by w x W are left out.
    """

    name = "earth_rotation"
    domain = Domain.sensor
    observable = "the gyro shows a constant rate in the room's axes, whatever the attitude"
    streams = ("gyro", "attitude")
    reads = ("gyro",)
    exact = True

    rate: tuple[float, ...] = parameter(
        "of the room, in its axes",
        "rad/s",
        (4.7e-5, 0.0, 5.6e-5),
        source="the Earth at 50 deg of northern latitude, x to the north (WGS 84)",
        low=-EARTH_RATE,
        high=EARTH_RATE,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        if missing or platform.base.kind != "ball":
            return missing or "it needs a ball joint"
        return "rotors in gimbals are not modelled beside it" if platform.gimbals else ""

    def error(self, stream: str, position: Array, rate: Array) -> Array:
        del stream, rate
        return rotate(conjugate(position), self._room[:, None])

    def torque(self, platform: Platform) -> TorqueLaw:
        axes = np.array([wheel.axis for wheel in platform.wheels]).reshape(-1, 3)
        spin = np.array([wheel.inertia for wheel in platform.wheels])[:, None] * axes
        inertia = platform.inertia
        without_wheels = inertia - spin.T @ axes

        def law(state: State) -> Array:
            room = rotate(conjugate(state.position), self._room)
            momentum = state.rate @ inertia + state.wheel_speed @ spin
            carried = cross(room, momentum) + cross(state.rate, room @ inertia)
            return cross(state.rate, room) @ without_wheels - carried

        return law

    @property
    def _room(self) -> Array:
        # one for all runs of a batch, or one for each
        return np.reshape(self.rate, (-1, 3))


@dataclass(frozen=True)
class GyroBias(_Bias):
    """It shows a constant too much: x + b."""

    name = "gyro_bias"
    observable = "the gyro and the turning of the attitude differ by a constant"
    streams = ("gyro", "attitude")
    acts_on = "gyro"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "rad/s",
        (1e-3, -5e-4, 8e-4),
        source="004: an AHRS within 0.25 deg/s, which is 4.4e-3 rad/s",
        low=-10.0,
        high=10.0,
    )


@dataclass(frozen=True)
class GyroDrift(SeriesEffect):
    """It shows ever more too much: x + d t."""

    name = "gyro_drift"
    domain = Domain.sensor
    observable = "the gyro and the turning of the attitude differ ever more"
    streams = ("gyro", "attitude")
    order = Order.bias
    acts_on = "gyro"

    drift: tuple[float, ...] = parameter(
        "change of the bias per second, its own axes",
        "rad/s^2",
        (1e-6, -5e-7, 8e-7),
        source="ASSUMED: 0.2 deg/s in an hour of warming",
        low=-1.0,
        high=1.0,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + samples.time[..., None] * np.array(self.drift))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - samples.time[..., None] * np.array(self.drift))


@dataclass(frozen=True)
class GyroVibration(VibrationEffect):
    """It shows w + s sin(2 pi f t) + c cos(2 pi f t), its own axes: a pump shakes its mount."""

    name = "gyro_vibration"
    observable = "a line in the spectrum of the gyro that no other stream shows"
    streams = ("gyro",)
    acts_on = "gyro"

    sine: tuple[float, ...] = parameter(
        "amplitude with the sine of the time, its own axes",
        "rad/s",
        (6e-4, 4e-4, 2e-4),
        source="ASSUMED: 0.04 deg/s beside a pump",
        low=-1.0,
        high=1.0,
    )
    cosine: tuple[float, ...] = parameter(
        "amplitude with its cosine",
        "rad/s",
        (2e-4, 6e-4, 4e-4),
        source="ASSUMED: likewise",
        low=-1.0,
        high=1.0,
    )
    frequency: float = parameter(
        "of the sinusoid",
        "Hz",
        25.0,
        source="ASSUMED: a motor of 1500 turns a minute",
        low=1.0,
        high=1e4,
        amplitude=False,
    )

    def sinusoid(self) -> tuple[Array, Array, float]:
        return np.array(self.sine), np.array(self.cosine), self.frequency

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        del gravity
        return (replace(self, frequency=hertz),)


@dataclass(frozen=True)
class JointRateVibration(VibrationEffect):
    """It shows w + s sin(2 pi f t) + c cos(2 pi f t): the frame shakes, and the sensor with it."""

    name = "joint_rate_vibration"
    observable = "a line in the spectrum of the rate that no other stream shows"
    streams = ("joint_rate",)
    acts_on = "joint_rate"

    sine: float = parameter(
        "amplitude with the sine of the time",
        "rad/s",
        6e-4,
        source="ASSUMED: 0.04 deg/s beside a pump",
        low=-1.0,
        high=1.0,
    )
    cosine: float = parameter(
        "amplitude with its cosine",
        "rad/s",
        4e-4,
        source="ASSUMED: likewise",
        low=-1.0,
        high=1.0,
    )
    frequency: float = parameter(
        "of the sinusoid",
        "Hz",
        25.0,
        source="ASSUMED: a motor of 1500 turns a minute",
        low=1.0,
        high=1e4,
        amplitude=False,
    )

    def sinusoid(self) -> tuple[Array, Array, float]:
        return np.asarray(self.sine), np.asarray(self.cosine), self.frequency

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        del gravity
        return (replace(self, frequency=hertz),)


@dataclass(frozen=True)
class GyroMisalignment(SeriesEffect):
    """Its axes are the body's turned by phi: it shows R(phi)^T w."""

    name = "gyro_misalignment"
    domain = Domain.sensor
    observable = "a turn about one axis shows on the others"
    streams = ("gyro", "attitude")
    order = Order.geometry
    acts_on = "gyro"

    rotation: tuple[float, ...] = parameter(
        "from the body's axes to the sensor's",
        "rad",
        (5e-3, -3e-3, 8e-3),
        source="ASSUMED: 0.3 deg of mounting",
        low=-3.2,
        high=3.2,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, rotate(conjugate(self._turn), samples.value))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, rotate(self._turn, samples.value))

    @property
    def _turn(self) -> Array:
        return from_rotation_vector(np.array(self.rotation))


@dataclass(frozen=True)
class GyroScaleFactor(_Scale):
    """Each axis shows (1 + e) of what it should."""

    name = "gyro_scale_factor"
    observable = "the gyro and the turning of the attitude differ in proportion to the rate"
    streams = ("gyro", "attitude")
    acts_on = "gyro"

    error: tuple[float, ...] = parameter(
        "error of each axis's scale",
        "1",
        (5e-3, -3e-3, 4e-3),
        source="ASSUMED: half a percent, usual for MEMS",
        low=-0.9,
        high=0.9,
    )


@dataclass(frozen=True)
class InclinometerBias(_Bias):
    """It shows a constant too much: x + b."""

    name = "inclinometer_bias"
    observable = "it and the attitude differ by a constant"
    streams = ("inclinometer", "attitude")
    acts_on = "inclinometer"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "rad",
        (2e-3, -1e-3),
        source="ASSUMED: 0.1 deg of mounting",
        low=-1.0,
        high=1.0,
    )


@dataclass(frozen=True)
class InclinometerMisalignment(SeriesEffect):
    """Its axes are the body's turned by phi: it shows the elevations of its own axes.

    From roll and pitch to the vertical in body axes, to that in the sensor's, and back; of a body
    that stands less than upright, the vertical's z is taken as positive.
    """

    name = "inclinometer_misalignment"
    domain = Domain.sensor
    observable = "roll shows in pitch, and level reads as tilted"
    streams = ("inclinometer", "attitude")
    order = Order.geometry
    acts_on = "inclinometer"

    rotation: tuple[float, ...] = parameter(
        "from the body's axes to the sensor's",
        "rad",
        (5e-3, -3e-3, 0.02),
        source="ASSUMED: 0.3 deg of mounting, 1 deg of heading",
        low=-1.5,
        high=1.5,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        turn = conjugate(from_rotation_vector(np.array(self.rotation)))
        return with_value(samples, _elevations(rotate(turn, _vertical(samples.value))))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        turn = from_rotation_vector(np.array(self.rotation))
        return with_value(samples, _elevations(rotate(turn, _vertical(samples.value))))


def _vertical(elevation: Array) -> Array:
    """The vertical in the sensor's axes, from roll = asin(R_zy), pitch = -asin(R_zx)."""
    y, x = np.sin(elevation[..., 0]), -np.sin(elevation[..., 1])
    return np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)


def _elevations(vertical: Array) -> Array:
    x, y = np.clip(vertical[..., 0], -1.0, 1.0), np.clip(vertical[..., 1], -1.0, 1.0)
    return np.stack([np.arcsin(y), -np.arcsin(x)], axis=-1)


@dataclass(frozen=True)
class MagnetometerBias(_Bias):
    """It shows a constant too much: x + b."""

    name = "magnetometer_bias"
    observable = "the length of the measured field changes with attitude"
    streams = ("magnetometer", "attitude")
    acts_on = "magnetometer"

    bias: tuple[float, ...] = parameter(
        "constant error, its own axes",
        "T",
        (2e-6, -1e-6, 3e-6),
        source="ASSUMED: a twentieth of the field of the Earth",
        low=-1.0,
        high=1.0,
    )


@dataclass(frozen=True)
class MagnetometerScale(_Scale):
    """Each axis shows (1 + e) of what it should."""

    name = "magnetometer_scale"
    observable = "the measured field has another length on each axis"
    streams = ("magnetometer", "attitude")
    acts_on = "magnetometer"

    error: tuple[float, ...] = parameter(
        "error of each axis's scale",
        "1",
        (0.02, -0.03, 0.01),
        source="ASSUMED: a few percent",
        low=-0.9,
        high=0.9,
    )


@dataclass(frozen=True)
class SensorLag(SeriesEffect):
    """A first-order low-pass: T dy/dt + y = x, from y = x at the first sample.

    Between samples x is taken as a straight line, so that `undo` is its exact inverse. On slow
    signals it is a clock lag of T.
    """

    name = "sensor_lag"
    domain = Domain.sensor
    observable = "the stream comes late and its fast parts are smaller"
    streams = ("gyro", "attitude")
    order = Order.filter
    takes = "stream"

    constant: float = parameter(
        "time constant",
        "s",
        0.02,
        source="ASSUMED: a low-pass of 8 Hz",
        low=0.0,
        high=100.0,
    )

    def unfit(self, platform: Platform) -> str:
        missing = super().unfit(platform)
        if missing or self.target != "attitude":
            return missing
        return "an attitude is no number to be filtered; use clock_lag:attitude"

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        return Recursion(self._forward)

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return Recursion(self._backward)(samples)

    def _forward(self, step: Array, before: Array, shown: Array, current: Array) -> Array:
        decay, first, second = self._weights(step)
        return decay * shown + first * before + second * current

    def _backward(self, step: Array, shown: Array, before: Array, current: Array) -> Array:
        decay, first, second = self._weights(step)
        return (current - decay * shown - first * before) / second

    def _weights(self, step: Array) -> tuple[Array, Array, Array]:
        """Of the last output, the last input and this input, for x a straight line."""
        if self.constant == 0.0:
            return np.zeros_like(step), np.zeros_like(step), np.ones_like(step)
        ratio = step / self.constant
        decay = np.exp(-ratio)
        mean = -np.expm1(-ratio) / np.where(ratio > 0.0, ratio, 1.0)
        return decay, mean - decay, 1.0 - mean


@dataclass(frozen=True)
class ClockDrift(SeriesEffect):
    """Its clock runs fast by d: a value true at t is stamped t (1 + d)."""

    name = "clock_drift"
    domain = Domain.clock
    observable = "the stream falls behind the others, or runs ahead, in proportion to time"
    streams = ("gyro", "attitude")
    order = Order.delay
    takes = "stream"

    drift: float = parameter(
        "rate error of its clock",
        "s/s",
        5e-05,
        source="ASSUMED: 50 ppm, a plain quartz",
        low=-0.5,
        high=0.5,
    )

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time * (1.0 + self.drift))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time / (1.0 + self.drift))


@dataclass(frozen=True)
class ClockLag(DelayEffect):
    """A value stamped t was true at t - tau; positive: the data come late."""

    name = "clock_lag"
    domain = Domain.clock
    observable = "the stream follows the others after a constant time"
    streams = ("gyro", "attitude")
    takes = "stream"

    lag: float = parameter(
        "of the stream behind the others",
        "s",
        0.17,
        source="002: +0.17 s on wheel_speed",
        low=-60.0,
        high=60.0,
    )

    def lateness(self) -> float:
        return self.lag
