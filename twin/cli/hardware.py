"""`twin hardware`: what a laboratory does with its machine before and after a session."""

import sys
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    from twin.bench import Bench
    from twin.platform import Platform

Action = Literal["status", "home", "jog", "park", "zero", "spin-down"]

_OVER_THE_TRAVEL = ("home", "park", "zero")


@dataclass(frozen=True)
class Hardware:
    """Look at a machine on its bench, home it, move one stage, bring it to rest.

    status tells each device, its name, line and clock, the newest value of each stream and its age,
    and whether it would be armed. home lets the stages seek their home switches; zero brings them
    to the middle, park too, but those that run up and down to their lowest place. jog moves one
    stage by some millimetres and tells what came of it: on a floating table whether it turned as
    the model predicts, which is the test of every sign in [hardware]. spin-down brakes the wheels.

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
    """The table floats: the word of the operator, who has looked. A jog is allowed."""
    captured: bool = False
    """The table is captured (air off or clamped): the word of the operator, who has looked."""
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
            told = home(bench)
        elif self.action == "jog":
            assert self.stage is not None
            assert self.distance is not None
            told = jog(bench, self.stage, 1e-3 * self.distance)
        elif self.action == "spin-down":
            told = spin_down(bench)
        else:
            lowest = parked(bench.platform)
            told = gather(bench, lowest if self.action == "park" else 0.0 * lowest, self.action)
        return {"told": told, "stage_position": _positions(bench)}, [*told, *bench.told()]

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
                "jog refused: nobody has said whether the table floats",
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
