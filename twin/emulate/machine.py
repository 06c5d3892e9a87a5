"""The machine behind an emulated board: the simulated plant, as the board's pins see it.

What the plant's sensors give, noise and lateness included, is what the board has to send; the
set-points that are in force there, and only those, reach the plant's actuators. The plant is
advanced by single physics steps, so that a set-point acts from the step after it was heard on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.plant.routes import Route
from twin.plant.simulated import InitialState, SimulatedPlant
from twin.platform import Platform
from twin.signals import Command

Array = NDArray[np.float64]

_STAGES = "command_stage_position"
_EPS = 1e-9


class Shown(NamedTuple):
    """A value that a board has to send."""

    source: str
    """The board's own name of the stream."""
    time: float
    """When it was true [s]."""
    value: Array
    """(columns,) SI, the board's axes and order; not a number where there is none."""


@dataclass(frozen=True)
class Machine:
    """All that a machine is made of; travels to the process that simulates it."""

    platform: Platform
    measured: tuple[Route, ...]
    """How the board's streams become the machine's; undone here."""
    commanded: tuple[Route, ...]
    seed: int = 0
    """Of its sensors' noise."""
    initial: InitialState | None = None

    def simulated(self) -> "SimulatedMachine":
        """It, at rest and at time 0."""
        return SimulatedMachine(self)


class SimulatedMachine:
    """One machine, moved by what a board tells its actuators."""

    def __init__(self, made_of: Machine) -> None:
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
        self._measured: dict[str, list[Route]] = {}
        for route in made_of.measured:
            self._measured.setdefault(route.stream, []).append(route)
        self._commanded = made_of.commanded
        self._steps = -1
        self._goal = self._place
        """(stages,) [m] where the masses go, or hold."""
        self._uncounted = np.zeros(len(platform.stages))
        """(stages,) [m] what a step counter that began anew does not know of."""
        self._moving = False

    def step(self, told: Mapping[str, Array], now: float) -> list[Shown]:
        """Advance to `now` [s] under the set-points that are in force: what is to be sent.

        Args:
            told: (columns,) by the board's own names. What is absent is safe: masses brake and
                hold, all else is zero.
            now: board's time, never before that of the last call.
        """
        shown: list[Shown] = []
        step = self._platform.step
        while (self._steps + 1) * step <= now + _EPS:
            self._steps += 1
            reading = self.plant.read(self._steps * step)
            for stream, samples in reading.streams.items():
                for route in self._measured.get(stream, ()):
                    shown += self._seen(route, samples.time[0], samples.value[0], samples.valid[0])
            self.plant.write(self._command(told))
        return sorted(shown, key=lambda one: one.time)

    def restart(self) -> None:
        """The board has begun anew: step counters are at zero, wherever the masses are."""
        self._uncounted = self._place

    @property
    def _place(self) -> Array:
        return self.plant.state[0][0, self.plant.machine.stage_qpos]

    def _seen(
        self, route: Route, times: Array, values: Array, valid: NDArray[np.bool_]
    ) -> list[Shown]:
        away = self._uncounted if route.stream == "stage_position" else 0.0
        return [
            Shown(
                route.source,
                float(time),
                route.shown((value - away)[list(route.columns)])
                if good
                else np.full(len(route.columns), np.nan),
            )
            for time, value, good in zip(times, values, valid, strict=True)
        ]

    def _command(self, told: Mapping[str, Array]) -> Command:
        command = {name: np.zeros((1, width)) for name, width in self._platform.commands.items()}
        goal = self._goal.copy()
        told_stages = False
        for route in self._commanded:
            if route.source not in told:
                continue
            value = route.taken(told[route.source])
            if route.stream == _STAGES:
                goal[list(route.columns)] = value + self._uncounted[list(route.columns)]
                told_stages = True
            else:
                command[route.stream][0, list(route.columns)] = value
        if _STAGES in command:
            if self._moving and not told_stages:
                goal = self._braked()
            self._goal, self._moving = goal, told_stages
            command[_STAGES] = goal[None]
        return command

    def _braked(self) -> Array:
        """Where masses that brake now come to rest, (stages,) [m]; none goes past its goal."""
        machine, platform = self.plant.machine, self._platform
        speed = self.plant.state[1][0, machine.stage_dof]
        ramp = np.array([1.0 / (2.0 * stage.acceleration) for stage in platform.stages])
        late = np.array([stage.response for stage in platform.stages])
        way = speed * late + np.sign(speed) * speed**2 * ramp
        left = self._goal - self._place
        return self._place + np.clip(way, np.minimum(left, 0.0), np.maximum(left, 0.0))
