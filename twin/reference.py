"""Where the body should be: an attitude, a place, or both, and the text that names one.

`hold:0,5,0`, `slew:0,0,90@1`, `multisine:5` and `sine:x,10@20s` are what a command line takes, in
degrees, the path of a table, and `place:0,0` or `move:1,0@0.05` in metres; `slew:0,0,90+move:1,0`
is both. See `parse_reference`.
"""

import abc
import math
import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.manoeuvre import (
    WAVES,
    AttitudeTable,
    Wave,
    is_table,
    is_wave,
    parse_waves,
    quintic,
)
from twin.rotation import from_euler_zyx, from_rotation_vector, to_rotation_vector
from twin.signals import Target

Array = NDArray[np.float64]

GRAMMAR = (
    "hold, hold:ROLL,PITCH,YAW, slew:ROLL,PITCH,YAW[@RATE], multisine[:AMPLITUDE[@FREQUENCY]], "
    f"{WAVES}, or a table (FILE.csv, FILE.parquet); of a machine that travels place:X,Y or "
    "move:X,Y[@ACCELERATION[,SPEED]], in metres and seconds, or both with + between"
)
"""Angles in degrees, rates in degrees per second, frequencies in hertz; see `twin.manoeuvre`."""


class Reference(abc.ABC):
    """A motion to follow; rate and acceleration are the exact derivatives of the attitude."""

    @abc.abstractmethod
    def at(self, time: float | Array) -> Target:
        """The target at `time` [s]; an array of times (...) gives attitude (..., 4), rate (..., 3).

        Before 0 it is what it is at 0.
        """


@dataclass(frozen=True)
class Hold(Reference):
    """One attitude, for ever: intrinsic z-y'-x'' angles."""

    roll: float = 0.0
    """[rad]."""
    pitch: float = 0.0
    """[rad]."""
    yaw: float = 0.0
    """[rad]."""

    @cached_property
    def attitude(self) -> Array:
        """(4,)."""
        return from_euler_zyx(np.array(self.yaw), np.array(self.pitch), np.array(self.roll))

    def at(self, time: float | Array) -> Target:
        """The attitude, at rest."""
        many = np.shape(time)
        rest = np.zeros((*many, 3))
        return Target(np.broadcast_to(self.attitude, (*many, 4)), rest, rest)


@dataclass(frozen=True)
class Slew(Reference):
    """From level to an attitude along the eigenaxis, rest to rest, then hold.

    The angle follows s(u) = 10 u^3 - 15 u^4 + 6 u^5 of the total, u = t / duration: the quintic
    whose rate and acceleration vanish at both ends. The duration is what keeps the rate below
    `rate`: 15/8 angle / rate.
    """

    roll: float
    """[rad]."""
    pitch: float
    """[rad]."""
    yaw: float
    """[rad]."""
    rate: float = math.radians(1.0)
    """Highest rate on the way [rad/s]."""

    @cached_property
    def rotation_vector(self) -> Array:
        """(3,) from level to the end [rad]."""
        return to_rotation_vector(Hold(self.roll, self.pitch, self.yaw).attitude)

    @cached_property
    def duration(self) -> float:
        """[s]; 1 s where there is nowhere to go."""
        return 1.875 * float(np.linalg.norm(self.rotation_vector)) / self.rate or 1.0

    def at(self, time: float | Array) -> Target:
        """On the way, or there. The axis is fixed, so the derivatives are those of the angle."""
        share, rate, acceleration = quintic(time, self.duration)
        return Target(
            from_rotation_vector(share[..., None] * self.rotation_vector),
            rate[..., None] * self.rotation_vector,
            acceleration[..., None] * self.rotation_vector,
        )


@dataclass(frozen=True)
class Multisine(Reference):
    """Roll, pitch and yaw swing together, three tones each, never beyond `amplitude`.

    angle_i(t) = amplitude s(t / ramp) sum_k a_k sin(2 pi f_ik t + p_ik), sum_k a_k = 1

    The frequencies are `base_frequency` times square roots of square-free numbers: no two have a
    rational ratio, so the motion never repeats, and each axis can be told from the others. The
    quintic ramp s lets it start level, at rest, without a step in rate or acceleration.
    At 5 deg and 10 mHz no axis exceeds 0.8 deg/s and 0.17 deg/s^2: below 0.2 N m s in a
    body of 12 kg m^2, which leaves a small wheel's momentum to what gravity puts in.
    """

    amplitude: float = math.radians(5.0)
    """Largest roll, pitch and yaw [rad]."""
    base_frequency: float = 0.01
    """[Hz]."""
    ramp: float = 20.0
    """Until the full amplitude [s]."""

    def at(self, time: float | Array) -> Target:
        """Attitude of the three Euler angles and its derivatives."""
        share, share_1, share_2 = (s[..., None] for s in quintic(time, self.ramp))
        omega = 2.0 * np.pi * self.base_frequency * _TONES
        phase = omega * np.maximum(time, 0.0)[..., None, None] + _PHASES
        sine, cosine = _WEIGHTS * np.sin(phase), _WEIGHTS * np.cos(phase)
        wave = np.sum(sine, axis=-1)
        wave_1 = np.sum(omega * cosine, axis=-1)
        wave_2 = -np.sum(omega**2 * sine, axis=-1)
        return _target(
            self.amplitude * share * wave,
            self.amplitude * (share_1 * wave + share * wave_1),
            self.amplitude * (share_2 * wave + 2.0 * share_1 * wave_1 + share * wave_2),
        )


