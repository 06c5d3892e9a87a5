"""`twin compare LOG...`: what the model gets wrong about a measured log."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Compare:
    """Predict a log from its commands and say what the model gets wrong.

    The model is taken as built and, unless --as-built, with its base (inertia and mass moment)
    refitted; initial states are always fitted. Of several logs the first is the one to fit on:
    the others are also predicted with its base and laws.
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with a log.toml, or .rrd recordings."""
    as_built: bool = False
    """Leave the base as platform.toml states it."""
    report: Annotated[Path | None, tyro.conf.arg(metavar="OUT.html")] = None
    """Write a page with figures."""
    rrd: Annotated[Path | None, tyro.conf.arg(metavar="OUT.rrd")] = None
    """Write the first log with its prediction and residual as a Rerun recording."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Compare, print, write what was asked for."""
        from twin.cli.output import print_json
        from twin.errors import UsageError
        from twin.platform import platform_of
        from twin.predict import compare, transfer
        from twin.recording import open_log
        from twin.report import (
            document,
            sentences,
            transfer_sentences,
            with_prediction,
            write_page,
        )

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        comparisons = [
            compare(log, platform_of(log), as_built=self.as_built)
            for log in map(open_log, self.logs)
        ]
        first, *others = comparisons
        transfers = [transfer(first, other) for other in others]
        if self.report is not None:
            write_page(self.report, comparisons, transfers)
        if self.rrd is not None:
            from twin.stream.runfile import write_recording

            write_recording(with_prediction(first), self.rrd, first.platform)
        if self.json:
            print_json(document(comparisons, transfers))
        else:
            for comparison in comparisons:
                print(f"{comparison.recording.provenance['source']} on {comparison.platform.name}")
                print("".join(f"  {sentence}\n" for sentence in sentences(comparison)))
            for moved in transfers:
                print("".join(f"  {line}\n" for line in transfer_sentences(moved, first)))
        for written in (self.report, self.rrd):
            if written is not None:
                print(f"wrote {written}", file=sys.stderr if self.json else sys.stdout)
        return 0
