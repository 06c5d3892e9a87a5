"""The verbs of experiments and routine procedures: `twin isolate` and others."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import tyro

if TYPE_CHECKING:
    from twin.shown import Shown


def _arg(metavar: str) -> object:
    return tyro.conf.arg(metavar=metavar)


R = TypeVar("R", bound="Shown")


def _shown(
    make: "Callable[[Callable[[str], None]], R]",
    *,
    json: bool,
    html: Path | None = None,
    read: Sequence[Path] = (),
) -> R:
    """Make a result under a line of progress, print it, and write its page.

    Args:
        make: what makes it, given what receives the name of each step.
        json: print its document instead of its text.
        html: the page; None for none.
        read: files that the page may not be written over.
    """
    from twin.cli.output import print_json, print_written, progress
    from twin.files import check_writable

    if html is not None:
        check_writable(html, ".html", read=read)
    with progress() as say:
        result = make(say)
    print_json(result.document()) if json else print(result)
    if html is not None:
        result.save(html)
    print_written(html, json=json)
    return result


@dataclass(frozen=True)
class Isolate:
    """Predict which causes a planned experiment detects, and which of them it confuses.

    The run is simulated with the machine's sensors as stated; J, m r, the sensors' constant errors
    and the initial states stay free, as in `twin diagnose`. A detectable size is the size at which
    a cause reaches the evidence of --evidence in the linearised model.
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    reference: Annotated[str | None, _arg("REFERENCE")] = None
    """As of `twin run`; by default the machine's usual excitation."""
    controller: Annotated[str | None, _arg("LAW")] = None
    """By default the first law that makes the machine follow a reference."""
    sensors: Annotated[tuple[str, ...], _arg("STREAM ...")] = ()
    """Streams that are measured; by default all that the platform states."""
    duration: Annotated[float, _arg("SECONDS")] = 60.0
    """Length of the experiment."""
    evidence: Annotated[float, _arg("NUMBER")] = 60.0
    """Evidence from which a cause counts as detectable."""
    brief: bool = False
    """Leave out the comparison with other sensors and motions, which takes most of the time."""
    seed: int = 0
    """Seed of the sensors' noise."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page with the matrix; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of a table."""

    def run(self) -> int:
        """Simulate, weigh, print."""
        from twin import isolate

        _shown(
            lambda say: isolate(
                self.platform,
                reference=self.reference,
                controller=self.controller,
                sensors=self.sensors or None,
                duration=self.duration,
                evidence=self.evidence,
                advise=not self.brief,
                seed=self.seed,
                say=say,
            ),
            json=self.json,
            html=self.html,
        )
        return 0


@dataclass(frozen=True)
class Excite:
    """Design the motion within a machine's limits that best identifies an inertia or a cause.

    The motion is a multisine of roll, pitch and yaw that a shipped law follows. For a machine that
    no law can turn, the result is the attitude and the rate at release. The motion is simulated
    with the machine's actuators and sensors and keeps a margin of a fifth to each limit; its
    forecast is compared with flights that have other noise.
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    out: Annotated[Path | None, tyro.conf.Positional, _arg("OUT.csv")] = None
    """Write the reference into this file, for `twin run --reference`."""
    wanted: Annotated[str, tyro.conf.arg(name="for", metavar="inertia|CAUSE|CAUSE,CAUSE")] = (
        "inertia"
    )
    """What the experiment is for: J; the size of an effect (`twin effects`), as in
    `wheel_friction:w1`; or to distinguish two effects."""
    duration: Annotated[float, _arg("SECONDS")] = 60.0
    """Length of the experiment."""
    evaluations: Annotated[int, _arg("N")] = 90
    """Number of simulated trials in the search."""
    flights: Annotated[int, _arg("N")] = 8
    """Number of flights with other noise that the forecast is compared with; 0: none."""
    seed: int = 0
    """Seed of the search and of the noise."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Search, check, write, print."""
        from twin import excite

        _shown(
            lambda say: excite(
                self.platform,
                self.wanted,
                duration=self.duration,
                evaluations=self.evaluations,
                flights=self.flights,
                out=self.out,
                seed=self.seed,
                say=say,
            ),
            json=self.json,
            html=self.html,
        )
        return 0


@dataclass(frozen=True)
class Verify:
    """Evaluate a free float: residual torque, period, vertical offset, swirl and friction.

    A free float takes 60 to 120 s. The latest recording is compared with the earlier ones on a
    control chart. J is taken as stated. Without a recording, the free float is simulated on the
    machine as stated, which shows the resolution of the check. Exit code 1 where a number is out of
    control.
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional, _arg("[RECORDING ...]")] = ()
    """Free floats in any order: .rrd files, or folders with a log.toml."""
    seed: int = 0
    """Seed of the noise of a simulated free float."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page with the control charts; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of a table."""

    def run(self) -> int:
        """Fit, compare, print."""
        from twin import verify

        result = _shown(
            lambda say: verify(self.platform, self.recordings, seed=self.seed, say=say),
            json=self.json,
            html=self.html,
            read=self.recordings,
        )
        return 1 if result.departures else 0


