"""The verbs that fit a model to logs: `twin identify`, `twin compare`, `twin diagnose`."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.output import LogPart, Restricted

if TYPE_CHECKING:
    from twin.recording import Recording


Method = Literal[
    "prediction-error",
    "momentum",
    "torque",
    "energy",
    "filtered",
    "integrated",
    "recursive",
    "levenberg-marquardt",
    "ekf",
    "ukf",
    "equilibria",
    "all",
]


@dataclass(frozen=True)
class Identify:
    """Identify inertia and mass moment from logs of one machine, all together.

    prediction-error fits the predicted motion to every sample, with initial states and constant
    sensor errors; its 95 % intervals are valid. The other methods are those of the papers,
    unchanged: noise biases most of them, and their intervals do not include that bias.

    torque, momentum, energy, filtered and integrated are least squares on the balance of angular
    momentum; recursive forgets the past; levenberg-marquardt fits one trajectory from start to
    end; ekf and ukf estimate state and base together; equilibria needs rests at several positions
    of the sliding masses. all prints one table.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG [LOG ...]")]
    """Folders with a log.toml, or .rrd recordings."""
    method: Method = "prediction-error"
    """The method."""
    form: Literal["integrated", "natural"] = "integrated"
    """For torque, momentum and energy: integrated from the start, or with differentiated rates."""
    shift: Annotated[int, tyro.conf.arg(metavar="SAMPLES")] = 0
    """For momentum: samples between the two ends of a difference; 0 fits the constant instead."""
    corner: Annotated[float, tyro.conf.arg(metavar="RAD/S")] = 0.5
    """For filtered: corner frequency of the low-pass filter."""
    forgetting: Annotated[float, tyro.conf.arg(metavar="0..1")] = 0.99
    """For recursive: weight of earlier data after each step of 0.2 s."""
    physical: bool = False
    """Return the nearest rigid body; prediction-error always does."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that the first log names."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="OUT.html")] = None
    """Write a page with figures; an existing file is overwritten."""
    figures: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write the page's figures as SVG and PDF and its tables as CSV into a folder."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Identify and print."""
        from twin.api import identify, identify_by_all
        from twin.cli.output import print_json, print_written, progress, tell
        from twin.errors import TwinError, UsageError
        from twin.files import check_folder, check_writable
        from twin.identification import Settings
        from twin.report import compared
        from twin.report.results import write_figures

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        if self.method == "all" and (self.report is not None or self.figures is not None):
            raise UsageError("--method all prints one table; name one for --report or --figures")
        if self.report is not None:
            check_writable(self.report, ".html", read=self.logs)
        if self.figures is not None:
            check_folder(self.figures)
        settings = Settings(self.form, self.shift, self.corner, self.forgetting)
        logs = [self.part.open(path) for path in self.logs]
        if self.method != "all":
            with progress() as say:
                say(f"fit by {self.method}")
                result = identify(
                    logs,
                    self.platform,
                    method=self.method,
                    settings=settings,
                    physical=self.physical,
                    say=tell,
                )
            print_json(result.document()) if self.json else print(result)
            if self.report is not None:
                result.save(self.report)
            if self.figures is not None:
                write_figures(result, self.figures)
            print_written(self.report, self.figures, json=self.json)
            return 0
        by_method = identify_by_all(
            logs, self.platform, settings=settings, physical=self.physical, say=tell
        )
        if self.json:
            print_json(
                [
                    {"method": name, "failed": str(item)}
                    if isinstance(item, TwinError)
                    else item.document()
                    for name, item in by_method.items()
                ]
            )
        else:
            print("\n".join(compared(by_method)))
        return 0


@dataclass(frozen=True)
class Compare:
    """Predict a log from its commands and say what the model gets wrong.

    The model is taken as built and, unless --as-built, with its base (inertia and mass moment)
    refitted; initial states are always fitted. Where several logs are given, the first is fitted,
    and the others are also predicted with its base and laws.

    For a log that names no platform, the gyro is compared with the attitude: its bias, scale,
    misalignment and lag, for any motion of the body.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG [LOG ...]")]
    """Folders with a log.toml, or .rrd recordings."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that each log names."""
    as_built: bool = False
    """Leave the base as platform.toml states it."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="OUT.html")] = None
    """Write a page with figures; an existing file is overwritten."""
    figures: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write the page's figures as SVG and PDF and its tables as CSV into a folder."""
    rrd: Annotated[Path | None, tyro.conf.arg(metavar="OUT.rrd")] = None
    """Write the first log with its prediction and residual as a Rerun recording; an existing file
    is overwritten."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Compare, print, write what was asked for."""
        from twin.api import compare, load, transfer
        from twin.cli.output import print_json, print_written, progress
        from twin.errors import UsageError
        from twin.files import check_folder, check_writable
        from twin.report import (
            comparison_parts,
            document,
            transfer_sentences,
            write_page,
            write_parts,
        )

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        for path, ending in ((self.report, ".html"), (self.rrd, ".rrd")):
            if path is not None:
                check_writable(path, ending, read=self.logs)
        if self.figures is not None:
            check_folder(self.figures)
        logs = [self.part.open(path) for path in self.logs]
        if self.platform is None and all(log.provenance.get("platform") is None for log in logs):
            return self._sensors(logs)
        machine = None if self.platform is None else load(self.platform)
        with progress() as say:
            comparisons = [
                compare(
                    log,
                    machine,
                    as_built=self.as_built,
                    say=lambda doing, name=path.name: say(f"{name}: {doing}"),
                )
                for path, log in zip(self.logs, logs, strict=True)
            ]
            first, *others = comparisons
            transfers = [transfer(first, other) for other in others]
            if self.report is not None:
                say("the page")
                write_page(self.report, comparisons, transfers)
            if self.figures is not None:
                say("the figures")
                write_parts(self.figures, comparison_parts(comparisons, transfers))
        if self.rrd is not None:
            first.save(self.rrd)
        if self.json:
            print_json(document(comparisons, transfers))
        else:
            for comparison in comparisons:
                print(f"{comparison.recording.provenance['source']} on {comparison.platform.name}")
                print("".join(f"  {sentence}\n" for sentence in str(comparison).splitlines()))
            for moved in transfers:
                print("".join(f"  {line}\n" for line in transfer_sentences(moved, first)))
        print_written(self.report, self.figures, self.rrd, json=self.json)
        return 0

    def _sensors(self, logs: "list[Recording]") -> int:
        """Logs without a platform: no model, but the sensors against each other."""
        from twin.api import compare_sensors
        from twin.cli.output import print_json
        from twin.errors import UsageError
        from twin.report import gyro_document

        if any(path is not None for path in (self.report, self.figures, self.rrd)):
            raise UsageError(
                "a log that names no platform has no prediction to draw; leave out --report, "
                "--figures and --rrd"
            )
        result = [compare_sensors(log) for log in logs]
        if self.json:
            documents = [
                gyro_document(str(path), item) for path, item in zip(self.logs, result, strict=True)
            ]
            print_json(documents[0] if len(documents) == 1 else documents)
            return 0
        for path, item in zip(self.logs, result, strict=True):
            print(f"{path}, on no platform")
            print("".join(f"  {sentence}\n" for sentence in str(item).splitlines()))
        return 0


