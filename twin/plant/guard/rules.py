"""The rules on commands of a machine, its settings, and the state that they look at.

What a command may be, from what is wished and what has been seen: every rule on its own.
None of them stops the machine: they give the nearest command that is allowed, and count.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.plant.limits import Limits
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


class Observed:
    """The newest valid samples of one machine."""

    def __init__(self, platform: Platform) -> None:
        """Nothing has been observed."""
        self.time = 0.0
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
        if reading.time <= self.time:
            self._date_back(self.time + self._platform.tick - reading.time)
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
        self.time = reading.time
        for name in self._needed:
            self._stale[name] = 0 if self._is_fresh(name) else self._stale[name] + 1

    def add_wheel_torque(self, applied: Command, duration: float) -> None:
        """Count what a wheel torque adds until its speed is measured again."""
        torque = applied.get("command_wheel_torque")
        if torque is not None:
            self._momentum = self._momentum + torque[0] * duration

    def stale(self, cycles: int) -> str | None:
        """A stream that has had no fresh sample for so many ticks in a row; None: all are fresh."""
        return next((name for name, count in self._stale.items() if count >= cycles), None)

    def age(self, stream: str) -> float:
        """Of its newest valid sample [s]; inf before the first."""
        return self.time - self.newest[stream][0] if stream in self.newest else np.inf

    @property
    def stage_position(self) -> Array | None:
        """(stages,) [m]; None where it was never measured."""
        result = self.newest.get("stage_position")
        return None if result is None else result[1]

    @property
    def wheel_momentum(self) -> Array:
        """(wheels,) relative to the body [N m s]."""
        return self._momentum

    @property
    def rate(self) -> float | None:
        """Of the body, as the gyro says [rad/s]; None: it does not."""
        return float(np.linalg.norm(self.newest["gyro"][1])) if "gyro" in self.newest else None

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


@dataclass(frozen=True, kw_only=True)
class GuardSettings:
    """Numbers of the rules of `twin.plant.guard`; the parts' own limits are in the platform."""

    max_balance_step: float
    """Largest change of the gravity torque m g r by one move while floating [N m]."""
    tilt_cutout: float
    """Lean at which all stops [rad]; inf: the operator watches it."""
    rate_cutout: float = np.inf
    """Rate of the body at which all stops [rad/s]; inf: the operator watches it."""
    height_margin: float = 0.0
    """So far below the CR the CM stays while floating, as the mass moment -m r z [kg m]."""
    stroke_margin: float = 0.0
    """Kept free at both ends of a stage's travel [m]."""
    horizon: float = 0.25
    """No move is longer than a stage's speed times this [s]: what a drive without a watchdog
    still does after its host has died."""
    momentum_share: float = 0.9
    """Of a wheel's momentum limit that may be used."""
    stale_cycles: int = 5
    """Control periods in a row without a fresh sample of a stream before all stops."""
    watchdog: float = np.inf
    """Longest time between two commands before all stops [s], by the wall's clock; inf where the
    plant's time is not the wall's, or to have none."""
    air_pressure: float = 0.0
    """The machine floats above this [Pa], where `air_pressure` is measured and `floating` not."""


_FASTEST = np.radians(30.0)
"""No table is turned faster on purpose unless that is stated [rad/s], ASSUMED: slews and multisines
of the papers stay below 10 deg/s."""

WATCHDOG = 1.0
"""Longest silence of a loop on the wall's clock [s] unless stated: far more than a tick that is
late on a busy computer, far less than a lean takes to grow."""


def guard_settings(platform: Platform) -> GuardSettings:
    """What suits a machine of which nothing is stated.

    A balance step of a hundredth of what its masses can do from end to end, a cut-out at eight
    tenths of the way to the stop, and one of the rate, of a ball, at 30 deg/s or eight tenths of
    what its gyro can show.
    """
    gyro = platform.sensors.get("gyro")
    fastest = min(_FASTEST, np.inf if gyro is None else 0.8 * gyro.range)
    reach = sum(stage.mass * (stage.travel[1] - stage.travel[0]) for stage in platform.stages)
    return GuardSettings(
        max_balance_step=0.01 * platform.gravity * reach if reach else np.inf,
        tilt_cutout=0.8 * platform.stop_angle,
        rate_cutout=fastest if platform.base.kind == "ball" else np.inf,
    )


def bench_settings(platform: Platform) -> GuardSettings:
    """What suits it where its time is the wall's: a loop that hangs is noticed, too."""
    return replace(guard_settings(platform), watchdog=max(WATCHDOG, 3.0 * platform.tick))


RULES: Mapping[str, str] = {
    "stroke": "a stage stays within its travel, less the margin at both ends",
    "rate": "a stage is sent no further than it goes in the horizon; a gimbal turns no faster than "
    "its drive can",
    "torque": "no motor, coil or thruster is asked for more than it has",
    "momentum": "a wheel takes up no more than its share of its limit",
    "balance_step": "while floating, one move changes m g r by no more than max_balance_step",
    "height": "while floating, no move brings the CM up to the CR",
}
"""Names of the rules that limit a command, and what each says."""


