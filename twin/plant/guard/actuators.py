"""Whether actuators do what they were told, by their own readings.

A stage must come nearer to where it was sent; the speed of a wheel and the angle of a gimbal are
the integral of what their drives were told. What a body does in answer, `twin.service.answer` holds
against its prediction: coils and thrusters show nothing of their own.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.signals import Command, Reading, valid_rows

Array = NDArray[np.float64]

_LATE = 0.2
"""A reading follows its actuator by no more, beside what is stated [s]."""

_FOLLOWS = 1.0
"""A stage that was sent farther away must have moved after this [s]."""

_NEAR = 4e-5
"""A stage that reads so near to where it was sent has arrived [m]: 003 tells of masses that scatter
by 26 to 30 um."""

_PITCH = 0.03
"""And so near, as a share of that position: the error of a lead screw's pitch."""

_SWINGS = 10.0
"""Over which a stage that is sent to and fro must have moved [s]."""

_STIFF = 0.1
"""By this share of what a drive of half its speed would have, at least."""

_MOVED = 0.25
"""A drive moves by this share of what it could, at least."""

_WINDOW = 2.0
"""Over which an integral is compared [s]."""

_OWN = 0.25
"""A drive may be off by this share of its limit: friction, a motor's own error."""

_GAIN = 0.3
"""And by this share of what it was told."""

_BODY = 0.5
"""What a wheel's speed changes by when the body that carries it is jerked [rad/s]."""

_SIGMAS = 8.0

_LONG = 6.0
"""Over which the share of a command is fitted that a reading shows [s]."""

_CLEAR = 10.0
"""Noises by which that command must have moved the reading."""

_STIRRED = 0.05
"""And share of the limit that it must have had, root mean square: friction holds against less."""

_EVERY = 1.0
"""[s] between two such fits."""

_STRIKES = 3
"""Comparisons in a row that must fail."""


class _Commanded(NamedTuple):
    """A command, from when on it holds, and what it had amounted to by then."""

    time: float
    value: float
    integral: float
    way: float
    """Integral of its size."""


class _Sample(NamedTuple):
    """A reading beside the integral of what was told."""

    time: float
    value: float
    integral: float
    way: float


