"""A microcontroller at the far end of our link, emulated: stages, coils, wheels and an IMU.

Its main loop runs once a millisecond: set-points that ran out, actuators, samples that are due.
Its clock has an offset and a drift of its own. It can be made to fail. What is wired to it
is a simulated machine, or simple parts on a body that stands still.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.emulate.emulated import EmulatedDevice
from twin.emulate.machine import Share
from twin.errors import UnknownName
from twin.plant.devices.link import Schema
from twin.plant.devices.link.far_end import FarEnd

Array = NDArray[np.float64]


@dataclass
class EmulatedStages:
    """Masses on lead screws, driven by steps that are counted and never measured."""

    count: int
    speed: float
    """Highest [m/s]."""
    acceleration: float
    """[m/s^2]."""
    position: Array = field(default_factory=lambda: np.zeros(0))
    """(count,) where they are [m]."""
    lost: Array = field(default_factory=lambda: np.zeros(0))
    """(count,) position at which each counter was last reset [m]."""

    def __post_init__(self) -> None:
        if not self.position.size:
            self.position = np.zeros(self.count)
        self.lost = np.zeros(self.count)
        self.velocity = np.zeros(self.count)

    @property
    def counted(self) -> Array:
        """(count,) where the counter says that they are [m]."""
        return self.position - self.lost

    def step(self, target: Array | None, duration: float) -> None:
        """Go on towards `target` (count,), as counted [m]; without one, brake and hold."""
        gain = self.acceleration * duration
        if target is None:
            wanted = np.zeros(self.count)
        else:
            away = target - self.counted
            # braking by `gain` a step takes v^2 / (2 a) + v duration / 2, this step included
            reach = np.sqrt(0.25 * gain**2 + 2.0 * self.acceleration * np.abs(away)) - 0.5 * gain
            wanted = np.sign(away) * np.minimum(
                np.minimum(self.speed, reach), np.abs(away) / duration
            )
        self.velocity += np.clip(wanted - self.velocity, -gain, gain)
        self.position = self.position + self.velocity * duration

    def restart(self) -> None:
        """Reset the counters, wherever the masses are; the masses stop."""
        self.lost = self.position.copy()
        self.velocity[:] = 0.0


@dataclass
class EmulatedWheels:
    """Reaction wheels on a body that stands still."""

    inertia: Array
    """(count,) [kg m^2]."""
    torque_limit: float
    """[N m]."""
    drag: float = 0.0
    """Torque per speed [N m s]."""

    def __post_init__(self) -> None:
        self.speed = np.zeros(len(self.inertia))

    def step(self, torque: Array | None, duration: float) -> None:
        """Apply a torque (count,) [N m]; without one they coast, nothing brakes them."""
        motor = 0.0 if torque is None else np.clip(torque, -self.torque_limit, self.torque_limit)
        self.speed += (motor - self.drag * self.speed) / self.inertia * duration


LOOP = 1e-3
"""Period of the firmware's main loop [s]."""

FAULTS: Mapping[str, str] = {
    "mute": "it hears and obeys, but says nothing, for `value` seconds",
    "deaf": "it hears nothing, for `value` seconds",
    "hang": "its main loop stands for `value` seconds: no time-to-live is enforced meanwhile",
    "reset": "it restarts: safe, clock and counters at zero, step counters too",
    "gap": "the next `value` frames are never sent",
    "corrupt": "a bit flips in each of the next `value` frames",
    "stuck": "the values of all its samples stand still, for `value` seconds",
    "stale": "its samples are the last ones again, stamps and all, for `value` seconds",
    "fault": "the firmware reports a fault: LIMIT of part `value`",
    "drift": "its clock runs fast by `value` (s/s) from now on",
}
"""Of the board."""

PART_FAULTS: Mapping[str, str] = {
    "frozen": "what the sensor of channel `value` shows stands still, from now on",
    "zero": "the sensor of channel `value` shows zeros, from now on",
    "spike": "the next sample of channel `value` is 30 in each column",
    "reversed": "set-points of channel `value` act the other way round, from now on",
    "dead": "set-points of channel `value` do nothing, from now on; a stage stands",
    "runaway": "the last part of channel `value` is driven at its limit, whatever it is told",
}
"""Of what is wired to the board, which is well itself."""