class Rules:
    """The rules for one machine."""

    def __init__(self, platform: Platform, settings: GuardSettings) -> None:
        """Nothing has been limited yet."""
        self.count = Counter[str]()
        """Ticks in which each rule changed a command."""
        self._platform, self._settings = platform, settings
        self._limits = Limits(platform)
        stages = platform.stages
        margin = settings.stroke_margin
        self._lowest = np.array([stage.travel[0] + margin for stage in stages])
        self._highest = np.array([stage.travel[1] - margin for stage in stages])
        self._lead = np.array([stage.speed for stage in stages]) * settings.horizon
        self._resolution = np.array([stage.resolution for stage in stages])
        self._moment = np.array([stage.mass * stage.axis for stage in stages]).reshape(-1, 3)
        """(stages, 3) mass moment per position [kg]."""
        self._most_momentum = settings.momentum_share * np.array(
            [wheel.momentum_limit for wheel in platform.wheels]
        )

    def limited(self, wanted: Command, observed: Observed, *, floating: bool) -> Command:
        """The nearest allowed command, each channel (1, columns).

        Args:
            wanted: finite, of channels that the machine has.
            observed: with the stages' positions, if `wanted` moves them.
            floating: whether the rules of a floating machine hold.
        """
        allowed: Command = {}
        for name, value in wanted.items():
            match name:
                case "command_stage_position":
                    allowed[name] = self._stages(value[0], observed, floating=floating)[None]
                case "command_wheel_torque":
                    allowed[name] = self._wheels(value[0], observed)[None]
                case "command_gimbal_rate":
                    allowed[name] = self._noted("rate", value, self._limits.gimbal_rate(value))
                case "command_dipole":
                    coils, dipole = self._limits.dipole(value)
                    if not np.allclose(coils, self._limits.coils(value), rtol=1e-9, atol=0.0):
                        self.count["torque"] += 1
                    allowed[name] = dipole
                case "command_thruster":
                    allowed[name] = self._noted("torque", value, self._limits.force(value))
                case _:
                    allowed[name] = self._noted("torque", value, self._limits.joint_torque(value))
        return allowed

    def _stages(self, wanted: Array, observed: Observed, *, floating: bool) -> Array:
        place = observed.stage_position
        assert place is not None
        target = self._noted("stroke", wanted, np.clip(wanted, self._lowest, self._highest))
        # outside the margins it may stay or come back, but is not thrown back
        lead = self._noted("rate", target - place, np.clip(target - place, -self._lead, self._lead))
        if floating:
            torque = self._platform.gravity * float(np.linalg.norm(lead @ self._moment))
            lead = self._scaled("balance_step", lead, self._settings.max_balance_step, torque)
            rise = float(lead @ self._moment[:, 2])
            if rise > 0.0:
                room = max(-self._settings.height_margin - self.height(place), 0.0)
                lead = self._scaled("height", lead, room, rise)
        return place + lead

    def height(self, stage_position: Array) -> float:
        """m r z with the stages there [kg m]; negative: the CM is below the CR."""
        base = float(self._platform.center_of_mass_offset[2])
        return base + float(stage_position @ self._moment[:, 2])

    def _wheels(self, wanted: Array, observed: Observed) -> Array:
        limit = np.array([wheel.torque_limit for wheel in self._platform.wheels])
        torque = self._noted("torque", wanted, np.clip(wanted, -limit, limit))
        tick, momentum = self._platform.tick, observed.wheel_momentum
        # one that is beyond its share is let down, but not braked for it
        most = np.maximum((self._most_momentum - momentum) / tick, 0.0)
        least = np.minimum((-self._most_momentum - momentum) / tick, 0.0)
        return self._noted("momentum", torque, np.clip(torque, least, most))

    def _scaled(self, rule: str, lead: Array, limit: float, size: float) -> Array:
        """A move cut to the share that is allowed, towards where the stages are, in whole steps."""
        if size <= limit * (1.0 + 1e-12):
            return lead
        self.count[rule] += 1
        lead = lead * (limit / size)
        steps = np.where(self._resolution > 0.0, self._resolution, 1.0)
        return np.where(self._resolution > 0.0, np.trunc(lead / steps) * steps, lead)

    def _noted(self, rule: str, wanted: Array, allowed: Array) -> Array:
        if not np.array_equal(wanted, allowed):
            self.count[rule] += 1
        return allowed


class Watchdog:
    """Runs in a thread of its own, so that a loop that hangs is noticed."""

    def __init__(self, limit: float, alarm: Callable[[float], None]) -> None:
        """`alarm` is called once, from the thread, with how long it was quiet [s].

        Args:
            limit: longest quiet time [s], by the monotonic clock.
            alarm: what to do then.
        """
        self._limit, self._alarm = limit, alarm
        self._fed = time.monotonic()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._thread.start()

    def feed(self) -> None:
        """All is well."""
        self._fed = time.monotonic()

    def stop(self) -> None:
        """Watch no longer."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)

    def _watch(self) -> None:
        while not self._ending.wait(max(self._fed + self._limit - time.monotonic(), 0.0)):
            quiet = time.monotonic() - self._fed
            if quiet >= self._limit:
                self._alarm(quiet)
                return
