"""The verbs that fly a machine: `twin run`, `twin balance`."""

import signal
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import tyro

from twin.api import BALANCING_DURATION

if TYPE_CHECKING:
    from twin.flight import Run


Angles = tuple[float, float, float]


def _arg(metavar: str) -> object:
    return tyro.conf.arg(metavar=metavar)


@dataclass(frozen=True)
class RunVerb:
    """Fly a platform under a control law: simulated, emulated, real, or replayed from a log; or
    several simulated ones together, connected by radio (docs/formations.md).

    On hardware and on its emulation no command is sent without --arm: the sensors are read and the
    law is computed. Ctrl-C stops safely; it is no emergency stop.
    Exit code 1 where the run was cut out, lost its law or failed; 0 where Ctrl-C ended it.
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    others: Annotated[tuple[str, ...], tyro.conf.Positional, _arg("PLATFORM ...")] = ()
    """Further machines of the same run, each under the same law unless --each says otherwise.
    `NAME=PLATFORM` names one, where two are of a kind."""
    controller: Annotated[str, _arg("LAW")] = "free_float"
    """A shipped law (see `twin controllers`), a file, or tcp://HOST:PORT to wait for a law in
    another program (docs/link.md)."""
    gains: Annotated[tuple[str, ...], _arg("NAME=VALUE ...")] = ()
    """Gains that differ from the law's defaults."""
    estimator: Annotated[str | None, _arg("NAME")] = None
    """`filter` (gyro and attitude), `mekf` (gyro with accelerometer, inclinometer, magnetometer or
    camera), `inclinometer` (its angles and their differences), `passthrough` (the sensors as they
    are), `offset` and `vertical_offset` (these also estimate the CM). By default the first for
    which the machine has the sensors."""
    plant: Annotated[str, _arg("sim|pty[:FILE.toml]|serial[:URL]|replay:LOG")] = "sim"
    """Simulated; its devices emulated on a pseudo-terminal; the real devices (of the platform's
    [hardware], at its ports or at that one; or those of serial:FILE.toml); or a log, replayed as if
    it were the machine."""
    arm: Annotated[Literal["floating", "captured"] | None, _arg("floating|captured")] = None
    """Send commands, within the rules of docs/safety.md. The operator looks and states whether the
    table floats or is captured (air off or clamped)."""
    lockstep: bool = False
    """With plant pty: loop and emulation wait for each other instead of keeping to the wall's
    clock, so that the speed of the computer does not matter."""
    reference: Annotated[str | None, _arg("REFERENCE")] = None
    """`hold[:ROLL,PITCH,YAW]`, `slew:ROLL,PITCH,YAW[@RATE]`, `multisine[:AMPLITUDE[@FREQUENCY]]`,
    `sine:AXES,AMPLITUDE@FREQUENCY[,PHASE]`, `square:` likewise or
    `chirp:AXES,AMPLITUDE@FROM,TO,SECONDS` about x, y and z (several joined by +), in degrees and
    hertz, or 20s for a period; or a table of attitudes over time, FILE.csv or FILE.parquet
    (docs/manoeuvres.md). Of a machine that travels `place:X,Y` or
    `move:X,Y[@ACCELERATION[,SPEED]]` in metres and seconds, or both as in
    `hold:0,0,30+move:1,0`. By default the law's usual reference, which `twin controllers`
    lists."""
    torque: Annotated[str | None, _arg("[wheels:|gyros:|thrusters:]PROFILE")] = None
    """In place of a law: torque on the body in open loop, by those actuators or the first of these
    that the machine has. PROFILE is a table of torques over time, or waves as above in N m."""
    identified: Annotated[Path | None, _arg("FILE.json")] = None
    """What `twin identify LOG --json` wrote: on the bench, the flight is first simulated at all
    corners of its 95 % set, and refused where the guard would cut it out."""
    effects: Annotated[str | None, _arg("NAME[:TARGET]=VALUE[/VALUE ...],...")] = None
    """Effects that the simulated machine has beyond its platform, as in
    `clock_lag:wheel_speed=0.17,gyro_bias=1e-3/0/0`; see `twin effects`."""
    radio: Annotated[str | None, _arg("delay=S,loss=SHARE,rate=HZ|off")] = None
    """Between several machines: how late messages come, which share is lost, how many a machine
    sends in a second; by default one at each tick, at once, and none is lost."""
    each: Annotated[tuple[str, ...], _arg("NAME.OPTION=VALUE ...")] = ()
    """What differs for one of several machines: controller, gains (NAME=VALUE,...), reference,
    torque, estimator, effects, attitude, rate, velocity (with commas between, as the options of
    these names), origin=X,Y (where its zero of place is in the room [m]), hears=NAME,..."""
    duration: Annotated[float | None, _arg("SECONDS")] = None
    """By default 60, the whole log that is replayed, or to the end of a table that states
    reference or torque."""
    attitude: Annotated[Angles, _arg("ROLL PITCH YAW")] = (0.0, 0.0, 0.0)
    """Initial attitude, in degrees; a hinge takes the first."""
    rate: Annotated[Angles, _arg("X Y Z")] = (0.0, 0.0, 0.0)
    """Initial body rates x, y, z, in degrees a second; a hinge takes the first."""
    velocity: Annotated[Angles, _arg("X Y Z")] = (0.0, 0.0, 0.0)
    """Initial velocity of a body that is thrown or slides on its stage, in world axes, in m/s."""
    seed: int = 0
    """Seed of all random numbers."""
    realtime: bool = False
    """Keep to the wall clock instead of running as fast as the computer can. On a bench, which does
    so anyway, the loop gets SCHED_FIFO, locked memory and no garbage collection, as far as the
    computer permits; what it does not permit is reported."""
    rrd: Annotated[Path | None, _arg("OUT.rrd")] = None
    """Record into this file. An existing file is overwritten, except by a run on pty or serial,
    because a session cannot be flown again."""
    spawn: bool = False
    """Show it live in the Rerun viewer."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Fly; the exit code."""
        from twin.cli.output import print_json, tell
        from twin.errors import TwinError
        from twin.loop import Ended
        from twin.report.outcomes import flown
        from twin.stop import Stopped

        if self.others:
            return self._fly_several()
        self._check_single()
        broken: TwinError | Stopped | None = None
        try:
            run = self._fly()
        except (TwinError, Stopped) as problem:
            if problem.run is None:
                raise
            broken, run = problem, problem.run
        try:
            kept = self._keep(run)
        except (TwinError, OSError) as problem:
            tell(f"twin: the last seconds could not be kept: {problem}")
            kept = []
        if isinstance(broken, TwinError) and broken.outcome is None:
            raise broken  # it never flew
        if self.json:
            print_json({**run.document(), "recording": self.rrd, "records": kept})
        else:
            lines = flown(run.platform, run.outcome, run.metrics, run.settle)
            print("\n".join([*lines, *run.notes, *self._where(kept)]))
        if broken is not None:
            raise broken
        signalled = run.outcome.asked
        if signalled not in (0, signal.SIGINT):  # a terminal is gone, or a system goes down
            raise Stopped(signalled)
        return 0 if run.outcome.ended is Ended.done or signalled else 1

    def _fly(self) -> "Run":
        from twin.api import fly
        from twin.cli.live import LiveView
        from twin.cli.output import progress, tell
        from twin.effects import parse_effects

        with progress():
            return fly(
                self.platform,
                self.controller,
                gains=_gains(self.gains),
                reference=self.reference,
                torque=self.torque,
                duration=self.duration,
                effects=() if self.effects is None else parse_effects(self.effects),
                attitude=_radians(self.attitude),
                rate=_radians(self.rate),
                velocity=self.velocity,
                estimator=self.estimator,
                plant=self.plant,
                arm=self.arm,
                identified=self.identified,
                lockstep=self.lockstep,
                realtime=self.realtime,
                seed=self.seed,
                rrd=self.rrd,
                viewer=self.spawn,
                keep=False,
                watch=LiveView,
                say=tell,
            )

    def _check_single(self) -> None:
        from twin.errors import UsageError

        for option, given in (("--radio", self.radio), ("--each", self.each)):
            if given:
                raise UsageError(f"{option} is for several machines; name more than one")

    def _fly_several(self) -> int:
        """Fly several machines; the exit code."""
        from twin.cli.output import print_json, progress, tell
        from twin.errors import UsageError
        from twin.formation import fly_formation
        from twin.report.outcomes import flown_together

        of_single = {
            "--arm": self.arm,
            "--identified": self.identified,
            "--lockstep": self.lockstep,
        }
        refused = [option for option, given in of_single.items() if given]
        if self.plant != "sim" or refused:
            option = "--plant " + self.plant if self.plant != "sim" else refused[0]
            raise UsageError(
                f"{option} is for one machine; several fly together in simulation: drop it"
            )
        words = (self.platform, *self.others)
        named = [word.partition("=") if "=" in word else (word, "=", word) for word in words]
        names = [name for name, _, _ in named]
        if twice := [name for name in names if names.count(name) > 1]:
            raise UsageError(
                f"two machines are called {twice[0]!r}: name each, as in a={twice[0]} b={twice[0]}"
            )
        common = {
            "torque": self.torque,
            "effects": self.effects or (),
            "attitude": _radians(self.attitude),
            "rate": _radians(self.rate),
            "velocity": self.velocity,
        }
        each = _each(self.each)
        with progress():
            result = fly_formation(
                {name: platform for name, _, platform in named},
                self.controller,
                radio=self.radio or "",
                each={name: common for name in names}
                | {n: common | settings for n, settings in each.items()},
                gains=_gains(self.gains),
                reference=self.reference,
                estimator=self.estimator,
                duration=self.duration,
                realtime=self.realtime,
                seed=self.seed,
                rrd=self.rrd,
                viewer=self.spawn,
                keep=False,
                say=tell,
            )
        if self.json:
            print_json({**result.document(), "recording": self.rrd})
        else:
            print("\n".join(flown_together(result)))
            if self.rrd is not None:
                print(
                    f"recorded in {self.rrd}: look at it with `twin view {self.rrd}`, "
                    f"and at one machine's log with `twin show {self.rrd}#{names[0]}`"
                )
        signalled = next(
            (run.outcome.asked for run in result.runs.values() if run.outcome.asked), 0
        )
        if signalled not in (0, signal.SIGINT):
            from twin.stop import Stopped

            raise Stopped(signalled)
        return 0 if result.ended == "done" or signalled else 1

    def kept(self) -> str:
        """What a run leaves on disk that was stopped before its law started."""
        if self.rrd is None or not self.rrd.exists():
            return "nothing was recorded"
        return f"{self.rrd} holds what was recorded; a run that had not begun has not changed it"

    def _keep(self, run: "Run") -> list[Path]:
        """Write the last seconds of every run that was stopped."""
        from twin.stream.runfile import write_recording

        records = {f"flight-{number}": record for number, record in run.last_seconds.items()}
        # without a recording only where it is all that there is of a flight
        if run.first_use is not None and (self.rrd is not None or not run.outcome.timing.ticks):
            records["first-use"] = run.first_use
        kept: list[Path] = []
        for what, record in records.items():
            # beside the recording, else where one stands, whatever folder the machine is in
            stem = self.rrd or Path(f"{Path(self.platform).resolve().name.replace(':', '-')}.rrd")
            path = stem.with_name(f"{stem.stem}.{what}.rrd")
            if run.bench:
                path = _unused(path)
            write_recording(record, path, run.platform)
            kept.append(path)
        return kept

    def _where(self, kept: Sequence[Path]) -> list[str]:
        of = {False: "the last seconds before it was stopped", True: "the first use of actuators"}
        lines = [f"{of['.first-use' in path.name]}: {path}" for path in kept]
        if self.rrd is not None:
            lines.append(f"recorded in {self.rrd}: look at it with `twin view {self.rrd}`")
        return lines


