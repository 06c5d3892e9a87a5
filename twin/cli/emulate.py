"""`twin emulate`: a platform's devices on pseudo-terminals, until Ctrl-C."""

import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

Angles = tuple[float, float, float]


@dataclass(frozen=True)
class Emulate:
    """Stand for a machine: its devices on pseudo-terminals, its simulation behind them.

    What opens the printed port meets the board as it is on the bench: our driver with `twin run
    PLATFORM --plant serial:PORT`, or a program of one's own that is to be tried. Time is the
    wall's, bytes come at the line's rate, set-points run out. It ends with Ctrl-C.
    """

    platform: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder, with [hardware]; `:VARIANT` may follow."""
    effects: Annotated[str | None, tyro.conf.arg(metavar="NAME[:TARGET]=VALUE[/VALUE ...],...")] = (
        None
    )
    """What the machine has beyond its platform; see `twin effects`."""
    attitude: Annotated[Angles, tyro.conf.arg(metavar="ROLL PITCH YAW")] = (0.0, 0.0, 0.0)
    """At the start, in degrees."""
    duration: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None
    """End by itself after this."""
    seed: int = 0
    """Of the sensors' noise."""
    replay: Annotated[tuple[str, ...], tyro.conf.arg(metavar="DEVICE=FILE")] = ()
    """Devices that say again what they once said on a port that was opened as
    spy://PORT?file=FILE."""

    def kept(self) -> str:
        """Of an emulation that was stopped."""
        return "its ports are closed"

    def run(self) -> int:
        """Emulate; the exit code."""
        import numpy as np

        from twin.effects import parse_effects, with_effects
        from twin.emulate.platform import EmulatedPlatform
        from twin.emulate.replayed import spied
        from twin.plant.hardware_setup import read_hardware
        from twin.plant.initial import InitialState
        from twin.platform import load_platform
        from twin.rotation import from_euler_zyx
        from twin.stop import Stopped, until

        effects = () if self.effects is None else parse_effects(self.effects)
        machine = with_effects(load_platform(self.platform), effects)
        roll, pitch, yaw = np.radians(self.attitude)
        initial = InitialState(attitude=from_euler_zyx(yaw, pitch, roll))
        setup = read_hardware(machine)
        said = {name: spied(Path(file)) for name, file in map(_named, self.replay)}
        with EmulatedPlatform(
            machine, setup, seed=self.seed, initial=initial, said=said
        ) as emulation:
            for name, port in emulation.ports.items():
                print(f"{name}: {port}", flush=True)
            print(f"{machine.name} is emulated until Ctrl-C", file=sys.stderr, flush=True)
            duration = np.inf if self.duration is None else self.duration
            try:
                dead = until(lambda: not emulation.line.alive, duration)
            except Stopped as request:
                if request.number != signal.SIGINT:
                    raise
                return 0
            if dead:
                print("twin: the emulation has ended by itself; please report it", file=sys.stderr)
                return 1
        return 0


def _named(word: str) -> tuple[str, str]:
    from twin.errors import UsageError

    name, _, file = word.partition("=")
    if not file:
        raise UsageError(f"replay {word!r}: give DEVICE=FILE, as in imu=imu.spy")
    return name, file