@dataclass(frozen=True)
class Move(Reference):
    """From the room's origin to a place along a straight line, rest to rest, then hold; level.

    The fastest such motion: speed grows at `acceleration` to `speed`, is held, and falls likewise.
    Where the way d is too short for that speed, half of it is gained and half lost, in
    2 sqrt(d / a) altogether.
    """

    x: float
    """[m]."""
    y: float
    """[m]."""
    acceleration: float = 0.01
    """[m/s^2]."""
    speed: float = math.inf
    """Highest on the way [m/s]."""

    @cached_property
    def distance(self) -> float:
        """[m]."""
        return math.hypot(self.x, self.y)

    @cached_property
    def peak(self) -> float:
        """Highest speed that is reached [m/s]."""
        return min(self.speed, math.sqrt(self.acceleration * self.distance))

    @cached_property
    def duration(self) -> float:
        """[s]."""
        if not self.distance:
            return 0.0
        return self.distance / self.peak + self.peak / self.acceleration

    def at(self, time: float | Array) -> Target:
        """On the way, or there; the acceleration is the one that follows."""
        now = np.clip(np.asarray(time, dtype=np.float64), 0.0, self.duration)
        left, ramp = self.duration - now, self.peak / self.acceleration
        ends = np.minimum(now, left)  # from either end the motion looks the same
        speed = self.acceleration * np.minimum(ends, ramp)
        gone = speed * (ends - 0.5 * np.minimum(ends, ramp))
        way = np.where(now < left, gone, self.distance - gone)
        pushed = (ends < ramp) & (np.asarray(time) >= 0.0) & (left > 0.0)
        push = np.where(pushed, np.where(now < left, self.acceleration, -self.acceleration), 0.0)
        along = np.array([self.x, self.y, 0.0]) / (self.distance or 1.0)
        return replace(
            Hold().at(time),
            position=way[..., None] * along,
            velocity=speed[..., None] * along,
            acceleration=push[..., None] * along,
        )


@dataclass(frozen=True)
class Place(Reference):
    """One place, for ever; level."""

    x: float = 0.0
    """[m]."""
    y: float = 0.0
    """[m]."""

    def at(self, time: float | Array) -> Target:
        """The place, at rest."""
        rest = np.zeros((*np.shape(time), 3))
        position = rest + np.array([self.x, self.y, 0.0])
        return replace(Hold().at(time), position=position, velocity=rest, acceleration=rest)


@dataclass(frozen=True)
class AttitudeAndPlace(Reference):
    """The attitude of one reference in the place of another."""

    attitude: Reference
    place: Reference

    def at(self, time: float | Array) -> Target:
        """Both at that time."""
        where = self.place.at(time)
        return replace(
            self.attitude.at(time),
            position=where.position,
            velocity=where.velocity,
            acceleration=where.acceleration,
        )


_TONES = np.sqrt([[1.0, 5.0, 10.0], [2.0, 6.0, 11.0], [3.0, 7.0, 13.0]])
_WEIGHTS = np.array([0.5, 0.3, 0.2])
# Quadratic phases (Schroeder 1970) keep the tones' peaks apart.
_PHASES = np.pi * np.arange(9.0).reshape(3, 3) ** 2 / 9.0


@dataclass(frozen=True)
class Waves(Reference):
    """Roll, pitch and yaw (x, y, z) follow sums of sines, chirps and square waves from rest."""

    waves: tuple[Wave, ...]
    """Amplitudes in rad."""

    def at(self, time: float | Array) -> Target:
        """Attitude of the three Euler angles and its derivatives."""
        angles = np.zeros((3, *np.shape(time), 3))
        for wave in self.waves:
            for order, values in enumerate(wave.motion(time)):
                angles[order, ..., wave.axis] += values
        return _target(*angles)


@dataclass(frozen=True)
class Tabulated(Reference):
    """The motion of a table, held before its first and after its last row."""

    table: AttitudeTable

    def at(self, time: float | Array) -> Target:
        """As interpolated (`twin.manoeuvre.AttitudeTable`)."""
        return Target(*self.table.at(time))


