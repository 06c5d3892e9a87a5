"""Whether a sample that passed its link's check can be believed: one layer for every device.

A weak checksum lets corrupt values through, some devices have none, and a broken sensor sends
messages that are perfect. `SampleChecks` holds each value against what its sensor can measure:
finite, in range, of unit length, within a step of the one before, not too old, and not the same
for longer than its noise allows. `MotionAgreement` holds streams that see the same motion against
each other: a stream that stands still is told by value while another moves, whatever its stamps.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.plant.devices.device import Sample, StreamLimits
from twin.platform import Platform, Sensor
from twin.rotation import (
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    to_rotation_vector,
)
from twin.signals import Reading, valid_rows

Array = NDArray[np.float64]

UNIT_LENGTH = 0.01
"""A quaternion's length may be off by this."""

_SIGMAS = 8.0
"""Of a sensor's noise, allowed in a difference: two samples at 100 Hz for a year differ by less."""

_REPEATS = 10
"""A value that its noise should change repeats no more often: a board may send one several
times."""

_CHANCE = 1e-15
"""At most with this probability does a sound sensor repeat itself until it is called frozen."""

_OLD = 1.0
"""A sample may be older on arrival than its latency and two of its periods by this [s]."""

_TURNS = 10.0
"""A body's rate may change by so many times what its actuators and gravity can do: a hand."""

_HAND = 5.0
"""And by this in any case [rad/s^2]."""


def sensor_limits(platform: Platform, stream: str, resolution: float = 0.0) -> StreamLimits:
    """What the values of a machine's stream can be, by its sensor.

    Args:
        platform: the machine.
        stream: one of its sensors'.
        resolution: of the line, if that is coarser than the sensor [SI].
    """
    sensor = platform.sensors[stream]
    step = max(sensor.resolution, resolution)
    scatter = math.sqrt(2.0) * _SIGMAS * float(np.max(sensor.noise)) + step
    largest = math.inf
    if stream == "gyro" and platform.base.kind == "ball":
        smallest = float(np.linalg.eigvalsh(platform.inertia)[0])
        fastest = _TURNS * platform.largest_torque / smallest
        largest = max(fastest, _HAND) / sensor.rate + scatter
    return StreamLimits(
        range=sensor.range,
        largest_step=largest,
        frozen_after=_frozen_after(stream, sensor, step),
        resolution=step,
        oldest=_OLD + sensor.latency + 2.0 / sensor.rate,
    )


def _frozen_after(stream: str, sensor: Sensor, step: float) -> int:
    """Equal values in a row that noise makes as good as impossible; 0: they are to be expected."""
    # half an angle stands in the vector part of a quaternion
    noise = sensor.noise * (0.5 if stream == "attitude" else 1.0)
    if not noise.any():
        return 0
    # two normal deviates fall into one step with probability step / (2 sqrt(pi) sigma)
    alike = np.minimum(step / (2.0 * math.sqrt(math.pi) * np.maximum(noise, 1e-300)), 1.0)
    chance = float(np.prod(np.where(noise > 0.0, alike, 1.0)))
    if chance > 0.5:
        return 0
    return max(_REPEATS, math.ceil(math.log(_CHANCE) / math.log(max(chance, 1e-300))) + 1)


class SampleChecks:
    """Judges the samples of one device, each stream and part for itself."""

    def __init__(self, name: str, limits: Mapping[str, StreamLimits]) -> None:
        """Nothing has come.

        Args:
            name: of the device, for the sentences.
            limits: of its streams, by its own names; of one that is absent only numbers count.
        """
        self._name, self._limits = name, limits
        self._before: dict[tuple[str, str], tuple[tuple[float, ...], int]] = {}

    def judged(self, sample: Sample, host_time: float | None = None) -> Sample:
        """The sample, not valid and with the reason where it cannot be believed.

        Args:
            sample: as the device gave it; one that it refuses itself stays refused.
            host_time: the host's time [s]; None: its age is not looked at.
        """
        if not sample.valid:
            return sample
        limits = self._limits.get(sample.stream, _ANY)
        age = 0.0 if host_time is None else host_time - sample.host_time + sample.latency
        doubt = self._doubt(sample, limits)
        if not doubt and age > limits.oldest:
            doubt = f"{age:.2f} s old on arrival, more than {limits.oldest:.2f} s"
        if not doubt:
            return sample
        return replace(sample, valid=False, reason=f"{self._name}: {sample.stream} {doubt}")

    def _doubt(self, sample: Sample, limits: StreamLimits) -> str:
        value, key = sample.value, (sample.stream, sample.part)
        if not all(map(math.isfinite, value)):
            return "not a number"
        first = key not in self._before
        last, repeats = self._before.get(key, (value, 0))
        step = max(abs(new - old) for new, old in zip(value, last, strict=True))
        if sample.stream == "attitude":  # a rotation has two quaternions
            step = min(step, max(abs(new + old) for new, old in zip(value, last, strict=True)))
        repeats = repeats + 1 if step == 0.0 else 1
        self._before[key] = value, repeats
        largest = max(map(abs, value))
        if sample.stream == "attitude" and abs(math.hypot(*value) - 1.0) > UNIT_LENGTH:
            return f"a quaternion of length {math.hypot(*value):.4g}"
        if largest >= limits.range:
            return f"saturated: {largest:.4g} at a full scale of {limits.range:.4g}"
        if first and limits.first_confirmed:
            return "the first: there is nothing yet to hold it against"
        if step > limits.largest_step:
            return f"leapt by {step:.4g}, more than {limits.largest_step:.4g} between two samples"
        if limits.frozen_after and repeats >= limits.frozen_after:
            return f"the same for {repeats} samples: the sensor has stopped"
        return ""


