"""`twin run`: fly a platform under a control law, and record it."""

import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    from twin.flight import Flight
    from twin.loop import Outcome
    from twin.metrics import Metrics
    from twin.plant.initial import InitialState
    from twin.platform import Platform
    from twin.stream.recorder import FlightRecorder

Angles = tuple[float, float, float]


def _arg(metavar: str) -> object:
    return tyro.conf.arg(metavar=metavar)


@dataclass(frozen=True)
class RunVerb:
    """Fly a platform under a control law: simulated, emulated, real, or as a log has it.

    On hardware and on its emulation nothing leaves unless --arm says so: without it the sensors are
    read and the law is computed, and that is all. Ctrl-C stops safely; it is no emergency stop.
    Exit code 1 where the run was cut out, lost its law or failed; 0 where Ctrl-C ended it.
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    controller: Annotated[str, _arg("LAW")] = "free_float"
    """A shipped law (see `twin controllers`), the file of one's own, or tcp://HOST:PORT, where a
    law in another program is waited for (docs/link.md)."""
    gains: Annotated[tuple[str, ...], _arg("NAME=VALUE ...")] = ()
    """Gains that differ from the law's own."""
    estimator: Annotated[str | None, _arg("NAME")] = None
    """Attitude and gyro bias filtered (`filter`) or the sensors as they are (`passthrough`), by
    default the first where the machine has gyro and attitude; `inclinometer`, rates by its
    differences; `vertical_offset` and `offset`, which tell where the CM is."""
    plant: Annotated[str, _arg("sim|pty[:FILE.toml]|serial[:URL]|replay:LOG")] = "sim"
    """Simulated; its devices emulated on a pseudo-terminal; the real ones (of the platform's
    [hardware], at its ports or at that one; or those of serial:FILE.toml); or a log played as if it
    were these."""
    arm: Annotated[Literal["floating", "captured"] | None, _arg("floating|captured")] = None
    """Let commands leave, within the rules of docs/safety.md. The word is the operator's, who has
    looked: whether the table floats, or is captured (air off or clamped)."""
    lockstep: bool = False
    """With plant pty: loop and emulation wait for each other instead of keeping to the wall's
    clock. As fast as both can, and no computer is too slow for it."""
    reference: Annotated[str | None, _arg("REFERENCE")] = None
    """`hold[:ROLL,PITCH,YAW]`, `slew:ROLL,PITCH,YAW[@RATE]` or `multisine[:AMPLITUDE[@FREQUENCY]]`,
    in degrees and hertz; by default what the law is usually given (its class says `reference`, and
    `twin controllers` tells it)."""
    identified: Annotated[Path | None, _arg("FILE.json")] = None
    """What `twin identify LOG --json` wrote: on the bench, the flight is first simulated at all
    corners of its 95 % set, and refused where the guard would cut it out."""
    effects: Annotated[str | None, _arg("NAME[:TARGET]=VALUE[/VALUE ...],...")] = None
    """What the simulated machine has beyond its platform, as in
    `clock_lag:wheel_speed=0.17,gyro_bias=1e-3/0/0`; see `twin effects`."""
    duration: Annotated[float | None, _arg("SECONDS")] = None
    """By default 60, or the whole log that is replayed."""
    attitude: Annotated[Angles, _arg("ROLL PITCH YAW")] = (0.0, 0.0, 0.0)
    """At the start, in degrees; a hinge takes the first."""
    rate: Annotated[Angles, _arg("X Y Z")] = (0.0, 0.0, 0.0)
    """Body rates x, y, z at the start, in degrees a second; a hinge takes the first."""
    velocity: Annotated[Angles, _arg("X Y Z")] = (0.0, 0.0, 0.0)
    """Of a body that is thrown, or slides on its stage, at the start: in the room, in m/s."""
    seed: int = 0
    """Of all random numbers."""
    realtime: bool = False
    """Keep to the wall's clock instead of going as fast as the computer can."""
    rrd: Annotated[Path | None, _arg("OUT.rrd")] = None
    """Record into this file. One that exists is written anew, but never by a run of pty or serial:
    a session cannot be flown again."""
    spawn: bool = False
    """Show it live in the Rerun viewer."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Fly; the exit code."""
        from twin.cli.output import check_writable, print_json, tell
        from twin.clock import SimulatedClock, WallClock
        from twin.effects import parse_effects
        from twin.flight import prepare
        from twin.loop import Ended, Observer
        from twin.metrics import Metrics, settled
        from twin.plant.guard.guarded import Held
        from twin.rehearsal import check_lean, identified_box
        from twin.report.outcomes import flown
        from twin.stop import Stopped
        from twin.stream.provenance import provenance
        from twin.stream.recorder import FileRecorder, FlightRecorder

        effects = () if self.effects is None else parse_effects(self.effects)
        self._check()
        if self.rrd is not None:
            kind, _, log = self.plant.partition(":")
            replayed = (Path(log),) if kind == "replay" else ()
            check_writable(self.rrd, ".rrd", anew=not self._on_bench, read=replayed)
        with ExitStack() as stack:
            recorder = None
            if self.rrd is not None or self.spawn:
                # early, so that its process comes up while the machine is compiled
                recorder = stack.enter_context(FileRecorder(self.rrd, viewer=self.spawn))
            flight = prepare(
                self.platform,
                controller=self.controller,
                estimator=self.estimator,
                plant=self.plant,
                reference=self.reference,
                duration=self.duration,
                seed=self.seed,
                initial=self._initial(),
                gains=_gains(self.gains),
                effects=effects,
                lockstep=self.lockstep,
                held=None if self.arm is None else Held(self.arm),
                tell=tell,
            )
            warnings = flight.warnings()
            self._announce(flight, warnings)
            if self.identified is not None:
                tell(check_lean(flight, identified_box(self.identified)))
            metrics = Metrics(flight.platform, settle=settled(flight.duration))
            black_box = FlightRecorder(flight.plant)
            observers: list[Observer] = [metrics, black_box]
            if recorder is not None:
                facts = provenance(flight.platform, seed=self.seed, command=sys.argv)
                recorder.start(flight.platform, facts)
                observers.append(recorder)
            # last, for a machine on its bench moves from now on
            stack.enter_context(flight.plant)
            if flight.bench is not None:
                from twin.cli.live import LiveView

                observers.append(stack.enter_context(LiveView(flight.bench, flight.duration)))
            clock = WallClock() if self.realtime else SimulatedClock()
            outcome = flight.fly(clock, observers, tell)
        told = [] if flight.bench is None else flight.bench.told()

        kept = self._keep(black_box, flight.platform)
        if self.json:
            print_json(self._document(outcome, metrics, warnings))
        else:
            row = {name: value[0] for name, value in metrics.rows().items()}
            lines = flown(flight.platform, outcome, row, metrics.settle)
            print("\n".join([*lines, *told, *self._where(kept)]))
        if outcome.asked not in (0, signal.SIGINT):  # a terminal is gone, or a system goes down
            raise Stopped(outcome.asked)
        return 0 if outcome.ended is Ended.done or outcome.asked else 1

    def kept(self) -> str:
        """What is there of a run that was stopped before its law began, or at once."""
        if self.rrd is None or not self.rrd.exists():
            return "nothing was recorded"
        return f"{self.rrd} holds what was recorded; a run that had not begun has not changed it"

    def _check(self) -> None:
        from twin.errors import UsageError

        if self.identified is not None and not self._on_bench:
            raise UsageError(
                f"--identified is for a machine on its bench; plant {self.plant} has no guard"
            )
        moved = any((*self.attitude, *self.rate, *self.velocity))
        if self.plant.startswith("serial") and moved:
            raise UsageError(
                "--attitude, --rate and --velocity are of a simulated machine; a real one starts "
                "as it stands: leave them out"
            )

    def _initial(self) -> "InitialState":
        import numpy as np

        from twin.plant.initial import InitialState
        from twin.rotation import from_euler_zyx

        roll, pitch, yaw = np.radians(self.attitude)
        rate = np.radians(self.rate)
        return InitialState(
            attitude=from_euler_zyx(yaw, pitch, roll),
            rate_body=rate,
            velocity=np.array(self.velocity),
            joint_angle=float(roll),
            joint_rate=float(rate[0]),
        )

    def _announce(self, flight: "Flight", warnings: Sequence[str]) -> None:
        from twin.estimators import usual_estimator

        reference = self.reference or flight.controller.reference
        estimator = self.estimator or usual_estimator(flight.platform)
        lines = [
            f"{flight.platform.name}: {self.controller} with estimator {estimator}, "
            f"reference {reference}, {flight.duration:g} s at {flight.platform.control_rate:g} Hz, "
            f"plant {self.plant}, {self._seeded()}",
            *(f"with {effect.words()}" for effect in flight.effects),
            *(f"warning: {warning}" for warning in warnings),
        ]
        print("\n".join(lines), file=sys.stderr, flush=True)

    @property
    def _on_bench(self) -> bool:
        return self.plant.partition(":")[0] in ("pty", "serial")

    def _seeded(self) -> str:
        armed = f", armed as {self.arm}" if self.arm else ", not armed: nothing leaves"
        seed = "" if self.plant.startswith("serial") else f"seed {self.seed}"
        return (seed + (armed if self._on_bench else "")).removeprefix(", ")

    def _keep(self, black_box: "FlightRecorder", platform: "Platform") -> list[Path]:
        """Write the flight record of every run that was stopped."""
        from twin.stream.runfile import write_recording

        kept: list[Path] = []
        for run, record in black_box.records.items():
            # beside the recording, else where one stands, whatever folder the machine is in
            stem = self.rrd or Path(f"{Path(self.platform).resolve().name.replace(':', '-')}.rrd")
            path = stem.with_name(f"{stem.stem}.flight-{run}.rrd")
            if self._on_bench:
                path = _unused(path)
            write_recording(record, path, platform)
            kept.append(path)
        return kept

    def _where(self, kept: Sequence[Path]) -> list[str]:
        lines = [f"the last seconds before it was stopped: {path}" for path in kept]
        if self.rrd is not None:
            lines.append(f"recorded in {self.rrd}: look at it with `twin view {self.rrd}`")
        return lines

    def _document(
        self, outcome: "Outcome", metrics: "Metrics", warnings: Sequence[str]
    ) -> dict[str, Any]:
        row = {name: value[0] for name, value in metrics.rows().items()}
        return {
            "ended": outcome.ended.value,
            "reason": outcome.reason or None,
            "duration": outcome.duration,
            "overruns": outcome.timing.overruns,
            "warnings": list(warnings),
            "metrics": row,
            "seconds": outcome.timing.seconds,
            "recording": self.rrd,
        }


def _unused(path: Path) -> Path:
    """That path, or with the first number at which no file stands."""
    numbered = (path.with_name(f"{path.stem}-{number}{path.suffix}") for number in count(2))
    return next(item for item in chain((path,), numbered) if not item.exists())


def _gains(words: Sequence[str]) -> dict[str, float]:
    from twin.errors import UsageError

    gains: dict[str, float] = {}
    for word in words:
        name, _, number = word.partition("=")
        try:
            gains[name] = float(number)
        except ValueError:
            raise UsageError(f"gain {word!r}: give NAME=VALUE, as in proportional=5") from None
    return gains