def _radians(angles: Angles) -> Angles:
    import numpy as np

    roll, pitch, yaw = np.radians(angles)
    return float(roll), float(pitch), float(yaw)


def _each(words: Sequence[str]) -> dict[str, dict[str, object]]:
    """Settings of `twin.formation.Seat` by machine, of NAME.OPTION=VALUE."""
    from twin.errors import UsageError

    each: dict[str, dict[str, object]] = {}
    for word in words:
        place, _, text = word.partition("=")
        name, _, option = place.rpartition(".")
        if not name:
            raise UsageError(f"--each {word!r}: give NAME.OPTION=VALUE, as in whorl2.rate=0,0,1")
        value: object = text
        if option in ("attitude", "rate"):
            value = _radians(_numbers(word, text))
        elif option == "velocity":
            value = _numbers(word, text)
        elif option == "origin":
            value = _numbers(word, text if text.count(",") == 2 else f"{text},0")
        elif option == "gains":
            value = _gains(text.split(","))
        elif option == "hears":
            value = [other for other in text.split(",") if other]
        each.setdefault(name, {})[option] = value
    return each


def _numbers(word: str, text: str) -> Angles:
    from twin.errors import UsageError

    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--each {word!r}: give three numbers with commas between") from None
    return x, y, z


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


Triple = tuple[float, float, float]