_ANY = StreamLimits()


@dataclass
class StreamCount:
    """What came of one of the machine's streams."""

    rows: int = 0
    bad: int = 0
    """Of them not valid."""
    reason: str = ""
    """Of the last that was not."""
    believed: bool = True
    """The last one was valid."""
    newest: float = -math.inf
    """Time of the newest that was valid [s]."""


class _Row(NamedTuple):
    """A sample of a stream that shows where the body points."""

    time: float
    value: Array
    turned: Array
    """The rotation that the rates have shown until then, a quaternion."""


class _Rate(NamedTuple):
    """A sample of the body's rate."""

    time: float
    rate: Array
    speed: float
    """Its length [rad/s]."""
    turned: Array
    """As in `_Row`."""
    way: float
    """Turned until then, whatever the direction [rad]."""


@dataclass
class _Track:
    """One stream beside the rates."""

    history: deque[_Row] = field(default_factory=deque[_Row])
    """The last `WINDOW` seconds."""
    changed: _Row | None = None
    """The first row with the value that the stream has now."""
    strikes: int = 0


COMPARED = ("attitude", "inclinometer", "joint_angle")
"""Streams that are held against the rate: a hinge's angle against its own, the others against the
gyro."""

WINDOW = 2.0
"""Over which the turns that two streams show are compared [s]."""

_STRIKES = 3
"""Comparisons in a row that must fail."""

_ALLOWED = 0.035
"""Turns may always differ by this [rad]."""

_BIAS = 0.02
"""And by a gyro's bias of this [rad/s], beside eight of the deviations stated of it."""

_SCALE = 0.1
"""And by this share of the way that was turned: scale, misalignment."""

_LAG = 0.25
"""And by what the body turns in this time [s]: filters and clocks that differ."""