@dataclass(frozen=True)
class History:
    """Plot the trend of a machine over all its recordings in a folder and its subfolders.

    Each recording is fitted as by `twin verify`. Recordings of other machines, and recordings that
    cannot be evaluated, are skipped and listed.
    """

    folder: Annotated[Path, tyro.conf.Positional, _arg("DIR")]
    """Folder with .rrd files and log folders."""
    platform: Annotated[str | None, _arg("NAME")] = None
    """The machine, by name or folder; default: the one that the first recording names."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page with the control charts; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of a table."""

    def run(self) -> int:
        """Fit, print."""
        from twin import history

        _shown(
            lambda say: history(self.folder, self.platform, say=say), json=self.json, html=self.html
        )
        return 0


@dataclass(frozen=True)
class TrimVerb:
    """Compute trim weights for the part of an offset that the sliding masses cannot compensate."""

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    recording: Annotated[Path | None, _arg("RECORDING")] = None
    """Free float that gives m r; by default m r of the platform."""
    add: Annotated[tuple[tuple[float, float, float, float], ...], _arg("KG X Y Z ...")] = ()
    """Masses that are fixed to the machine [kg] and their places [m], from the centre of rotation
    in body axes."""
    below: Annotated[float, _arg("UM")] = 0.0
    """Wanted depth of the centre of mass below the centre of rotation, in micrometres."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Solve, print."""
        from twin import trim

        _shown(
            lambda say: trim(
                self.platform,
                recording=self.recording,
                add=self.add,
                below=1e-6 * self.below,
                say=say,
            ),
            json=self.json,
        )
        return 0


@dataclass(frozen=True)
class Calibrate:
    """Estimate bias, scale and noise of a sensor from logs, with 95 % intervals.

    gyro: minutes at rest give the Allan deviation; an attitude in the same log gives scale, axes
    and lag; without one, whole turns about the axes between two rests give the scale.
    accelerometer: six or more poses at rest. magnetometer: a turn through all attitudes, far from
    iron.
    """

    sensor: Annotated[str, tyro.conf.Positional, _arg("gyro|accelerometer|magnetometer")]
    """Sensor to calibrate."""
    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, _arg("LOG [LOG ...]")]
    """Folders with a log.toml, or .rrd recordings; they need no platform."""
    gravity: Annotated[float | None, _arg("M/S2")] = None
    """Gravity where the logs were recorded; default: that of the first log, else 9.81."""
    field: Annotated[float | None, _arg("UT")] = None
    """Strength of the magnetic field, in uT; default: that of the first log, else unknown."""
    out: Annotated[Path | None, _arg("calibration.toml")] = None
    """Write bias and scale as effects into this file; the platform in that folder then has them."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page with the figure; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Fit, write, print."""
        from twin import calibrate
        from twin.cli.output import print_written
        from twin.errors import UsageError
        from twin.files import check_writable

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        for path, ending in ((self.html, ".html"), (self.out, ".toml")):
            if path is not None:
                check_writable(path, ending, read=self.logs)
        for name in ("gravity", "field"):
            value = getattr(self, name)
            if value is not None and value <= 0.0:
                raise UsageError(f"--{name} is {value:g}; give a number above 0")
        result = _shown(
            lambda say: calibrate(
                self.sensor,
                self.logs,
                gravity=self.gravity,
                field=None if self.field is None else 1e-6 * self.field,
                say=say,
            ),
            json=self.json,
            html=self.html,
        )
        if self.out is not None:
            result.write(self.out)
        print_written(self.out, json=self.json)
        return 0


@dataclass(frozen=True)
class Tune:
    """Tune the gains of a control law over dispersed runs, with common random numbers.

    All sets of gains fly the same runs. Held-out runs compare the best set with the law's present
    gains, by the paired difference and its 95 % interval. The exit code is 0 whether or not the
    gains improve.
    """

    law: Annotated[str, tyro.conf.Positional, _arg("LAW")]
    """A shipped law (see `twin controllers`), or a file."""
    on: Annotated[str, _arg("PLATFORM")]
    """Machine that the law flies."""
    spec: Annotated[Path | None, _arg("SPEC.toml")] = None
    """A campaign (docs/campaigns.md) whose dispersions, starts, reference and duration are flown;
    by default starts and m r are spread about the machine as stated."""
    gains: Annotated[tuple[str, ...], _arg("NAME ...")] = ()
    """Gains to tune; by default all that are not 0."""
    merit: Annotated[str, _arg("METRIC")] = "tracking_error_rms"
    """The campaign's metric whose mean over the runs is minimised."""
    runs: Annotated[int, _arg("N")] = 24
    """Runs of the search."""
    held_out: Annotated[int, _arg("N")] = 48
    """Held-out runs."""
    evaluations: Annotated[int, _arg("N")] = 60
    """Number of sets of gains that are flown."""
    duration: Annotated[float, _arg("SECONDS")] = 30.0
    """Length of a run, where --spec is not given."""
    seed: int = 0
    """Seed of the search, and of the dispersions where --spec is not given."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page with merit against gain; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Search, judge, print."""
        from twin import tune

        _shown(
            lambda say: tune(
                self.law,
                self.on,
                spec=self.spec,
                gains=self.gains,
                merit=self.merit,
                runs=self.runs,
                held_out=self.held_out,
                evaluations=self.evaluations,
                duration=self.duration,
                seed=self.seed,
                say=say,
            ),
            json=self.json,
            html=self.html,
        )
        return 0
