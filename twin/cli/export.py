"""`twin export`: a log as a folder of tables."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Export:
    """Write any log as a folder with log.toml and one file a stream, in SI."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
    """A recording (.rrd) or a folder with a log.toml."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")]
    """The folder to make."""
    format: Literal["csv", "parquet", "mat", "mcap"] = "csv"
    """Of the streams' files; mcap, a topic of JSON messages a stream, is for archives: it carries
    its own description, and reading it needs no viewer."""
    truth: bool = False
    """A simulation's true states too."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Export; the exit code."""
        from twin.cli.output import LogPart, print_json
        from twin.recording import write_folder

        recording = LogPart().open(self.log)
        files = write_folder(recording, self.out, format=self.format, truth=self.truth)
        rows = {name: len(recording[name]) for name in files}
        if self.json:
            print_json({"folder": self.out, "rows": rows, "repairs": recording.repairs})
            return 0
        for repair in recording.repairs:
            print(f"repaired: {repair}", file=sys.stderr)
        for name, path in files.items():
            print(f"{path}: {rows[name]} rows [{recording[name].unit}]")
        hidden = sum(name.startswith("truth_") for name in recording)
        if hidden and not self.truth:
            print(f"left out: {hidden} streams of true states; --truth writes them too")
        return 0