def parse_reference(text: str) -> Reference:
    """The reference that a command line names; see `GRAMMAR`.

    Raises:
        UsageError: it names none; says what would.
        LogError: a table that cannot be read, with its line.
    """
    if is_table(text):
        return Tabulated(AttitudeTable.read(Path(text)))
    parts = re.split(r"\+(?=[a-z])", text)
    places = [part for part in parts if part.startswith(("place:", "move:"))]
    if len(parts) > 1 and places:
        attitude = "+".join(part for part in parts if part not in places)
        if len(places) == 1 and attitude:
            return AttitudeAndPlace(parse_reference(attitude), parse_reference(places[0]))
    if len(parts) > 1 and (places or not is_wave(text)):
        raise UsageError(f"reference {text!r} is no attitude + one place; use {GRAMMAR}")
    kind, _, rest = text.partition(":")
    if kind == "place":
        return Place(*_numbers(text, rest, count=2))
    if kind == "move":
        return _move(text, rest)
    if text == "hold":
        return Hold()
    if kind == "hold":
        return Hold(*_angles(text, rest, count=3))
    if text == "multisine":
        return Multisine()
    if kind == "multisine":
        size, at, pace = rest.partition("@")
        (amplitude,) = _angles(text, size, count=1)
        if not 0.0 <= amplitude < np.pi / 2.0:
            raise UsageError(f"reference {text!r}: the amplitude must lie between 0 and 90 deg")
        if not at:
            return Multisine(amplitude)
        (frequency,) = _numbers(text, pace, count=1)
        if frequency <= 0.0:
            raise UsageError(f"reference {text!r}: the frequency must be above 0 Hz")
        return Multisine(amplitude, base_frequency=frequency)
    if kind == "slew":
        attitude, at, rate = rest.partition("@")
        angles = _angles(text, attitude, count=3)
        if not at:
            return Slew(*angles)
        (limit,) = _angles(text, rate, count=1)
        if limit <= 0.0:
            raise UsageError(f"reference {text!r}: the rate must be above 0 deg/s")
        return Slew(*angles, rate=limit)
    if is_wave(text):
        return _waves(text)
    raise UsageError(f"no reference named {text!r}; use {GRAMMAR}")


def _move(text: str, rest: str) -> Move:
    where, at, pace = rest.partition("@")
    x, y = _numbers(text, where, count=2)
    if not at:
        return Move(x, y)
    limits = _numbers(text, pace, count=pace.count(",") + 1)
    if len(limits) > 2 or min(limits) <= 0.0:
        raise UsageError(
            f"reference {text!r}: {pace!r} should be an acceleration above 0 m/s^2, and a highest "
            "speed above 0 m/s if it is limited"
        )
    return Move(x, y, limits[0], limits[1] if len(limits) == 2 else math.inf)


def _waves(text: str) -> Waves:
    waves = parse_waves(text, "reference")
    swings = np.zeros(3)
    for wave in waves:
        swings[wave.axis] += abs(wave.amplitude)
    if swings.max() >= 90.0:
        axis = "xyz"[int(np.argmax(swings))]
        raise UsageError(
            f"reference {text!r}: it swings by {swings.max():g} deg about {axis}, and Euler angles "
            "end at 90 deg; give smaller amplitudes"
        )
    return Waves(tuple(replace(wave, amplitude=math.radians(wave.amplitude)) for wave in waves))


def _angles(text: str, numbers: str, count: int) -> list[float]:
    return [math.radians(number) for number in _numbers(text, numbers, count)]


def _numbers(text: str, numbers: str, count: int) -> list[float]:
    try:
        values = [float(number) for number in numbers.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        wanted = "one number" if count == 1 else f"{count} numbers with commas between"
        raise UsageError(f"reference {text!r}: {numbers!r} should be {wanted}; use {GRAMMAR}")
    return values


def _target(angle: Array, rate: Array, acceleration: Array) -> Target:
    """Of (roll, pitch, yaw) and their derivatives, shape (..., 3)."""
    roll, pitch, yaw = angle[..., 0], angle[..., 1], angle[..., 2]
    roll_1, pitch_1, yaw_1 = rate[..., 0], rate[..., 1], rate[..., 2]
    roll_2, pitch_2, yaw_2 = acceleration[..., 0], acceleration[..., 1], acceleration[..., 2]
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    # Across the roll axis a turn about y' and z'' shows as (across, along), turned by roll.
    along, along_1 = yaw_1 * cp, yaw_2 * cp - yaw_1 * pitch_1 * sp
    rate_y, rate_z = pitch_1 * cr + along * sr, along * cr - pitch_1 * sr
    return Target(
        from_euler_zyx(yaw, pitch, roll),
        np.stack([roll_1 - yaw_1 * sp, rate_y, rate_z], axis=-1),
        np.stack(
            [
                roll_2 - yaw_2 * sp - yaw_1 * pitch_1 * cp,
                pitch_2 * cr + along_1 * sr + roll_1 * rate_z,
                along_1 * cr - pitch_2 * sr - roll_1 * rate_y,
            ],
            axis=-1,
        ),
    )
