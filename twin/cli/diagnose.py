"""`twin diagnose LOG...`: why a model is wrong about measured logs, and what that is worth."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli.output import LogPart, Restricted


@dataclass(frozen=True)
class Diagnose:
    """Name the causes of what the model gets wrong, with their sizes and how sure they are.

    Inertia, mass moment, initial states and the sensors' stated biases are refitted throughout, so
    none of them is a cause. Of several logs causes and base are shared. Intervals are 95 %;
    evidence is the fall of -2 log likelihood less the price of the numbers that were set.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG [LOG ...]")]
    """Folders with a log.toml, or .rrd recordings."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that the first log names."""
    effects: Annotated[str | None, tyro.conf.arg(metavar="FILE,...")] = None
    """Files of effects of your own, which may be causes beside those of the catalogue."""
    extend: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write the platform with what was found into a new folder."""
    validate: Annotated[Path | None, tyro.conf.arg(metavar="LOG")] = None
    """Measure the gain on a log that takes no part."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="OUT.html")] = None
    """Write a page with figures; one that exists is written anew."""
    rrd: Annotated[Path | None, tyro.conf.arg(metavar="OUT.rrd")] = None
    """Write the first log, what the explained model predicts and what it leaves, for Rerun; a file
    that exists is written anew."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Diagnose, print, write what was asked for."""
        from twin.api import diagnose, extend, machine_of, validate
        from twin.cli.output import print_json, progress
        from twin.diagnosis import check_logs, check_new, laws_in, own_causes
        from twin.effects import effect_named
        from twin.errors import TwinError, UsageError
        from twin.files import check_writable
        from twin.report import diagnosis_document, write_diagnosis

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        if self.extend is not None:
            check_new(self.extend)
        own = [effect_named(name) for name in self.effects.split(",")] if self.effects else []
        read = self.logs if self.validate is None else (*self.logs, self.validate)
        for path, ending in ((self.report, ".html"), (self.rrd, ".rrd")):
            if path is not None:
                check_writable(path, ending, read=read)
        if self.validate is not None and self.validate.resolve() in map(Path.resolve, self.logs):
            raise UsageError(f"{self.validate} takes part in the fit; validate on another log")
        logs = [self.part.open(path) for path in self.logs]
        other = None if self.validate is None else self.part.open(self.validate)
        every = logs if other is None else [*logs, other]
        machine = machine_of(every, self.platform)
        check_logs(every, machine)
        with progress() as say:
            result = diagnose(logs, machine, effects=own, say=say)
            gain, trouble = None, None
            if other is not None:
                say("the log that took no part")
                try:
                    gain = validate(result, other)
                except TwinError as problem:  # what the other logs said is said first
                    trouble = problem
            if self.report is not None:
                say("the page")
                write_diagnosis(self.report, result, gain)
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
        to = sys.stderr if self.json else sys.stdout
        for written in (self.report, self.extend, self.rrd):
            if written is not None:
                print(f"wrote {written}", file=to)
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
