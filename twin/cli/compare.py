"""`twin compare LOG...`: what the model gets wrong about a measured log."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.output import LogPart, Restricted

if TYPE_CHECKING:
    from twin.recording import Recording


@dataclass(frozen=True)
class Compare:
    """Predict a log from its commands and say what the model gets wrong.

    The model is taken as built and, unless --as-built, with its base (inertia and mass moment)
    refitted; initial states are always fitted. Of several logs the first is the one to fit on:
    the others are also predicted with its base and laws.

    Of a log that names no platform the gyro is held against the attitude: its bias, scale,
    misalignment and lag, whatever moves the body.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG [LOG ...]")]
    """Folders with a log.toml, or .rrd recordings."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that each log names."""
    as_built: bool = False
    """Leave the base as platform.toml states it."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="OUT.html")] = None
    """Write a page with figures; one that exists is written anew."""
    rrd: Annotated[Path | None, tyro.conf.arg(metavar="OUT.rrd")] = None
    """Write the first log with its prediction and residual as a Rerun recording; one that exists is
    written anew."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Compare, print, write what was asked for."""
        from twin.api import compare, load, transfer
        from twin.cli.output import print_json, progress
        from twin.errors import UsageError
        from twin.files import check_writable
        from twin.report import document, transfer_sentences, write_page

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        for path, ending in ((self.report, ".html"), (self.rrd, ".rrd")):
            if path is not None:
                check_writable(path, ending, read=self.logs)
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
        for written in (self.report, self.rrd):
            if written is not None:
                print(f"wrote {written}", file=sys.stderr if self.json else sys.stdout)
        return 0

    def _sensors(self, logs: "list[Recording]") -> int:
        """Logs without a platform: no model, but the sensors against each other."""
        from twin.api import compare_sensors
        from twin.cli.output import print_json
        from twin.errors import UsageError
        from twin.report import gyro_document

        if self.report is not None or self.rrd is not None:
            raise UsageError(
                "a log that names no platform has no prediction to draw; leave out --report, --rrd"
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