class _Integral:
    """One actuator whose reading is the integral of its command."""

    def __init__(
        self, name: str, *, gain: float, limit: float, noise: float, rate: float, lag: float
    ) -> None:
        """Nothing is known.

        Args:
            name: in a sentence.
            gain: of the reading's rate, per unit of the command.
            limit: of the command.
            noise: of the reading, 1 sigma and step.
            rate: of the reading [Hz].
            lag: by which the reading may differ always: a drive's ramp, a jerk of the body.
        """
        self._name, self._gain, self._limit = name, gain, limit
        self._noise, self._lag = noise, lag
        self._window = max(_WINDOW, 4.0 / rate)
        self._long = max(_LONG, 10.0 / rate)
        self._commands = deque[_Commanded]()
        self._samples = deque[_Sample]()
        self._apart = self._weak = 0
        self._fitted = -math.inf
        self.fault = ""

    def command(self, time: float, value: float) -> None:
        """From now on it is told so."""
        integral = way = 0.0
        if self._commands:
            last = self._commands[-1]
            passed = max(time - last.time, 0.0)
            integral = last.integral + passed * last.value
            way = last.way + passed * abs(last.value)
        self._commands.append(_Commanded(time, value, integral, way))
        while len(self._commands) > 2 and self._commands[1].time < time - self._long - 1.0:
            self._commands.popleft()

    def read(self, time: float, value: float) -> None:
        """It read so."""
        told = next((item for item in reversed(self._commands) if item.time <= time), None)
        if told is None:
            return
        passed = time - told.time
        self._samples.append(
            _Sample(
                time,
                value,
                told.integral + passed * told.value,
                told.way + passed * abs(told.value),
            )
        )
        while self._samples[0].time < time - self._long:
            self._samples.popleft()
        self._compare(self._samples[-1])
        if time >= self._fitted + _EVERY:
            self._fitted = time
            self._fit(list(self._samples))

    def _compare(self, last: _Sample) -> None:
        """Over a short time: a drive that runs by itself, or not at all."""
        first = next(item for item in self._samples if item.time >= last.time - self._window)
        passed = last.time - first.time
        if passed < 0.5 * self._window:
            return
        expected = self._gain * (last.integral - first.integral)
        allowed = self._gain * (
            _GAIN * (last.way - first.way) + _OWN * self._limit * (passed + _LATE)
        )
        allowed += math.sqrt(2.0) * _SIGMAS * self._noise + self._lag
        moved = last.value - first.value
        self._apart = self._apart + 1 if abs(moved - expected) > allowed else 0
        if self._apart >= _STRIKES:
            self.fault = (
                f"{self._name} does not do what it is told: in {passed:.2f} s it changed by "
                f"{moved:.4g}, its commands by {expected:.4g}"
            )

    def _fit(self, samples: Sequence[_Sample]) -> None:
        """Over a longer time: which share of the command the reading shows."""
        if len(samples) < _FEWEST or samples[-1].time - samples[0].time < 0.9 * self._long:
            return
        time = np.array([item.time for item in samples])
        told = self._gain * np.array([item.integral for item in samples])
        value = np.array([item.value for item in samples])
        steady = np.stack([np.ones_like(time), time - time[0]], axis=1)
        told, value = (each - steady @ np.linalg.lstsq(steady, each)[0] for each in (told, value))
        size, rate = float(told @ told), np.diff(told) / np.diff(time) / self._gain
        stirred = float(np.sqrt(np.mean(rate**2))) > _STIRRED * self._limit
        scatter = max(self._noise, self._lag / _SIGMAS)
        if not stirred or size < len(told) * (_CLEAR * scatter) ** 2:
            self._weak = 0
            return
        share = float(told @ value) / size
        left = value - share * told
        deviation = math.sqrt(max(float(left @ left) / len(told), scatter**2) / size)
        wrong = share < -_GAIN and share < -5.0 * deviation
        dead = share < _GAIN and deviation < 0.05
        self._weak = self._weak + 1 if wrong or dead else 0
        if self._weak >= _STRIKES:
            what = "acts the wrong way round" if wrong else "hardly does what it is told"
            self.fault = (
                f"{self._name} {what}: its reading shows {share:.2f} +- {2.0 * deviation:.2f} of "
                "its commands"
            )


_FEWEST = 8
"""Samples without which nothing is fitted."""


class _Place(NamedTuple):
    """Where a stage was sent, where it was read to be, and where a slow drive would be [m]."""

    time: float
    target: float
    value: float
    slow: float


