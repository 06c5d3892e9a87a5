"""The machine behind emulated devices: the simulated plant, as their pins see it.

There is one, whatever number of devices it has; each sees and moves its share of it. What the
plant's sensors give, noise and lateness included, is what the devices have to send; the set-points
that are in force there, and only those, reach the plant's actuators. The plant is advanced by
single physics steps, so that a set-point acts from the step after it was heard on. Whichever device
first comes to a time advances it for all of them.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.plant.hardware_setup import Route
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.signals import Command

Array = NDArray[np.float64]

_STAGES = "command_stage_position"
_EPS = 1e-9


class DeviceValue(NamedTuple):
    """A value that a device has to send."""

    source: str
    """Name of the stream in the device."""
    time: float
    """When it was true [s]."""
    value: Array
    """(columns,) SI, the device's axes and order; not a number where there is none."""


class Simultaneous:
    """Puts together the values of one instant, which come at different times by their latencies."""

    def __init__(self, sources: Collection[str]) -> None:
        """`sources`: all that belong to an instant, by the device's names."""
        self._sources = frozenset(sources)
        self._waiting: dict[float, dict[str, Array]] = {}

    def complete(self, shown: Iterable[DeviceValue]) -> list[tuple[float, dict[str, Array]]]:
        """Instants [s] of which all has come now, in their order, each with its values."""
        for each in shown:
            self._waiting.setdefault(each.time, {})[each.source] = each.value
        whole = sorted(t for t, known in self._waiting.items() if self._sources <= known.keys())
        found = [(time, self._waiting[time]) for time in whole]
        if whole:
            self._waiting = {t: known for t, known in self._waiting.items() if t > whole[-1]}
        return found


@dataclass(frozen=True)
class EmulatedMachine:
    """All that a machine is made of; travels to the process that simulates it."""

    platform: Platform
    measured: tuple[Route, ...]
    """How the devices' streams become the machine's; undone here."""
    commanded: tuple[Route, ...]
    seed: int = 0
    """Of its sensors' noise."""
    initial: InitialState | None = None

    def simulated(self) -> "SimulatedMachine":
        """It, at rest and at time 0."""
        return SimulatedMachine(self)


@dataclass
class Share:
    """What one device sees and moves of the machine."""

    machine: "SimulatedMachine"
    commands: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """(columns,) set-points in force, by the device's own names."""
    drive: Callable[[float], Array] | None = None
    """Where the device's own stage drives have brought them at a time [s], (columns,) as its
    command of stages has them; None: the machine's drives obey `commands`."""
    shown: list[DeviceValue] = field(default_factory=list[DeviceValue])

    def step(self, commands: Mapping[str, Array], time: float) -> list[DeviceValue]:
        """Advance the machine to `time` [s], if nobody has yet: what this device is to send.

        Args:
            commands: (columns,) by the device's own names. What is absent is safe: masses brake and
                hold, all else is zero.
            now: device's time, never before that of the last call.
        """
        self.commands = commands
        self.machine.advance(time)
        shown, self.shown = sorted(self.shown, key=lambda item: item.time), []
        return shown

    def restart(self) -> None:
        """The device has restarted: its step counters are at zero, wherever the masses are."""
        self.machine.restart(self)


class SimulatedMachine:
    """One machine, moved by the commands of its devices."""

    def __init__(self, made_of: EmulatedMachine) -> None:
        """Compile it.

        Raises:
            PlatformError: it does not compile.
        """
        platform = made_of.platform
        self.plant = SimulatedPlant(
            replace(platform, control_rate=1.0 / platform.step),
            seed=made_of.seed,
            initial=made_of.initial,
        )
        self._platform = platform
        devices = dict.fromkeys(route.device for route in (*made_of.measured, *made_of.commanded))
        self._shares = {name: Share(self) for name in devices}
        self._measured: dict[str, list[Route]] = {}
        for route in made_of.measured:
            self._measured.setdefault(route.stream, []).append(route)
        self._commanded = made_of.commanded
        self._steps = -1
        self._goal = self.place
        """(stages,) [m] where the masses go, or hold."""
        self._uncounted = np.zeros(len(platform.stages))
        """(stages,) position at which each step counter was last reset [m]."""
        self._moving = self._driven = False

    def share(self, device: str) -> Share:
        """That of one device."""
        return self._shares.setdefault(device, Share(self))

    @property
    def place(self) -> Array:
        """(stages,) where the masses are [m]."""
        return self.plant.state[0][0, self.plant.machine.stage_qpos]

    def advance(self, time: float) -> None:
        """Simulate up to `time` [s], and lay out for each device what it has to send."""
        step = self._platform.step
        while (self._steps + 1) * step <= time + _EPS:
            self._steps += 1
            self._follow(self._steps * step)
            reading = self.plant.read(self._steps * step)
            for stream, samples in reading.streams.items():
                for route in self._measured.get(stream, ()):
                    self._shares[route.device].shown += self._device_values(
                        route, samples.time[0], samples.value[0], samples.valid[0]
                    )
            self.plant.write(self._command())

    def restart(self, share: Share) -> None:
        """That device's step counters are at zero."""
        for route in self._measured.get("stage_position", ()):
            if self._shares[route.device] is share:
                columns = list(route.columns)
                self._uncounted[columns] = self.place[columns]

    def _follow(self, time: float) -> None:
        """Move the masses to where the drives of the devices are by then."""
        place, driven = self.place, False
        for route in self._commanded:
            drive = self._shares[route.device].drive
            if route.stream == _STAGES and drive is not None:
                place[list(route.columns)] = route.taken(drive(time))
                driven = True
        if driven:
            self.plant.drive_stages(place[None])
        self._driven = driven

    def _device_values(
        self, route: Route, times: Array, values: Array, valid: NDArray[np.bool_]
    ) -> list[DeviceValue]:
        away = self._uncounted if route.stream == "stage_position" else 0.0
        return [
            DeviceValue(
                route.source,
                float(time),
                route.shown((value - away)[list(route.columns)])
                if good
                else np.full(len(route.columns), np.nan),
            )
            for time, value, good in zip(times, values, valid, strict=True)
        ]

    def _command(self) -> Command:
        command = {name: np.zeros((1, width)) for name, width in self._platform.commands.items()}
        goal = self._goal.copy()
        stages_commanded = False
        for route in self._commanded:
            commands = self._shares[route.device].commands
            if route.source not in commands:
                continue
            value = route.taken(commands[route.source])
            if route.stream == _STAGES:
                goal[list(route.columns)] = value + self._uncounted[list(route.columns)]
                stages_commanded = True
            else:
                command[route.stream][0, list(route.columns)] = value
        if _STAGES in command:
            if self._moving and not stages_commanded:
                goal = self._braked()
            self._goal, self._moving = goal, stages_commanded
            command[_STAGES] = goal[None]
        if self._driven:
            del command[_STAGES]
        return command

    def _braked(self) -> Array:
        """Where masses that brake now come to rest, (stages,) [m]; none goes past its goal."""
        machine, platform = self.plant.machine, self._platform
        speed = self.plant.state[1][0, machine.stage_dof]
        ramp = np.array([1.0 / (2.0 * stage.acceleration) for stage in platform.stages])
        late = np.array([stage.response for stage in platform.stages])
        way = speed * late + np.sign(speed) * speed**2 * ramp
        remaining = self._goal - self.place
        return self.place + np.clip(way, np.minimum(remaining, 0.0), np.maximum(remaining, 0.0))
