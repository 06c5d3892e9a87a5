"""The verbs of the bench: `twin hardware`, `twin emulate`, `twin doctor`."""

import signal
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    from twin.bench import Bench
    from twin.platform import Platform


Angles = tuple[float, float, float]


@dataclass(frozen=True)
class Emulate:
    """Emulate a machine: its devices on pseudo-terminals, connected to its simulation.

    The printed ports behave as the devices on the bench do, for `twin run PLATFORM --plant
    serial:PORT` or for any other program. Time is the wall clock, bytes arrive at the line's rate,
    set-points expire. End it with Ctrl-C.
    """

    platform: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder, with [hardware]; `:VARIANT` may follow."""
    effects: Annotated[str | None, tyro.conf.arg(metavar="NAME[:TARGET]=VALUE[/VALUE ...],...")] = (
        None
    )
    """Effects that the machine has beyond its platform; see `twin effects`."""
    attitude: Annotated[Angles, tyro.conf.arg(metavar="ROLL PITCH YAW")] = (0.0, 0.0, 0.0)
    """Initial attitude, in degrees."""
    duration: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None
    """Duration of the emulation; by default until Ctrl-C."""
    seed: int = 0
    """Seed of the sensors' noise."""
    replay: Annotated[tuple[str, ...], tyro.conf.arg(metavar="DEVICE=FILE")] = ()
    """Devices that repeat what they sent on a port that was opened as spy://PORT?file=FILE."""

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


Action = Literal["status", "home", "jog", "park", "zero", "spin-down"]

_OVER_THE_TRAVEL = ("home", "park", "zero")


@dataclass(frozen=True)
class Hardware:
    """Look at a machine on its bench, home it, move one stage, bring it to rest.

    status prints each device with its name, line and clock, the newest value of each stream and
    its age, and whether it can be armed. home lets the stages seek their home switches; zero moves
    them to the middle; park does too, but moves vertical stages to their lowest place. jog moves
    one stage by some millimetres and prints the result: on a floating table, whether it turned as
    the model predicts, which tests every sign in [hardware]. spin-down brakes the wheels.

    All of it goes through the guard and its limits (docs/safety.md). What runs a mass over its
    travel or brakes a wheel is done on a captured table only. Ctrl-C stops safely; it is no
    emergency stop.
    """

    platform: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder, with [hardware]; `:VARIANT` may follow."""
    action: tyro.conf.Positional[Action]
    """What to do."""
    stage: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[STAGE]")] = None
    """To jog, by its name."""
    distance: Annotated[float | None, tyro.conf.Positional, tyro.conf.arg(metavar="[MM]")] = None
    """To jog it by, in mm, plus or minus."""
    plant: Annotated[str, tyro.conf.arg(metavar="pty|serial[:URL]")] = "serial"
    """The machine at the ports of its [hardware], or at another port, or as wired by
    serial:FILE.toml; pty is its emulation, to practise on."""
    floating: bool = False
    """The operator looks and states that the table floats. A jog is allowed."""
    captured: bool = False
    """The operator looks and states that the table is captured (air off or clamped)."""
    lockstep: bool = False
    """With plant pty: this and the emulation wait for each other, as fast as both can."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Do it; the exit code."""
        from twin.bench import open_bench
        from twin.cli.output import print_json
        from twin.plant.guard.guarded import Held
        from twin.platform import load_platform

        machine = load_platform(self.platform)
        self._check(machine)
        held = Held.captured if self.captured else Held.floating if self.floating else None
        with open_bench(machine, self.plant, held=held, lockstep=self.lockstep) as bench:
            document, lines = self._done(bench)
        if self.json:
            print_json({"action": self.action, **document})
        else:
            print("\n".join(lines))
        return 0

    def _done(self, bench: "Bench") -> tuple[dict[str, Any], list[str]]:
        """What is printed, as a document and as lines."""
        from twin.service.jog import jog
        from twin.service.stages import gather, home, parked, spin_down
        from twin.service.status import status

        if self.action == "status":
            result = status(bench)
            return asdict(result) | {"would_be_armed": not result.refusals}, result.words()
        print(
            f"{bench.platform.name}: {self.action}, plant {self.plant}, "
            f"{'captured' if self.captured else 'floating'}",
            file=sys.stderr,
            flush=True,
        )
        if self.action == "home":
            lines = home(bench)
        elif self.action == "jog":
            assert self.stage is not None
            assert self.distance is not None
            lines = jog(bench, self.stage, 1e-3 * self.distance)
        elif self.action == "spin-down":
            lines = spin_down(bench)
        else:
            lowest = parked(bench.platform)
            lines = gather(bench, lowest if self.action == "park" else 0.0 * lowest, self.action)
        return {"told": lines, "stage_position": _positions(bench)}, [*lines, *bench.messages()]

    def _check(self, machine: "Platform") -> None:
        from twin.errors import SafetyError, UnknownName, UsageError
        from twin.service.stages import stage_named

        kind = self.plant.partition(":")[0]
        if kind not in ("pty", "serial"):
            known = ("pty", "pty:FILE.toml", "serial", "serial:URL")
            raise UnknownName("plant", self.plant, known)
        if self.lockstep and kind != "pty":
            raise UsageError(
                f"--lockstep is for plant pty; {self.plant} has no emulation to wait for"
            )
        if self.floating and self.captured:
            raise UsageError("--floating and --captured: it is one or the other; look again")
        if self.action == "jog":
            if self.stage is None or self.distance is None:
                raise UsageError("jog which stage, how far? give jog STAGE MM, as in jog s1 0.5")
            stage_named(machine, self.stage)
        elif self.stage is not None:
            raise UsageError(f"{self.action} takes no stage; leave out {self.stage!r}")
        if self.action in _OVER_THE_TRAVEL and not machine.stages:
            raise UsageError(f"{machine.name} has no stages to {self.action}")
        if self.action == "jog" and not (self.floating or self.captured):
            raise SafetyError(
                "jog refused: it is not stated whether the table floats",
                "look, and say --floating or --captured",
            )
        if self.action in _OVER_THE_TRAVEL and not self.captured:
            raise SafetyError(
                f"{self.action} refused: a mass that runs over its travel throws a floating table",
                "capture it (air off or clamped), look, and say --captured",
            )
        if self.action == "spin-down" and not self.captured:
            raise SafetyError(
                "spin-down refused: the wheels' momentum would go into a floating table",
                "capture it (air off or clamped), look, and say --captured",
            )


