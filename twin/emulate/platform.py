"""A platform's devices, emulated: its [hardware] on a pseudo-terminal, its simulation behind it.

The board and the machine behind it live in another process, on the wall's clock and at the line's
rate; they know of this one what comes over the line.
"""

import pickle
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from twin.emulate.faults import Fault
from twin.emulate.line import EmulatedLine
from twin.emulate.machine import Machine
from twin.emulate.microcontroller import EmulatedMicrocontroller
from twin.errors import UsageError
from twin.plant.devices.device import Device
from twin.plant.devices.host_time import HostTime
from twin.plant.devices.link import Schema
from twin.plant.devices.microcontroller import Microcontroller, MicrocontrollerSettings
from twin.plant.hardware_setup import HardwareSetup
from twin.plant.simulated import InitialState
from twin.platform import Platform


@dataclass(frozen=True)
class Board:
    """Makes an emulated board with its machine, in the process where it will live."""

    settings: MicrocontrollerSettings
    machine: Machine

    def __call__(self) -> EmulatedMicrocontroller:
        """Switched on, at time 0."""
        return EmulatedMicrocontroller(
            Schema(self.settings.channels),
            {},
            machine=self.machine.simulated(),
            name=f"emulated {self.settings.name}"[:32],
            longest_valid_ms=max(500, round(2000 * self.settings.valid_for)),
            baud=self.settings.baud,
        )


class EmulatedPlatform:
    """Starts the emulation on entry, ends it on exit."""

    def __init__(
        self,
        platform: Platform,
        setup: HardwareSetup,
        *,
        seed: int = 0,
        initial: InitialState | None = None,
        faults: Sequence[Fault] = (),
        lockstep: bool = False,
    ) -> None:
        """Nothing is started yet.

        Args:
            platform: which is simulated, with its effects.
            setup: its [hardware]; ports and calibration are not used.
            seed: of its sensors' noise.
            initial: its state at time 0; level and at rest unless given.
            faults: of the line and the board.
            lockstep: time passes only as the host lets it, as fast as both can
                (`twin.lockstep`).

        Raises:
            UsageError: wiring that cannot be emulated.
        """
        self._setup = setup
        ((self._name, settings),) = _the_board(platform, setup).items()
        machine = Machine(platform, setup.measured, setup.commanded, seed, initial)
        self._board = Board(settings, machine)
        try:
            pickle.dumps(self._board)
        except (pickle.PicklingError, AttributeError, TypeError) as problem:
            raise UsageError(
                "an effect from a file of one's own cannot be emulated: it would have to travel to "
                f"another process ({problem}); simulate it with --plant sim"
            ) from problem
        self._faults, self._seed = faults, seed
        self.lockstep = lockstep
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._line: EmulatedLine | None = None

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="twin-")
        link = Path(self._folder.name) / self._name
        try:
            line = EmulatedLine(
                self._board, link, self._faults, seed=self._seed, lockstep=self.lockstep
            )
            self._line = line.__enter__()
        except BaseException:
            self._folder.cleanup()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._line is not None:
            self._line.__exit__(kind, error, trace)
        if self._folder is not None:
            self._folder.cleanup()

    @property
    def line(self) -> EmulatedLine:
        """Of the board, to be made to fail; while it runs."""
        assert self._line is not None
        return self._line

    @property
    def ports(self) -> dict[str, Path]:
        """Where each device can be opened, by its name; while it runs."""
        return {self._name: self.line.link}

    def sessions(self, host: HostTime) -> dict[str, Device]:
        """Sessions with its devices, not yet connected, that go by that time; while it runs."""
        settings = replace(self._board.settings, port=str(self.line.link))
        return {self._name: Microcontroller(settings, host)}

    @property
    def setup(self) -> HardwareSetup:
        """The wiring with these ports; while it runs."""
        return with_port(self._setup, str(self.line.link))


def with_port(setup: HardwareSetup, port: str) -> HardwareSetup:
    """The same wiring with its only device at another port.

    Raises:
        UsageError: it has several.
    """
    if len(setup.devices) != 1:
        raise UsageError(
            f"{', '.join(setup.devices)}: one port cannot be that of {len(setup.devices)} devices; "
            "write a file with [hardware] and their ports, and give --plant serial:FILE.toml"
        )
    ((name, settings),) = setup.devices.items()
    return replace(setup, devices={name: replace(settings, port=port)})


def _the_board(platform: Platform, setup: HardwareSetup) -> dict[str, MicrocontrollerSettings]:
    boards = {
        name: settings
        for name, settings in setup.devices.items()
        if isinstance(settings, MicrocontrollerSettings)
    }
    if len(boards) != 1 or len(setup.devices) != 1:
        raise UsageError(
            f"{platform.name} has {', '.join(setup.devices) or 'no device'} in its [hardware]; "
            "what can be emulated so far is one microcontroller that carries everything"
        )
    return boards