class MotionAgreement:
    """Holds attitude, inclinometer and a hinge's angle against the rates that were measured."""

    def __init__(self, platform: Platform, agreement: Mapping[str, float] | None = None) -> None:
        """Nothing has come.

        Args:
            platform: the machine.
            agreement: stream -> turn by which it may always differ [rad]; inf: it is not compared.
        """
        self.doubts: dict[str, str] = {}
        """Stream -> why it cannot be believed beside the rate, a sentence."""
        self._sensors = platform.sensors
        self._allowed = dict(agreement or {})
        hinge = platform.base.kind == "hinge"
        self._rate = "joint_rate" if hinge else "gyro"
        compared = COMPARED[2:] if hinge else COMPARED[:2]
        self._tracks = {
            name: _Track()
            for name in compared
            if {name, self._rate} <= platform.sensors.keys() and math.isfinite(self._base(name))
        }
        self._waiting: list[tuple[float, str, Array]] = []
        self._rates = deque[_Rate]()
        self.begin_anew()

    def begin_anew(self) -> None:
        """Time begins anew: what was before is not compared with what comes."""
        self.doubts.clear()
        self._waiting.clear()
        self._rates.clear()
        for name in self._tracks:
            self._tracks[name] = _Track()

    def take(self, reading: Reading) -> None:
        """Compare what one tick brought."""
        if not self._tracks:
            return
        for time, value in valid_rows(reading, self._rate):
            self._turn(time, value)
        for name in self._tracks:
            self._waiting += [(time, name, value) for time, value in valid_rows(reading, name)]
        self._waiting.sort(key=lambda row: row[0])
        while self._waiting and self._rates and self._waiting[0][0] <= self._rates[-1][0]:
            time, name, value = self._waiting.pop(0)
            turned = self._turned(time)
            if turned is not None:
                self._compare(name, time, value, turned)
        del self._waiting[:-_LONGEST_WAIT]

    def _turn(self, time: float, rate: Array) -> None:
        speed = float(np.linalg.norm(rate))
        last = self._rates[-1] if self._rates else None
        if last is not None and time <= last.time:
            return
        longest = max(_GAP, 5.0 / self._sensors[self._rate].rate)
        if last is None or time - last.time > longest:
            # nobody has seen how it turned meanwhile
            for name in self._tracks:
                self._tracks[name] = _Track()
            self._rates.clear()
            self._rates.append(_Rate(time, rate, speed, np.array([1.0, 0.0, 0.0, 0.0]), 0.0))
            return
        passed, mean = time - last.time, np.zeros(3)
        mean[: rate.size] = 0.5 * (rate + last.rate)
        turned = multiply(last.turned, from_rotation_vector(mean * passed))
        way = last.way + 0.5 * passed * (speed + last.speed)
        self._rates.append(_Rate(time, rate, speed, turned, way))
        while self._rates[1].time < time - _KEPT:
            self._rates.popleft()

    def _turned(self, time: float) -> Array | None:
        """The rotation until a time, at or before the last sample of the rate; None: too old."""
        later: _Rate | None = None
        for row in reversed(self._rates):
            if row.time <= time:
                if later is None:
                    return row.turned
                share = (time - row.time) / (later.time - row.time)
                between = to_rotation_vector(multiply(conjugate(row.turned), later.turned))
                return multiply(row.turned, from_rotation_vector(share * between))
            later = row
        return None

    def _compare(self, name: str, time: float, value: Array, turned: Array) -> None:
        track = self._tracks[name]
        row = _Row(time, value, turned)
        if track.changed is None or not np.array_equal(track.changed.value, value):
            track.changed = row
        track.history.append(row)
        while len(track.history) > 1 and track.history[1].time <= time - WINDOW:
            track.history.popleft()
        frozen = self._differ(name, track.changed, row)
        apart = self._differ(name, track.history[0], row)
        track.strikes = track.strikes + 1 if frozen or apart else 0
        if track.strikes < _STRIKES:
            self.doubts.pop(name, None)
        elif frozen:
            since, by = time - track.changed.time, math.degrees(frozen)
            self.doubts[name] = (
                f"{name} has stood still for {since:.2f} s while {self._rate} turned the body by "
                f"{by:.1f} deg"
            )
        else:
            self.doubts[name] = (
                f"{name} and {self._rate} disagree: over {time - track.history[0].time:.2f} s they "
                f"turned the body by ways that differ by {math.degrees(apart):.1f} deg"
            )

    def _differ(self, name: str, first: _Row, last: _Row) -> float:
        """By what the turns differ between two rows [rad]; 0: by no more than they may."""
        if last.time <= first.time:
            return 0.0
        by_rate = multiply(conjugate(first.turned), last.turned)
        if name == "attitude":
            seen = multiply(conjugate(first.value), last.value)
            turn = to_rotation_vector(multiply(conjugate(seen), by_rate))
            difference = float(np.linalg.norm(turn))
        elif name == "inclinometer":
            expected = rotate(conjugate(by_rate), inclined(first.value))
            difference = math.acos(min(max(float(expected @ inclined(last.value)), -1.0), 1.0))
        else:
            turn = last.value - first.value - to_rotation_vector(by_rate)[:1]
            difference = float(np.abs(turn).max())
        return (
            difference if difference > self._tolerance_between(name, first.time, last.time) else 0.0
        )

    def _tolerance_between(self, name: str, first: float, last: float) -> float:
        """By what the turns may differ between two times [rad]."""
        sensor, rate, passed = self._sensors[name], self._sensors[self._rate], last - first
        fastest, way = 0.0, 0.0
        for row in reversed(self._rates):
            if row.time < first - _LAG:
                break
            fastest, way = max(fastest, row.speed), self._rates[-1].way - row.way
        noise = _SIGMAS * math.sqrt(2.0) * float(np.max(sensor.noise)) + sensor.resolution
        walk = _SIGMAS * float(np.max(rate.noise)) * math.sqrt(passed / rate.rate)
        bias = (_BIAS + _SIGMAS * float(np.max(rate.bias))) * passed
        return self._base(name) + noise + walk + bias + _SCALE * way + _LAG * fastest

    def _base(self, name: str) -> float:
        return self._allowed.get(name, _ALLOWED)


_LONGEST_WAIT = 1000
"""Rows that wait for the rate's samples; older ones are given up."""

_GAP = 0.5
"""Longest time without a sample of the rate over which it is taken as known [s]."""

_KEPT = 10.0
"""So far back are the rate's samples kept [s]."""


def inclined(angles: Array) -> Array:
    """The vertical in body axes (3,), of roll and pitch as an inclinometer shows them."""
    roll, pitch = np.sin(angles)
    return np.array([-pitch, roll, math.sqrt(max(1.0 - roll**2 - pitch**2, 0.0))])