def _positions(bench: "Bench") -> list[float] | None:
    place = bench.guard.seen.stage_position
    return None if place is None else place.tolist()


@dataclass(frozen=True)
class Doctor:
    """Check that this computer is fit to fly a machine: ports, adapters, permissions, lateness.

    Reports whether each port of the machine exists and may be opened, the latency of USB adapters,
    whether a process may get real-time priority, and the lateness of ticks. Nothing is opened or
    changed. The exit code is 1 where a finding is bad, and 0 where it is only poor.
    """

    platform: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[PLATFORM]")] = (
        None
    )
    """Machine whose ports are checked; without it, only the computer is checked."""
    seconds: Annotated[float, tyro.conf.arg(metavar="SECONDS")] = 3.0
    """Duration of the timing of ticks."""
    rate: Annotated[float, tyro.conf.arg(metavar="HZ")] = 50.0
    """Rate of the ticks."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Examine; the exit code."""
        import sys

        from twin.cli.output import print_json
        from twin.errors import UsageError
        from twin.platform import load_platform

        if not 0.0 < self.seconds <= 3600.0 or not 1.0 <= self.rate <= 1000.0:
            raise UsageError(
                f"--seconds {self.seconds:g} --rate {self.rate:g}; give up to an hour, at 1 to "
                "1000 Hz"
            )
        if sys.platform == "win32":
            raise UsageError("twin doctor looks at Linux; on Windows look at the device manager")
        from twin.plant.hardware_setup import read_hardware
        from twin.service.doctor import Verdict, examine

        ports: dict[str, str] = {}
        if self.platform is not None:
            devices = read_hardware(load_platform(self.platform)).devices
            ports = {name: settings.port for name, settings in devices.items()}
        findings = examine(ports, seconds=self.seconds, rate=self.rate)
        if self.json:
            print_json([asdict(item) | {"verdict": item.verdict.value} for item in findings])
        else:
            for item in findings:
                print(f"{item.verdict.value:<5} {item.what}: {item.sentence}")
        return 1 if any(item.verdict is Verdict.bad for item in findings) else 0