@dataclass(frozen=True)
class Diagnose:
    """Name the causes of what the model gets wrong, with their sizes, intervals and evidence.

    Inertia, mass moment, initial states and the sensors' stated biases are refitted throughout, so
    none of them is a cause. Several logs share causes and base. Intervals are 95 %; evidence is the
    decrease of -2 log likelihood minus the penalty for the fitted numbers.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG [LOG ...]")]
    """Folders with a log.toml, or .rrd recordings."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that the first log names."""
    effects: Annotated[str | None, tyro.conf.arg(metavar="FILE,...")] = None
    """Files of your own effects, candidates in addition to the catalogue's."""
    extend: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write the platform with the named causes into a new folder."""
    validate: Annotated[Path | None, tyro.conf.arg(metavar="LOG")] = None
    """Measure the gain on a log that is not fitted."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="OUT.html")] = None
    """Write a page with figures; an existing file is overwritten."""
    figures: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write the page's figures as SVG and PDF and its tables as CSV into a folder."""
    rrd: Annotated[Path | None, tyro.conf.arg(metavar="OUT.rrd")] = None
    """Write the first log, the prediction of the explained model and the residual as a Rerun
    recording; an existing file is overwritten."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Diagnose, print, write what was asked for."""
        from twin.api import diagnose, extend, machine_of, validate
        from twin.cli.output import print_json, print_written, progress
        from twin.diagnosis import check_logs, check_new, laws_in, own_causes
        from twin.effects import effect_named
        from twin.errors import TwinError, UsageError
        from twin.files import check_folder, check_writable
        from twin.report import (
            diagnosis_document,
            diagnosis_parts,
            write_diagnosis,
            write_parts,
        )

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        if self.extend is not None:
            check_new(self.extend)
        custom = [effect_named(name) for name in self.effects.split(",")] if self.effects else []
        read = self.logs if self.validate is None else (*self.logs, self.validate)
        for path, ending in ((self.report, ".html"), (self.rrd, ".rrd")):
            if path is not None:
                check_writable(path, ending, read=read)
        if self.figures is not None:
            check_folder(self.figures)
        if self.validate is not None and self.validate.resolve() in map(Path.resolve, self.logs):
            raise UsageError(f"{self.validate} takes part in the fit; validate on another log")
        logs = [self.part.open(path) for path in self.logs]
        other = None if self.validate is None else self.part.open(self.validate)
        every = logs if other is None else [*logs, other]
        machine = machine_of(every, self.platform)
        check_logs(every, machine)
        with progress() as say:
            result = diagnose(logs, machine, effects=custom, say=say)
            gain, trouble = None, None
            if other is not None:
                say("the held-out log")
                try:
                    gain = validate(result, other)
                except TwinError as problem:  # what the other logs said is said first
                    trouble = problem
            if self.report is not None:
                say("the page")
                write_diagnosis(self.report, result, gain)
            if self.figures is not None:
                say("the figures")
                write_parts(self.figures, diagnosis_parts(result, gain))
        if self.rrd is not None:
            result.save(self.rrd)
        if self.json:
            print_json(diagnosis_document(result, gain))
        else:
            print(result)
            if gain is not None:
                print(gain)
        if self.extend is not None:
            extend(result, self.extend)
        print_written(self.report, self.figures, self.extend, self.rrd, json=self.json)
        to = sys.stderr if self.json else sys.stdout
        if self.extend is not None and result.equation is not None:
            laws = ",".join(map(str, laws_in(self.extend)))
            print(f"wrote {laws}: twin run {self.extend} --effects {laws} has it too", file=to)
        if self.extend is not None:
            for effect, brought in own_causes(result):
                file = self.extend / brought.name
                sizes = "/".join(f"{value:.6g}" for value in effect.values)
                option = f"{file}:{effect.target}" if effect.target else f"{file}"
                print(f"wrote {file}: twin run {self.extend} --effects {option}={sizes}", file=to)
        if trouble is not None:
            raise trouble
        return 0