_FULL = 1e6
"""Beyond every actuator's limit [SI]; the machine gives what it has."""


class EmulatedMicrocontroller(EmulatedDevice):
    """The far end and what is wired to it."""

    def __init__(
        self,
        schema: Schema,
        rates: Mapping[str, float],
        *,
        stages: EmulatedStages | None = None,
        wheels: EmulatedWheels | None = None,
        machine: Share | None = None,
        name: str = "emulated",
        longest_valid_ms: int = 500,
        clock_us: int = 0,
        drift: float = 0.0,
        baud: int = 115_200,
    ) -> None:
        """Switch it on.

        Args:
            schema: its channels.
            rates: of the measured channels that no machine gives [Hz], by stream.
            stages: parts that stand behind it,
            wheels: unless
            machine: gives the samples and takes the set-points.
            name: with which it greets.
            longest_valid_ms: for which it takes a set-point [ms].
            clock_us: its clock at time 0 [us].
            drift: its clock's rate error [s/s].
            baud: of its line.
        """
        self.baud = baud
        self.schema = schema
        self.stages, self.wheels, self.machine = stages, wheels, machine
        self.shown: dict[str, Array] = {}
        """What sensors that nothing here moves show, by stream, SI."""
        self.dipole = np.zeros(3)
        """[A m^2], what the coils give."""
        self._name, self._longest = name, longest_valid_ms
        self._periods = {
            number: 1.0 / rates[channel.stream]
            for number, channel in enumerate(schema.channels)
            if channel.stream in rates
        }
        self._drift = drift
        self._mark, self._mark_us = 0.0, float(clock_us)
        self._loops = 0
        self._until = dict.fromkeys(FAULTS, -np.inf)
        self._corrupt = 0
        self._parts: dict[str, int] = {}
        """Faults of parts: kind -> channel."""
        self._held: dict[int, Array] = {}
        """Values that stand still, by channel."""
        self._last: dict[int, tuple[int, Array]] = {}
        self._time = 0.0
        self._commands: dict[str, Array] = {}
        """Set-points in force at the last round of the main loop, by stream."""
        self._begin()

    def receive(self, data: bytes, time: float) -> bytes:
        out = self.advance(time)
        if not self._is("deaf") and not self._is("hang"):
            self.far_end.receive(data, self._clock(time))
        return out + self._said()

    def advance(self, time: float) -> bytes:
        while (self._loops + 1) * LOOP <= time + 1e-9:
            self._loops += 1
            self._time = self._loops * LOOP
            if not self._is("hang"):
                self._loop()
            elif self.machine is not None:
                # nobody lets the outputs go while its main loop stands
                self.machine.step(self._commands, self._time)
        self._time = max(self._time, time)
        return self._said()

    def power_cycle(self, time: float) -> None:
        self.advance(time)
        self._restart()
        self._until = dict.fromkeys(FAULTS, -np.inf)
        self._corrupt = 0

    def inject(self, fault: str, value: float = 0.0) -> None:
        if fault not in {*FAULTS, *PART_FAULTS}:
            raise UnknownName("fault of a microcontroller", fault, {**FAULTS, **PART_FAULTS})
        if fault in PART_FAULTS:
            self._parts[fault] = round(value)
        elif fault == "reset":
            self._restart()
        elif fault == "gap":
            self.far_end.skip(round(value))
        elif fault == "corrupt":
            self._corrupt = round(value)
        elif fault == "fault":
            self.far_end.fault("LIMIT", value, self._clock(self._time))
        elif fault == "drift":
            self._mark_us, self._mark = self._exact_clock(self._time), self._time
            self._drift = value
        else:
            self._until[fault] = self._time + value

    def _begin(self) -> None:
        time_us = self._clock(self._time)
        self.far_end = FarEnd(self.schema, self._name, self._longest, time_us)
        self._due = dict.fromkeys(self._periods, self._time)
        self._began = self._time

    def _restart(self) -> None:
        self._mark, self._mark_us = self._time, 0.0
        self._commands = {}
        if self.stages is not None:
            self.stages.restart()
        if self.machine is not None:
            self.machine.restart()
        self.dipole = np.zeros(3)
        self._last.clear()
        self._begin()

    def _loop(self) -> None:
        time_us = self._clock(self._time)
        self.far_end.advance(time_us)
        commands = self._commands = {
            self.schema.channels[number].stream: value
            for number, value in self.far_end.setpoint.items()
        }
        commands = self._done(commands)
        if self.machine is not None:
            for shown in self.machine.step(commands, self._time):
                # what was true before a restart has no stamp on the new clock
                if shown.time >= self._began:
                    number = self.schema.number_of(shown.source)
                    self._send(number, self._clock(shown.time), shown.value)
        if self.stages is not None:
            self.stages.step(commands.get("command_stage_position"), LOOP)
        if self.wheels is not None:
            self.wheels.step(commands.get("command_wheel_torque"), LOOP)
        self.dipole = commands.get("command_dipole", np.zeros(3))
        for number, period in self._periods.items():
            if self._time + 1e-9 >= self._due[number]:
                self._due[number] += period
                self._send(number, time_us, self._measured(self.schema.channels[number].stream))

    def _done(self, commands: dict[str, Array]) -> dict[str, Array]:
        """What parts do of what they are told."""
        done = dict(commands)
        for kind in ("reversed", "dead", "runaway"):
            if kind not in self._parts:
                continue
            channel = self.schema.channels[self._parts[kind]]
            if kind == "runaway":
                done[channel.stream] = np.zeros(channel.columns)
                done[channel.stream][-1] = _FULL
            elif channel.stream in done and kind == "reversed":
                done[channel.stream] = -done[channel.stream]
            else:
                done.pop(channel.stream, None)
        return done

    def _shown(self, number: int, value: Array) -> Array:
        """What a sensor shows of a value."""
        if self._parts.get("zero") == number:
            return np.zeros_like(value)
        if self._parts.get("spike") == number:
            del self._parts["spike"]
            return np.full_like(value, 30.0)
        if self._parts.get("frozen") == number:
            return self._held.setdefault(number, value)
        return value

    def _send(self, number: int, time_us: int, value: Array) -> None:
        value = self._shown(number, value)
        time_before, before = self._last.get(number, (time_us, value))
        if self._is("stale"):
            time_us, value = time_before, before
        elif self._is("stuck"):
            value = before
        self._last[number] = (time_us, value)
        self.far_end.sample(number, time_us, value, self._clock(self._time))

    def _measured(self, stream: str) -> Array:
        if stream == "stage_position" and self.stages is not None:
            return self.stages.counted
        if stream == "wheel_speed" and self.wheels is not None:
            return self.wheels.speed.copy()
        width = self.schema.channels[self.schema.number_of(stream)].columns
        return self.shown.get(stream, np.zeros(width))

    def _said(self) -> bytes:
        said = self.far_end.take()
        if self._is("mute") or self._is("hang"):
            return b""
        if self._corrupt and said:
            frames = said[:-1].split(b"\0")
            for place in range(min(self._corrupt, len(frames))):
                bad = frames[place]
                # of the last byte: its bit 1 cannot make it a zero that ends the frame early
                frames[place] = bad[:-1] + bytes(((bad[-1] ^ 2) or 4,))
            self._corrupt = max(0, self._corrupt - len(frames))
            said = b"\0".join(frames) + b"\0"
        return said

    def _is(self, fault: str) -> bool:
        return self._time < self._until[fault]

    def _exact_clock(self, time: float) -> float:
        return self._mark_us + (time - self._mark) * (1.0 + self._drift) * 1e6

    def _clock(self, time: float) -> int:
        return int(self._exact_clock(time)) % 2**32