@dataclass(frozen=True)
class BalanceVerb:
    """Balance a machine by its sliding masses, to a stated residual torque.

    The vertical mass goes down first, so that the body hangs. Then it is made to swing, J and m r
    are identified from the swing, and the masses move: in the plane at once or under a control law,
    in height by at most half of the remaining offset, never above the CR. In the end it floats free
    for two minutes, and the residual torque is stated with 95 % intervals. Without `attitude` an
    inclinometer or an accelerometer beside the gyro shows the vertical; m r then comes from a
    Kalman filter with J as stated.

    Procedures: direct moves the masses by what was identified (000 eq. 12-15, iterated as in 004);
    masses and masses-and-coils leave the plane to a law (001; 003), masses-and-filter too, and the
    height to a Kalman filter of the offset (001's two steps); adaptive begins with adaptive
    balancing under persistent excitation (000 eq. 35-37).
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    procedure: Annotated[str, _arg("NAME")] = "direct"
    """direct, masses, masses-and-filter, masses-and-coils or adaptive. The motion is damped by the
    actuators that the machine has: coils in a field, gyros, or wheels."""
    target: Annotated[float | None, _arg("N_M")] = None
    """Largest gravity torque at the end, at the worst attitude, in N m; by default that of the
    machine's paper, else that of an offset of 5 um."""
    plant: Annotated[str, _arg("sim|pty[:FILE.toml]|serial[:URL]")] = "sim"
    """Simulated; its devices emulated on a pseudo-terminal; or the real ones, as of `twin run`."""
    arm: Annotated[Literal["floating"] | None, _arg("floating")] = None
    """Send commands, within the rules of docs/safety.md, on the bench and on its emulation. The
    operator looks and states that the table floats."""
    lockstep: bool = False
    """With plant pty: loop and emulation wait for each other instead of keeping to the wall's
    clock, so that the speed of the computer does not matter."""
    effects: Annotated[str | None, _arg("NAME[:TARGET]=VALUE[/VALUE ...],...")] = None
    """Effects that the simulated machine has beyond its platform; see `twin effects`."""
    offset: Annotated[Triple | None, _arg("X Y Z")] = None
    """The simulated machine's CM from its CR, in um; by default as its platform states."""
    random_offset: bool = False
    """Draw the offset at random instead, within the masses' reach."""
    stages: Annotated[Triple, _arg("MM MM MM")] = (0.0, 0.0, 0.0)
    """Initial positions of the masses, in mm; the offset is that at these positions."""
    runs: int = 1
    """Number of machines flown at once, each with a random offset and noise."""
    duration: Annotated[float, _arg("SECONDS")] = BALANCING_DURATION
    """Time limit."""
    seed: int = 0
    """Seed of all random numbers."""
    rrd: Annotated[Path | None, _arg("OUT.rrd")] = None
    """Record into this file; of several runs the first. An existing file is overwritten, except on
    pty or serial, because a session cannot be flown again."""
    report: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page with figures; an existing file is overwritten."""
    figures: Annotated[Path | None, _arg("DIR")] = None
    """Write the page's figures as SVG and PDF and its tables as CSV into a folder."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Balance; the exit code."""
        from twin.api import balance
        from twin.cli.live import LiveView
        from twin.cli.output import print_json, print_written, progress, tell
        from twin.effects import parse_effects
        from twin.files import check_folder, check_writable

        # before the flight: Ctrl-C leaves few seconds to print what came of it
        from twin.report.results import document_of, sentences_of, write_figures
        from twin.stop import Stopped

        if self.report is not None:
            check_writable(self.report, ".html")
        if self.figures is not None:
            check_folder(self.figures)
        with progress():
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
            print_json(document_of(result))
        else:
            print("\n".join(sentences_of(result)))
        if self.report is not None:
            result.save(self.report)
        if self.figures is not None:
            write_figures(result, self.figures)
        print_written(self.report, self.figures, json=self.json)
        if result.outcome.asked and not result.done:
            raise Stopped(result.outcome.asked)
        return 0 if result.done else 1

    def kept(self) -> str:
        """What a stopped balancing leaves on disk."""
        again = "balancing begins anew from where the masses stand"
        if self.rrd is None or not self.rrd.exists():
            return again
        return f"{self.rrd} holds what was recorded, if it had begun; {again}"


def _times(factor: float, values: Triple) -> Triple:
    return cast(Triple, tuple(factor * value for value in values))
