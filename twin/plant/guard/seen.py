"""What the readings so far say of a machine that must be kept safe: lean, air, positions, ages."""

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.rotation import vertical_body
from twin.signals import Command, Reading

Array = NDArray[np.float64]

_NEEDED = ("attitude", "inclinometer", "gyro", "stage_position", "joint_angle", "gimbal_angle")
"""Streams without which nothing may move, where the machine measures them. Wheel speeds may come
once a second: what they gain meanwhile is counted."""

_LATE = 2.0
"""Periods of a stream after which its newest sample is no longer fresh."""

_AIR = ("floating", "air_pressure")
"""What says whether it floats; the first that was ever heard counts."""

_AIR_SILENT = 1.0
"""A signal of the air that is older [s] is no longer believed. How often a board sends it stands
nowhere, and nobody needs it at the rate of a gyro."""

_JUMP = 1e-4
"""[m]: a stage's reading may be off by this, over what its drive can move, and by its noise."""

_SIGMAS = 8.0
"""Of that noise: two readings at 100 Hz for a year differ by less."""


class Seen:
    """The newest valid samples of one machine."""

    def __init__(self, platform: Platform) -> None:
        """Nothing has been seen."""
        self.now = 0.0
        """Of the last reading [s]."""
        self.newest: dict[str, tuple[float, Array]] = {}
        """Stream -> time and value (columns,) of its newest valid sample."""
        self.lost = ""
        """Why the stages' positions cannot be believed; empty while they can."""
        self._platform = platform
        self._needed = tuple(name for name in _NEEDED if name in platform.sensors)
        self._stale = dict.fromkeys(self._needed, 0)
        self._speed = np.array([stage.speed for stage in platform.stages])
        stage_sensor = platform.sensors.get("stage_position")
        noise = 0.0 if stage_sensor is None else float(np.max(stage_sensor.noise))
        self._tolerance = _JUMP + _SIGMAS * noise
        self._momentum = np.zeros(len(platform.wheels))
        self._inertia = np.array([wheel.inertia for wheel in platform.wheels])

    def take(self, reading: Reading) -> None:
        """Note what one tick brought; where time begins anew, what was seen is dated back."""
        if reading.time <= self.now:
            self._date_back(self.now + self._platform.tick - reading.time)
        for name, samples in reading.streams.items():
            good = np.flatnonzero(samples.valid[0])
            if good.size:
                last = int(good[-1])
                new = float(samples.time[0, last]), samples.value[0, last]
                if name in self.newest and new[0] <= self.newest[name][0]:
                    continue
                if name == "stage_position":
                    self._check_jump(*new)
                elif name == "wheel_speed":
                    self._momentum = self._inertia * new[1]
                self.newest[name] = new
        self.now = reading.time
        for name in self._needed:
            self._stale[name] = 0 if self._is_fresh(name) else self._stale[name] + 1

    def told(self, applied: Command, duration: float) -> None:
        """Count what a wheel torque adds until its speed is measured again."""
        torque = applied.get("command_wheel_torque")
        if torque is not None:
            self._momentum = self._momentum + torque[0] * duration

    def stale(self, cycles: int) -> str | None:
        """A stream that has had no fresh sample for so many ticks in a row; None: all are fresh."""
        return next((name for name, count in self._stale.items() if count >= cycles), None)

    def age(self, stream: str) -> float:
        """Of its newest valid sample [s]; inf before the first."""
        return self.now - self.newest[stream][0] if stream in self.newest else np.inf

    @property
    def stage_position(self) -> Array | None:
        """(stages,) [m]; None where it was never measured."""
        found = self.newest.get("stage_position")
        return None if found is None else found[1]

    @property
    def wheel_momentum(self) -> Array:
        """(wheels,) relative to the body [N m s]."""
        return self._momentum

    @property
    def lean(self) -> float | None:
        """What the tilt stop limits, the largest that any sensor says [rad]; None: none says."""
        leans: list[float] = []
        if "attitude" in self.newest:
            leans.append(self._lean(vertical_body(self.newest["attitude"][1])))
        if "inclinometer" in self.newest:
            roll, pitch = np.sin(self.newest["inclinometer"][1])
            up = np.sqrt(max(1.0 - roll**2 - pitch**2, 0.0))
            leans.append(self._lean(np.array([-pitch, roll, up])))
        if "joint_angle" in self.newest:
            leans.append(float(np.abs(self.newest["joint_angle"][1]).max()))
        return max(leans) if leans else None

    def floating(self, pressure: float) -> bool | None:
        """Whether it floats, as a signal says; None: there is none, or it has fallen silent.

        Args:
            pressure: above which the air carries it [Pa], where only `air_pressure` is measured.
        """
        signal = self._air_signal
        if signal is None or self.silent_air:
            return None
        return bool(self.newest[signal][1][0] > (0.5 if signal == "floating" else pressure))

    @property
    def silent_air(self) -> str:
        """The signal of the air that was heard and is no more; empty: it is, or never was."""
        signal = self._air_signal
        allowed = max(_AIR_SILENT, _LATE * self._platform.tick)
        return signal if signal is not None and self.age(signal) > allowed else ""

    def captured(self) -> None:
        """Positions were established anew with the machine held."""
        self.lost = ""

    @property
    def _air_signal(self) -> str | None:
        return next((name for name in _AIR if name in self.newest), None)

    def _date_back(self, seconds: float) -> None:
        self.newest = {name: (time - seconds, value) for name, (time, value) in self.newest.items()}

    def _lean(self, vertical: Array) -> float:
        stop = self._platform.pitch_stop
        if stop is None:
            return float(np.arccos(np.clip(vertical[2], -1.0, 1.0)))
        return float(np.arcsin(min(abs(float(vertical @ stop.axis)), 1.0)))

    def _check_jump(self, time: float, position: Array) -> None:
        before = self.newest.get("stage_position")
        if before is None:
            return
        moved = np.abs(position - before[1])
        most = self._speed * (time - before[0] + self._platform.tick) + self._tolerance
        far = np.flatnonzero(moved > most)
        if far.size:
            name = self._platform.stages[int(far[0])].name
            self.lost = (
                f"stage {name} reads {1e3 * position[far[0]]:.2f} mm after "
                f"{1e3 * before[1][far[0]]:.2f} mm {time - before[0]:.2f} s before, which its "
                "drive cannot do"
            )

    def _is_fresh(self, name: str) -> bool:
        sensor = self._platform.sensors[name]
        allowed = _LATE / sensor.rate + sensor.latency + self._platform.tick
        return self.age(name) <= allowed + 1e-9
