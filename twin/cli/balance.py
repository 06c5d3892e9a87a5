"""`twin balance`: bring a machine's CM into its CR, and say what is left."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, cast

import tyro

from twin.api import BALANCING_DURATION

Triple = tuple[float, float, float]


def _arg(metavar: str) -> object:
    return tyro.conf.arg(metavar=metavar)


@dataclass(frozen=True)
class BalanceVerb:
    """Balance a machine by its sliding masses, to a stated residual torque.

    The vertical mass goes down first, so that the body hangs. Then it is made to swing, J and m r
    are identified from the swing, and the masses move: in the plane at once or under a control law,
    in height by at most half of what is left, never above the CR. In the end it floats free for two
    minutes, and what is left is stated with 95 % intervals. The machine needs `attitude`: from gyro
    and inclinometer alone the fit of a swing does not settle.

    Procedures: direct moves the masses by what was identified (000 eq. 12-15, iterated as in 004);
    masses and masses-and-coils leave the plane to a law (001; 003); adaptive begins with adaptive
    balancing under persistent excitation (000 eq. 35-37).
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    procedure: Annotated[str, _arg("NAME")] = "direct"
    """direct, masses, masses-and-coils or adaptive. What damps meanwhile is what the machine has:
    coils in a field, gyros, or wheels."""
    target: Annotated[float | None, _arg("N_M")] = None
    """Gravity torque that may be left at the worst attitude; by default that of the machine's
    paper, else that of 5 um."""
    plant: Annotated[str, _arg("sim|pty[:FILE.toml]|serial[:URL]")] = "sim"
    """Simulated; its devices emulated on a pseudo-terminal; or the real ones, as of `twin run`."""
    arm: Annotated[Literal["floating"] | None, _arg("floating")] = None
    """Let commands leave, within the rules of docs/safety.md, on the bench and on its emulation:
    the operator's word, who has looked, that the table floats."""
    lockstep: bool = False
    """With plant pty: loop and emulation wait for each other instead of keeping to the wall's
    clock. As fast as both can, and no computer is too slow for it."""
    effects: Annotated[str | None, _arg("NAME[:TARGET]=VALUE[/VALUE ...],...")] = None
    """What the simulated machine has beyond its platform; see `twin effects`."""
    offset: Annotated[Triple | None, _arg("X Y Z")] = None
    """Of the simulated machine's CM from its CR, in um; by default as its platform states."""
    random_offset: bool = False
    """Draw it instead, within the masses' reach, by the seed."""
    stages: Annotated[Triple, _arg("MM MM MM")] = (0.0, 0.0, 0.0)
    """Where the masses stand at the start, in mm; the offset is meant there."""
    runs: int = 1
    """So many machines at once, each with its own random offset and noise."""
    duration: Annotated[float, _arg("SECONDS")] = BALANCING_DURATION
    """After which it is given up."""
    seed: int = 0
    """Of all random numbers."""
    rrd: Annotated[Path | None, _arg("OUT.rrd")] = None
    """Record into this file; of several runs the first. One that exists is written anew, but never
    on pty or serial: a session cannot be flown again."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Balance; the exit code."""
        from twin.api import balance
        from twin.cli.live import LiveView
        from twin.cli.output import print_json, tell
        from twin.effects import parse_effects
        from twin.stop import Stopped

        result = balance(
            self.platform,
            procedure=self.procedure,
            target=self.target,
            effects=() if self.effects is None else parse_effects(self.effects),
            offset=None if self.offset is None else _times(1e-6, self.offset),
            random_offset=self.random_offset,
            stages=_times(1e-3, self.stages),
            runs=self.runs,
            duration=self.duration,
            plant=self.plant,
            arm=self.arm,
            lockstep=self.lockstep,
            seed=self.seed,
            rrd=self.rrd,
            watch=LiveView,
            say=tell,
        )
        if self.json:
            print_json(result.document())
        else:
            print(result)
        if result.outcome.asked and not result.done:
            raise Stopped(result.outcome.asked)
        return 0 if result.done else 1

    def kept(self) -> str:
        """What is there of a balancing that was stopped."""
        again = "balancing begins anew from where the masses stand"
        if self.rrd is None or not self.rrd.exists():
            return again
        return f"{self.rrd} holds what was recorded, if it had begun; {again}"


def _times(factor: float, values: Triple) -> Triple:
    return cast(Triple, tuple(factor * value for value in values))