class ActuatorMonitor:
    """Watches the actuators of an armed machine."""

    def __init__(self, platform: Platform) -> None:
        """Nothing has been told."""
        self._now = -math.inf
        self._platform = platform
        self._stages = [deque[_Place]() for _ in platform.stages]
        self._swings = [deque[_Place]() for _ in platform.stages]
        self._targets: Array | None = None
        self._integrals: dict[tuple[str, str], list[_Integral]] = {}
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget all: time begins anew."""
        platform = self._platform
        self._targets = None
        for places in (*self._stages, *self._swings):
            places.clear()
        self._integrals.clear()
        if "wheel_speed" in platform.sensors:
            sensor = platform.sensors["wheel_speed"]
            self._integrals["command_wheel_torque", "wheel_speed"] = [
                _Integral(
                    f"wheel {wheel.name}",
                    gain=1.0 / wheel.inertia,
                    limit=wheel.torque_limit,
                    noise=float(np.max(sensor.noise)) + sensor.resolution,
                    rate=sensor.rate,
                    lag=_BODY,
                )
                for wheel in platform.wheels
            ]
        if "gimbal_angle" in platform.sensors:
            sensor = platform.sensors["gimbal_angle"]
            self._integrals["command_gimbal_rate", "gimbal_angle"] = [
                _Integral(
                    f"gimbal {gimbal.name}",
                    gain=1.0,
                    limit=gimbal.rate,
                    noise=float(np.max(sensor.noise)) + sensor.resolution,
                    rate=sensor.rate,
                    lag=gimbal.rate**2 / gimbal.acceleration + _PLAY,
                )
                for gimbal in platform.gimbals
            ]

    def take_command(self, applied: Command) -> None:
        """This holds from the last reading on."""
        move = applied.get("command_stage_position")
        if move is not None:
            self._targets = move[0].copy()
        for (command, _), parts in self._integrals.items():
            if command in applied:
                for part, value in zip(parts, applied[command][0].tolist(), strict=True):
                    part.command(self._now, value)

    def take(self, reading: Reading) -> str:
        """Compare what one tick brought; why it must stop, a sentence, or nothing."""
        if reading.time <= self._now:
            self.begin_anew()
        self._now = reading.time
        for (_, stream), parts in self._integrals.items():
            for time, value in valid_rows(reading, stream):
                for part, number in zip(parts, value.tolist(), strict=True):
                    part.read(time, number)
            fault = next((part.fault for part in parts if part.fault), "")
            if fault:
                return fault
        for time, value in valid_rows(reading, "stage_position"):
            for number in range(len(self._stages)):
                fault = self._following(number, time, float(value[number]))
                if fault:
                    return fault
        return ""

    def _following(self, number: int, time: float, value: float) -> str:
        """Why a stage does not follow; empty: it does, or it cannot be told yet."""
        if self._targets is None:
            return ""
        stage, sensor = self._platform.stages[number], self._platform.sensors["stage_position"]
        places, target = self._stages[number], float(self._targets[number])
        if stiff := self._stiff(number, time, target, value):
            return stiff
        near = _NEAR + _SIGMAS * float(np.max(sensor.noise)) + _PITCH * abs(target)
        way = math.copysign(1.0, target - value)
        if abs(target - value) <= near or (
            places and way * (places[-1].target - places[-1].value) <= 0.0
        ):
            places.clear()
        places.append(_Place(time, target, value, value))
        patience = stage.response + sensor.latency + 2.0 / sensor.rate + self._platform.tick
        patience += _LATE + _FOLLOWS + 2.0 * stage.speed / stage.acceleration
        while len(places) > 1 and places[1].time <= time - patience:
            places.popleft()
        passed = time - places[0].time
        if passed < patience - 1e-9:
            return ""
        least = min(way * (place.target - place.value) for place in places)
        moved = way * (value - places[0].value)
        if moved >= _MOVED * min(stage.speed * _FOLLOWS, least):
            return ""
        return (
            f"stage {stage.name} does not follow: it was sent to {1e3 * target:.3f} mm and reads "
            f"{1e3 * value:.3f} mm, {1e3 * places[0].value:.3f} mm {passed:.2f} s before"
        )

    def _stiff(self, number: int, time: float, target: float, value: float) -> str:
        """Why a stage that was sent to and fro has not moved; empty: it has, or was not sent."""
        stage, sensor = self._platform.stages[number], self._platform.sensors["stage_position"]
        swings = self._swings[number]
        slow = value
        if swings:
            most = 0.5 * stage.speed * (time - swings[-1].time)
            slow = swings[-1].slow + min(max(target - swings[-1].slow, -most), most)
            if abs(target - value) < abs(target - slow):
                slow = value  # it is ahead of the slow one
        swings.append(_Place(time, target, value, slow))
        while swings[0].time < time - _SWINGS:
            swings.popleft()
        way = max(each.slow for each in swings) - min(each.slow for each in swings)
        moved = max(each.value for each in swings) - min(each.value for each in swings)
        near = _NEAR + _SIGMAS * float(np.max(sensor.noise))
        clear = 4.0 * (near + _PITCH * max(abs(each.target) for each in swings))
        if time - swings[0].time < 0.9 * _SWINGS or way < clear or moved > _STIFF * way:
            return ""
        return (
            f"stage {stage.name} does not follow: in {time - swings[0].time:.2f} s it was sent "
            f"over {1e3 * way:.3f} mm and reads to have moved by {1e3 * moved:.3f} mm"
        )


_PLAY = 0.02
"""Of a gimbal's gear [rad]."""
